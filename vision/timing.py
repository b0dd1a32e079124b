"""Exposure times of frames from the camera's frame clock or counted pulses, and a film's clock offset.

Exposure starts on a rising edge of the frame clock, a fixed delay later where the camera has one; the time of a frame
is the middle of its exposure. `estimate_offset` compares a tracked angle with an encoder on the same body. Arrays that
cannot be a clock, or motion too small to determine an offset, raise `VisionInputError`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import ArrayRecord, as_numbers
from vision.errors import VisionInputError

MAX_OFFSET_FRAMES = 20.0  # between a film's clock and an encoder's that is looked for
MIN_MOVED_U = 20.0
"""The angle must change by this many of its own standard uncertainties."""


@dataclass(frozen=True)
class FrameTimes(ArrayRecord):
    """Middle of each exposure, s, shape (n,), and the standard uncertainty all of them share."""

    time_s: NDArray[np.float64]
    u_time_s: float


def times_of_edges(edge_time_s: ArrayLike, exposure_s: float = 0.0, delay_s: float = 0.0) -> NDArray[np.float64]:
    """Middle of each exposure from the times of the frame clock's rising edges.

    Parameters
    ----------
    edge_time_s : array_like, shape (n,)
        Increasing.
    exposure_s : float
    delay_s : float
        From the edge to the start of the exposure, as the camera's manual states it.

    Returns
    -------
    ndarray, shape (n,)
        Times, s.

    Raises
    ------
    VisionInputError
        Edges that do not increase, or an exposure or delay that cannot be.

    Examples
    --------
    >>> import vision
    >>> vision.times_of_edges([0.0, 0.0005], exposure_s=1e-4)
    array([5.0e-05, 5.5e-04])
    """
    edges = as_numbers(edge_time_s, "frame clock: edges")
    if edges.ndim != 1 or not np.all(np.isfinite(edges)) or np.any(np.diff(edges) <= 0.0):
        raise VisionInputError("frame clock: its edges must be finite and increase; check the counter's recording")
    if not (0.0 <= exposure_s < np.inf and np.isfinite(delay_s)):
        raise VisionInputError(
            f"frame clock: exposure {exposure_s} s and delay {delay_s} s; needs finite values, none below 0"
        )
    if edges.size > 1 and exposure_s > np.diff(edges).min() * 1.0001:
        raise VisionInputError(
            f"frame clock: exposure {exposure_s:g} s is longer than a frame, {np.diff(edges).min():g} s"
        )
    return edges + delay_s + 0.5 * exposure_s


def times_of_counts(
    sample_time_s: ArrayLike, count: ArrayLike, exposure_s: float = 0.0, delay_s: float = 0.0
) -> FrameTimes:
    """Middle of each exposure from a counter of the camera's pulses that is read at sample times.

    The pulse that makes a count lies between two samples, and all pulses lie on one straight line; what both leave
    undetermined is the stated uncertainty. Pulses that lie on no line (lost, or an irregular clock) are refused.

    Parameters
    ----------
    sample_time_s : array_like, shape (k,)
    count : array_like of int, shape (k,)
        Pulses since the counter was armed; never falls.
    exposure_s : float
    delay_s : float
        From the pulse to the start of the exposure, as the camera's manual states it.

    Returns
    -------
    FrameTimes
        Frame 0 belongs to the first pulse counted within the samples.

    Raises
    ------
    VisionInputError
        Counts that fall or are too few, or pulses that lie on no line.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> sample_time_s = np.arange(500) / 5000.0
    >>> frames = vision.times_of_counts(sample_time_s, np.floor(2000.0 * sample_time_s).astype(int))
    >>> print(f"{1e3 * np.diff(frames.time_s).mean():.3f} ms")
    0.500 ms
    """
    time = as_numbers(sample_time_s, "counted frames: times")
    counted = as_numbers(count, "counted frames: counts", dtype=np.int64)
    if time.ndim != 1 or counted.shape != time.shape or time.size < 3 or np.any(np.diff(time) <= 0.0):
        raise VisionInputError("counted frames: needs increasing sample times and one count for each")
    steps = np.diff(counted)
    if np.any(steps < 0):
        raise VisionInputError(
            "counted frames: counts must be whole numbers that never fall; check the counter's channel"
        )
    rise = np.flatnonzero(steps)
    if rise.size < 3:
        raise VisionInputError(f"counted frames: {rise.size} counts within the samples; needs at least 3")
    if steps.max() > 1:
        at = float(time[int(np.argmax(steps)) + 1])
        raise VisionInputError(
            f"counted frames: {steps.max()} counts in one sample at {at:g} s; read the counter faster"
        )
    number = counted[rise + 1].astype(float)
    early, late = time[rise], time[rise + 1]
    line = np.polyval(np.polyfit(number, 0.5 * (early + late), 1), number)
    # the clock may be shifted as a whole as long as every pulse stays within its sample: with a frame clock that
    # is derived from the sample clock no averaging makes that narrower
    lowest, highest = float((early - line).max()), float((late - line).min())
    width = float((late - early).mean())
    if lowest - highest > 0.5 * width:
        worst = int(np.argmax(np.abs(0.5 * (early + late) - line)))
        raise VisionInputError(
            f"counted frames: pulse {int(number[worst])} lies {(lowest - highest) * 1e6:.0f} us off a regular clock; "
            "pulses were lost, or the frame clock is not regular"
        )
    edges = line + 0.5 * (lowest + highest)
    u = max(highest - lowest, 0.25 * width) / np.sqrt(12.0)
    return FrameTimes(times_of_edges(edges, exposure_s, delay_s), float(u))


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
    """Offset between a film and an encoder on the same body.

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
    if clock.size < 8 or np.any(np.diff(clock) <= 0.0) or not np.all(np.isfinite(reading)):
        raise VisionInputError("clock offset: the encoder needs at least 8 finite samples at increasing times")
    frame_s = float(np.median(np.diff(time)))
    reach = MAX_OFFSET_FRAMES * frame_s
    known = np.isfinite(angle) & (u > 0.0) & (time > clock[0] + reach) & (time < clock[-1] - reach)
    if np.count_nonzero(known) < 8:
        raise VisionInputError(f"clock offset: {np.count_nonzero(known)} frames within the encoder's record; needs 8")
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

    steps = np.linspace(-reach, reach, 161)
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
        if abs(change) < 1e-4 * frame_s / MAX_OFFSET_FRAMES:
            break
    weighted, target, _ = design(offset)
    solution = np.linalg.lstsq(weighted, target, rcond=None)[0]
    rest = target - weighted @ solution
    inverse = np.linalg.inv(weighted.T @ weighted)
    # heteroscedastic and autocorrelated residuals: Newey and West, Econometrica 55, 1987, with Bartlett weights
    lags = min(12, rest.size // 4)
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
    """Level and slope of straight lines fitted to the samples within ``width_s`` around each: times, level, slope."""
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
