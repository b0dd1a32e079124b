"""Offset of a film's clock against an encoder on the same body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.errors import VisionInputError

MAX_OFFSET_FRAMES = 20.0  # between a film's clock and an encoder's that is looked for
MOST_LAGS = 12  # of the residuals' correlation, that count in the uncertainty: frames
LEAST_SAMPLES = 8  # of film and encoder: three unknowns and a scatter
MIN_MOVED_U = 20.0  # the angle must change by this many of its own standard uncertainties


@dataclass(frozen=True)
class ClockOffset:
    """How far a film's clock is off.

    Attributes
    ----------
    offset_s, u_offset_s : float
        To be added to the film's times, with its standard uncertainty.
    zero_rad, scale : float
        The film's angle is ``zero + scale * encoder angle``.
    residual_rad : float
        Root mean square of what is left.
    n_frames : int
    """

    offset_s: float
    u_offset_s: float
    zero_rad: float
    scale: float
    residual_rad: float
    n_frames: int


def estimate_offset(
    time_s: ArrayLike,
    angle_rad: ArrayLike,
    u_angle_rad: ArrayLike,
    encoder_time_s: ArrayLike,
    encoder_rad: ArrayLike,
    *,
    free_scale: bool = False,
) -> ClockOffset:
    """Offset to add to a film's times (n,) to have the encoder's (k,), s, by the angles, rad, of one body in both, with
    its standard uncertainty; also zero, scale (fitted if ``free_scale``) and residual. NaN where the film lost the
    body.

    Least squares of ``angle(t) = zero + scale * encoder(t + offset)``, by Gauss-Newton from the best whole step of a
    coarse search. The covariance counts the residuals as they are, with their correlation from frame to frame.

    Parameters
    ----------
    time_s, angle_rad, u_angle_rad : array_like, shape (n,)
        Film; NaN where lost. Times in the encoder's clock as far as it is known.
    encoder_time_s, encoder_rad : array_like, shape (k,)
    free_scale : bool
        Also fit the scale; otherwise it is one.

    Returns
    -------
    ClockOffset

    Raises
    ------
    VisionInputError
        Columns of different lengths, too few frames or samples, or a body that hardly moves.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> encoder_time_s = np.arange(0.0, 0.4, 2e-4)
    >>> film_time_s = np.arange(0.1, 0.3, 5e-4)
    >>> def turn(t):
    ...     return 0.1 * np.exp(-(((t - 0.2) / 0.02) ** 2))
    >>> found = vision.estimate_offset(
    ...     film_time_s, turn(film_time_s + 0.001), np.full(400, 1e-5), encoder_time_s, turn(encoder_time_s)
    ... )
    >>> print(f"{1e3 * found.offset_s:.2f} ms")
    1.00 ms
    """
    where = "clock offset: columns"
    time, angle, u = (as_numbers(v, where) for v in (time_s, angle_rad, u_angle_rad))
    clock, reading = (as_numbers(v, where) for v in (encoder_time_s, encoder_rad))
    if not (time.shape == angle.shape == u.shape and time.ndim == 1 and clock.shape == reading.shape):
        raise VisionInputError("clock offset: film columns must have one length, encoder columns another")
    if clock.size < LEAST_SAMPLES or np.any(np.diff(clock) <= 0.0) or not np.all(np.isfinite(reading)):
        raise VisionInputError(
            f"clock offset: the encoder needs at least {LEAST_SAMPLES} finite samples at increasing times"
        )
    frame_s = float(np.median(np.diff(time)))
    reach = MAX_OFFSET_FRAMES * frame_s
    known = np.isfinite(angle) & (u > 0.0) & (time > clock[0] + reach) & (time < clock[-1] - reach)
    if np.count_nonzero(known) < LEAST_SAMPLES:
        raise VisionInputError(
            f"clock offset: {np.count_nonzero(known)} frames within the encoder's record; needs {LEAST_SAMPLES}"
        )
    time, angle, u = time[known], angle[known], u[known]
    if np.ptp(angle) < MIN_MOVED_U * np.median(u):
        raise VisionInputError("clock offset: the body hardly moves on the film; use a film with a blow")
    grid, level, slope = _running_line(clock, reading, 2.0 * frame_s)

    def design(offset: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        at = np.interp(time + offset, grid, level)
        columns = [np.interp(time + offset, grid, slope), np.ones_like(time)]
        if free_scale:
            columns.append(at)
        weighted = np.column_stack(columns) / u[:, None]
        target = (angle if free_scale else angle - at) / u
        return weighted, target, at

    def misfit(offset: float) -> float:
        weighted, target, _ = design(offset)
        rest = weighted[:, 1:]
        solution = np.linalg.lstsq(rest, target, rcond=None)[0]
        return float(np.sum((target - rest @ solution) ** 2))

    steps = np.arange(-reach, reach, 0.25 * frame_s)
    offset = float(steps[int(np.argmin([misfit(step) for step in steps]))])
    scale = 1.0
    for _ in range(20):
        weighted, target, _ = design(offset)
        solution = np.linalg.lstsq(weighted, target, rcond=None)[0]
        scale = float(solution[2]) if free_scale else 1.0
        change = float(solution[0]) / scale
        offset += change
        if not abs(offset) < reach:
            raise VisionInputError(
                "clock offset: film and encoder do not fit each other; are they of one body and trial?"
            )
        if abs(change) < 1e-6 * frame_s:
            break
    weighted, target, _ = design(offset)
    solution = np.linalg.lstsq(weighted, target, rcond=None)[0]
    rest = target - weighted @ solution
    inverse = np.linalg.inv(weighted.T @ weighted)
    # heteroscedastic and autocorrelated residuals: Newey and West, Econometrica 55, 1987, with Bartlett weights
    lags = min(MOST_LAGS, rest.size // 4)
    scores = weighted * rest[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        across = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (across + across.T)
    freedom = rest.size / max(1, rest.size - weighted.shape[1])
    robust = (inverse @ middle @ inverse)[0, 0] * freedom
    u_offset = float(np.sqrt(max(robust, inverse[0, 0]))) / abs(scale)
    return ClockOffset(offset, u_offset, float(solution[1]), scale, float(np.sqrt(np.mean((rest * u) ** 2))), rest.size)


def _running_line(
    time: NDArray[np.float64], value: NDArray[np.float64], width_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Times, level and slope, each (k,), of straight lines fitted to the samples in a window of ``width_s`` around
    each, as far as it is full; `VisionInputError` for a record shorter than two."""
    half = max(1, round(0.5 * width_s / float(np.median(np.diff(time)))))
    span = np.arange(-half, half + 1)
    if time.size < 2 * span.size:
        raise VisionInputError("clock offset: the encoder's record is too short")
    kernel = np.ones(span.size)

    def mean(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.convolve(x, kernel, mode="valid") / span.size

    # centred, so that differences of squares lose no digits
    middle, level0 = time[half:-half], value.mean()
    t, v = time - time.mean(), value - level0
    mean_t, mean_v = mean(t), mean(v)
    slope = (mean(t * v) - mean_t * mean_v) / (mean(t * t) - mean_t**2)
    level = level0 + mean_v + slope * (middle - time.mean() - mean_t)
    return middle, level, slope
