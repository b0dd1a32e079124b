"""From measured key angles to a motion that can be differentiated twice, with its uncertainty.

Measured angles in (encoder counts or noiseless), a quintic spline with a knot at every sample out. What keeps it
smooth is a prior on its fourth derivative: independent normal numbers with a variance that follows the data, high
where the key hits something and low where it rests (`_follow`). Spline and covariance are the posterior of that prior,
so that what smoothing rounds off at a bump is in the stated uncertainty, not only what noise leaves.
Noise: a count is uncertain by its width; equal counts in a row repeat one rounding error and count as one reading;
jitter beyond that is estimated from the residuals. Bad columns end in ``InputError``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .column_file import read_columns
from .errors import InputError
from .kernels import banded
from .motion import KeyMotion

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DEGREE, PRIOR = 5, 4  # of the spline; of the derivative that the prior keeps small
WINDOW_S = 1.2e-3  # half width over which the prior's variance is the same: shorter than a key's bump
WINDOW_SAMPLES = 5
ROUNDS, HASTE = 60, 1.7  # of the variance's iteration, and how far beyond each of its steps
SLOWEST_RAD_PER_S = 700.0  # motion is followed up to there at least: a window tells nothing of what is slower
DEEPEST = 1e-15  # smallest variance of the prior over the largest: what double precision can still tell apart
FEWEST = 20  # samples
LARGEST_KEY_RAD, LARGEST_TIME_S, LONGEST = 3.0, 1e6, 200_000


@dataclass(frozen=True)
class KeyFit:
    """Posterior of the key's motion: a spline and how uncertain it is.

    Attributes
    ----------
    time_s : (n,) of the samples that were used
    resolution_rad : width of a count, 0 where the angles are not quantised
    jitter_rad : standard deviation of one sample beyond that
    knots, coefficients, offset_rad : of the spline
    factor, inverse : bands of the posterior precision's factor and of the covariance
    """

    time_s: Array
    resolution_rad: float
    jitter_rad: float
    knots: Array
    coefficients: Array
    offset_rad: float
    factor: Array
    inverse: Array

    def motion(self, coefficients: Array | None = None) -> KeyMotion:
        """The motion as kernels take it; of other ``coefficients`` where given."""
        from scipy.interpolate import BSpline, PPoly

        c = self.coefficients if coefficients is None else coefficients
        pieces = PPoly.from_spline(BSpline(self.knots, c, DEGREE))
        rows = np.ascontiguousarray(pieces.c[:, DEGREE:-DEGREE].T)
        rows[:, -1] += self.offset_rad
        return KeyMotion(pieces.x[DEGREE:-DEGREE].copy(), rows)

    def draw(self, random: np.random.Generator, u_zero_rad: float = 0.0) -> KeyMotion:
        """A motion that could as well have given these samples: one draw of the posterior, and of the common zero."""
        from scipy.linalg import solve_banded

        away = solve_banded((0, DEGREE), self.factor, random.standard_normal(len(self.coefficients)))
        return self.motion(self.coefficients + away + u_zero_rad * random.standard_normal())

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Angle (rad), speed, acceleration at times (k,) and their standard uncertainties; (k, 3) each."""
        times = np.asarray(time_s, dtype=float)
        value, u = np.empty((len(times), 3)), np.empty((len(times), 3))
        for order in range(3):
            rows, first = _rows(self.knots, times, order)
            value[:, order] = banded.times(self.coefficients, first, rows)
            u[:, order] = np.sqrt(np.maximum(banded.variances(self.inverse, first, rows), 0.0))
        value[:, 0] += self.offset_rad
        return value, u


def _differences(knots: Array, order: int) -> Array:
    """Rows that turn coefficients into those of a derivative, (n - order, order + 1)."""
    rows = np.ones((len(knots) - DEGREE - 1, 1))
    for done in range(order):
        degree, inner = DEGREE - done, knots[done : len(knots) - done]
        new = np.zeros((len(rows) - 1, rows.shape[1] + 1))
        new[:, 1:] += rows[1:]
        new[:, :-1] -= rows[:-1]
        width = inner[1 + degree : degree + len(rows)] - inner[1 : len(rows)]
        rows = new * (degree / width)[:, None]
    return rows


def _rows(knots: Array, times: Array, order: int = 0) -> tuple[Array, Integers]:
    """Design of the spline's derivative at ``times``: (k, DEGREE + 1) neighbouring entries and where they begin."""
    from scipy.interpolate import BSpline

    inner = knots[order : len(knots) - order]
    sparse = BSpline.design_matrix(np.clip(times, knots[0], knots[-1]), inner, DEGREE - order).tocsr()
    lower = sparse.data.reshape(len(times), DEGREE - order + 1)
    first = sparse.indices.reshape(lower.shape)[:, 0].astype(np.int64)
    out = np.zeros((len(times), DEGREE + 1))
    steps = _differences(knots, order)
    for k in range(lower.shape[1]):
        out[:, k : k + order + 1] += lower[:, k : k + 1] * steps[first + k]
    return out, first


def resolution_of(angle_rad: Array) -> float:
    """Width of a count (rad) where all angles are whole multiples of one apart, else 0."""
    step = np.diff(np.unique(angle_rad))
    step = step[step > 1e-12]
    if len(step) == 0:
        return 0.0
    smallest = float(step.min())
    smallest = float(np.median(step[step < 1.5 * smallest]))
    multiples = step / smallest
    return smallest if np.max(np.abs(multiples - np.round(multiples))) < 1e-3 else 0.0


def _runs(angle_rad: Array) -> Array:
    """How many equal readings in a row each sample belongs to."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(angle_rad)) + 1, [len(angle_rad)]])
    length = np.diff(edges)
    return np.repeat(length, length).astype(float)


def _follow(place: Array, half_width: float) -> tuple[Integers, Integers]:
    """First and last + 1 index within ``half_width`` of each place."""
    low = np.searchsorted(place, place - half_width, side="left")
    return low, np.searchsorted(place, place + half_width, side="right")


def check_motion_table(time_s: ArrayLike, key_rad: ArrayLike, where: str = "key motion") -> tuple[Array, Array]:
    """Times and angles (n,) that can be used; lost ones (NaN) are left out. ``InputError`` names the first bad row."""
    try:
        times, angles = np.asarray(time_s, dtype=float), np.asarray(key_rad, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{where}: found something that is not a number; allowed two columns of numbers") from None
    if times.ndim != 1 or times.shape != angles.shape:
        raise InputError(f"{where}: found shapes {times.shape} and {angles.shape}, allowed two equal columns")
    lost = np.isnan(angles)
    for name, column, limit in (("time_s", times, LARGEST_TIME_S), ("key_rad", angles, LARGEST_KEY_RAD)):
        bad = (np.abs(column) > limit) | (~np.isfinite(column) & ~(lost if name == "key_rad" else False))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{where}: row {row + 1}: {name} found {column[row]:g}, allowed finite numbers up to {limit:g}"
            )
    if (np.diff(times) <= 0).any():
        row = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(
            f"{where}: row {row + 1}: time {times[row]:g} s does not follow {times[row - 1]:g} s; times must increase"
        )
    times, angles = times[~lost], angles[~lost]
    if not FEWEST <= len(times) <= LONGEST:
        raise InputError(f"{where}: found {len(times)} rows with an angle, allowed {FEWEST} to {LONGEST}")
    return times, angles


def read_motion_table(path: str | Path) -> tuple[Array, Array]:
    """Read a CSV file with the columns ``time_s,key_rad``; (n,) each, without rows whose angle is NaN."""
    table = read_columns(path, ("time_s", "key_rad"), ())
    return check_motion_table(table.numbers("time_s"), table.numbers("key_rad"), table.where)


def fit_key_motion(
    time_s: ArrayLike, key_rad: ArrayLike, *, resolution_rad: float | None = None, jitter_rad: float | None = None
) -> KeyFit:
    """Fit a motion to measured angles of the key.

    Parameters
    ----------
    time_s, key_rad : (n,) increasing times (s) and angles (rad, counter-clockwise); NaN where an angle is lost
    resolution_rad : width of an encoder count; by default seen in the angles, 0 where they are not quantised
    jitter_rad : standard deviation of a sample beyond its rounding; by default estimated

    Raises
    ------
    InputError : columns that cannot be used
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    times, angles = check_motion_table(time_s, key_rad)
    for name, value in (("resolution", resolution_rad), ("jitter", jitter_rad)):
        if value is not None and not 0.0 <= value <= 0.1:
            raise InputError(f"{name} of the key's angle: found {value:g} rad, allowed 0 to 0.1")
    resolution = resolution_of(angles) if resolution_rad is None else float(resolution_rad)
    offset = float(angles[0])
    y = angles - offset
    floor = 1e-9 * max(1e-3, float(np.ptp(y)))  # noiseless angles come from a computation that is no better
    jitter = max(floor, 1e-6 * float(np.ptp(y))) if jitter_rad is None else max(floor, jitter_rad)
    rounding = resolution**2 / 12.0
    runs = _runs(angles) if resolution > 0.0 else np.ones(len(angles))

    knots = np.concatenate([[times[0]] * DEGREE, times, [times[-1]] * DEGREE])
    rows, first = _rows(knots, times)
    prior, at = _differences(knots, PRIOR), np.arange(len(knots) - DEGREE - 1 - PRIOR)
    place = np.array([knots[PRIOR + k : PRIOR + k + len(prior)] for k in range(DEGREE - PRIOR + 1)]).mean(axis=0)
    width = (knots[DEGREE + 1 : DEGREE + 1 + len(prior)] - knots[PRIOR : PRIOR + len(prior)]) / (DEGREE + 1 - PRIOR)
    prior = prior * np.sqrt(width)[:, None]  # the square is then an intensity, rad^2/s^7, whatever the sampling
    step = float(np.median(np.diff(times)))
    low, high = _follow(place, max(WINDOW_S, WINDOW_SAMPLES * step) / 2.0)

    def local_mean(x: Array) -> Array:
        for _ in range(2):
            total = np.concatenate([[0.0], np.cumsum(x)])
            x = (total[high] - total[low]) / (high - low)
        return x

    intensity = np.full(len(prior), 1e12)
    factor = inverse = c = np.empty(0)
    for turn in range(ROUNDS):
        weight = 1.0 / (rounding * runs + jitter**2)
        normal, right = np.zeros((DEGREE + 1, len(knots) - DEGREE - 1)), np.zeros(len(knots) - DEGREE - 1)
        banded.add_rows(normal, first, rows, weight)
        banded.add_rows(normal, at, prior, 1.0 / intensity)
        banded.add_to(right, first, rows, weight * y)
        factor = cholesky_banded(normal)
        c = cho_solve_banded((factor, False), right)
        inverse = banded.inverse_band(factor)
        expected = local_mean(banded.times(c, at, prior) ** 2 + banded.variances(inverse, at, prior))
        haste = HASTE if turn < ROUNDS - 3 else 1.0
        intensity = intensity * (expected / intensity) ** haste
        lowest = SLOWEST_RAD_PER_S ** (2 * PRIOR) * step * (rounding + jitter**2)
        intensity = np.maximum(intensity, max(lowest, DEEPEST * float(intensity.max())))
        if jitter_rad is None:
            left = y - banded.times(c, first, rows)
            seen = float(np.average(left**2 + banded.variances(inverse, first, rows), weights=1.0 / runs))
            jitter = max(floor, np.sqrt(max(0.0, seen - rounding)))
    return KeyFit(times, resolution, float(jitter), knots, c, offset, factor, inverse)
