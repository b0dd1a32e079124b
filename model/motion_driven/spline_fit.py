"""Fit a twice differentiable spline to measured key angles, with its posterior uncertainty.

Measured angles in (encoder counts or noiseless), a quintic spline with a knot at every sample out. It is smoothed by a
prior on its fourth derivative: independent normal values with a variance that follows the data, high where the key hits
something and low where it rests (`_fit_spline`). Spline and covariance are that prior's posterior, so that the stated
uncertainty covers what smoothing rounds off at a bump, not only noise.
Noise: a count is uncertain by its width; equal counts in a row repeat one rounding error and count as one reading;
jitter of angle and clock beyond that is estimated from the residuals. Unusable columns raise ``InputError``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_banded

from model.elements.prescribed import ORDER
from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import check_rows, two_columns
from model.kernels import banded
from model.scene.key_motion import KeyMotion
from model.scene.selection import SceneChoice, load_scene

Array = NDArray[np.float64]


def find_resolution(angle_rad: Array) -> float:
    """Width of a count (rad) where all angles are whole multiples of one apart, else 0."""
    step = np.diff(np.unique(angle_rad))
    step = step[step > 1e-12]
    if len(step) == 0:
        return 0.0
    smallest = float(step.min())
    smallest = float(np.median(step[step < 1.5 * smallest]))
    multiples = step / smallest
    return smallest if np.max(np.abs(multiples - np.round(multiples))) < 1e-3 else 0.0


def run_lengths(angle_rad: Array) -> Array:
    """How many equal readings in a row each sample belongs to."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(angle_rad)) + 1, [len(angle_rad)]])
    length = np.diff(edges)
    return np.repeat(length, length).astype(float)


def repeated_share(resolution_rad: float, jitter_rad: float) -> float:
    """Share of the rounding's variance that stays the same from sample to sample while nothing moves.

    The mean of a rounded, jittering reading is a sawtooth of the true angle whose harmonics the jitter damps; where
    the angle may lie anywhere within a count its variance is this sum. Without jitter everything stays (share 1).
    """
    k = np.arange(1, 40)  # harmonics; the sum beyond is 1.5 % of it
    damping = np.exp(-((2.0 * np.pi * k * jitter_rad / resolution_rad) ** 2))
    return float(np.sum(damping / k**2) / np.sum(1.0 / k**2))


def fit_noise(variance: Array, speed: Array, weight: Array) -> tuple[float, float]:
    """Jitter of the angle (rad) and of the clock (s): a and b >= 0 of variance = a^2 + b^2 speed^2, least squares."""
    square = speed**2
    total, cross, fourth = np.sum(weight), np.sum(weight * square), np.sum(weight * square**2)
    mean, slope = np.sum(weight * variance), np.sum(weight * variance * square)
    determinant = total * fourth - cross**2
    if determinant > 1e-9 * total * fourth:
        b = (total * slope - cross * mean) / determinant
        a = (mean - b * cross) / total
        if a >= 0.0 and b >= 0.0:
            return float(np.sqrt(a)), float(np.sqrt(b))
        if b > 0.0:
            return 0.0, float(np.sqrt(max(0.0, slope / fourth)))
    return float(np.sqrt(max(0.0, mean / total))), 0.0


FEWEST, MOST = 20, 200_000  # samples
LARGEST_KEY_RAD = 3.0  # rad, of a key that turns by 0.05: beyond, a table is in degrees
LARGEST_U_RAD = 0.1  # rad, of a resolution, jitter or zero: twice a key's whole turn


def check_motion_table(time_s: ArrayLike, key_rad: ArrayLike, where: str = "key motion") -> tuple[Array, Array]:
    """Return increasing times, s, and angles, rad, as arrays without the lost ones (NaN); ``InputError`` for too few or
    many rows, or the first row that cannot be used."""
    times, angles = two_columns(time_s, key_rad, where)
    lost = np.isnan(angles)
    check_rows(times, angles, where, "key_rad", LARGEST_KEY_RAD, lost)
    times, angles = times[~lost], angles[~lost]
    if not FEWEST <= len(times) <= MOST:
        raise InputError(f"{where}: found {len(times)} rows with an angle, allowed {FEWEST} to {MOST}")
    return times, angles


def read_motion_table(path: str | Path, scene: SceneChoice | str | Path = "whole") -> tuple[Array, Array]:
    """Read times, s, and angles, rad, without lost ones (NaN), from a CSV file with the columns ``time_s,key_rad``
    (``motor_rad`` or ``finger_rad`` where ``scene`` has an arm or finger).

    Parameters
    ----------
    path : CSV file
    scene : what takes part; with a motor arm or a finger the second column is ``motor_rad`` or ``finger_rad``

    Returns
    -------
    tuple of ndarray
        Times (n,), s, and angles (n,), rad, without rows whose angle is NaN.

    Raises
    ------
    InputError : the file cannot be read or used; the message names file and row

    Examples
    --------
    >>> import model
    >>> time_s, key_rad = model.read_motion_table("key.csv")
    >>> bool(key_rad.min() < -0.04)  # pressed, the key turns clockwise
    True
    """
    angle = f"{load_scene(scene).prescribed_coordinate}_rad"
    table = read_columns(path, ("time_s", angle), ())
    return check_motion_table(table.numbers("time_s"), table.numbers(angle), table.where)


Integers = NDArray[np.int64]

DEGREE, PRIOR = ORDER - 1, 4  # of the spline; of the derivative that the prior keeps small
WINDOW_S = 1.0e-3  # half width over which the prior's variance is the same: shorter than a key's bump
WINDOW_SAMPLES = 5  # least number of samples in a window of the noise estimate
MOST_ITERATIONS, OVER_RELAXATION = 400, 1.4  # of the variance; step factor in its logarithm: choice
# of an acceleration's standard uncertainty: by at most so much do acceleration and uncertainty change in the last
# iteration; the variance itself falls on by a constant factor where there is no information, and nothing follows it
CONVERGED = 0.02
SLOWEST_RAD_PER_S = 700.0  # bandwidth that the fit follows at least: a window holds no information on slower motion
SMALLEST_RATIO = 1e-15  # smallest variance of the prior over the largest that double precision can resolve
NOISELESS_RAD = 1e-8  # below this noise the motion between the samples dominates the uncertainty


@dataclass(frozen=True)
class KeyFit:
    """Posterior of the key's motion: a spline and how uncertain it is."""

    time_s: Array  # (n,) of the samples that were used
    resolution_rad: float  # width of a count, 0 where the angles are not quantised
    jitter_rad: float  # standard deviation of one sample's angle beyond that
    clock_s: float  # standard deviation of a sample's time
    # knots, coefficients, offset_rad: of the spline
    knots: Array
    coefficients: Array
    offset_rad: float
    # factor, inverse: bands of the posterior precision's factor and of the covariance
    factor: Array
    inverse: Array

    def motion(self, coefficients: Array | None = None) -> KeyMotion:
        """The motion as kernels take it, of other ``coefficients`` where given."""
        c = self.coefficients if coefficients is None else coefficients
        pieces = PPoly.from_spline(BSpline(self.knots, c, DEGREE))
        rows = np.ascontiguousarray(pieces.c[:, DEGREE:-DEGREE].T)
        rows[:, -1] += self.offset_rad
        return KeyMotion(pieces.x[DEGREE:-DEGREE].copy(), rows)

    def draw(self, random: np.random.Generator, u_zero_rad: float = 0.0) -> KeyMotion:
        """One draw from the posterior of the motion and of the common zero."""
        away = solve_banded((0, DEGREE), self.factor, random.standard_normal(len(self.coefficients)))
        return self.motion(self.coefficients + away + u_zero_rad * random.standard_normal())

    def evaluate(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Angle (rad), speed (rad/s) and acceleration (rad/s^2), columns of (k, 3), at times (k,), s, and their
        standard uncertainties, (k, 3) too."""
        times = np.asarray(time_s, dtype=float)
        value, u = np.empty((len(times), 3)), np.empty((len(times), 3))
        for order in range(3):
            rows, first = _design_rows(self.knots, times, order)
            value[:, order] = banded.multiply_rows(self.coefficients, first, rows)
            u[:, order] = np.sqrt(np.maximum(banded.row_variances(self.inverse, first, rows), 0.0))
        value[:, 0] += self.offset_rad
        return value, u


def _difference_matrix(knots: Array, order: int) -> Array:
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


def _design_rows(knots: Array, times: Array, order: int = 0) -> tuple[Array, Integers]:
    """Design of the spline's derivative at ``times``: (k, DEGREE + 1) neighbouring entries and where they begin."""
    inner = knots[order : len(knots) - order]
    sparse = BSpline.design_matrix(np.clip(times, knots[0], knots[-1]), inner, DEGREE - order).tocsr()
    lower = sparse.data.reshape(len(times), DEGREE - order + 1)
    first = sparse.indices.reshape(lower.shape)[:, 0].astype(np.int64)
    out = np.zeros((len(times), DEGREE + 1))
    steps = _difference_matrix(knots, order)
    for k in range(lower.shape[1]):
        out[:, k : k + order + 1] += lower[:, k : k + 1] * steps[first + k]
    return out, first


def _fit_spline(
    samples: tuple[Array, Array, Array, float],
    noise_given: tuple[float | None, float],
    inner: Array,
    relaxation: float,
) -> tuple[tuple[float, float], Array, Array, tuple[Array, Array]]:
    """Fit a spline with knots at ``inner`` (s) to ``samples`` (s, rad, equal readings, count's width): its noise
    (jitter rad, clock s), knots, coefficients, banded factor and inverse.

    ``samples`` are times, angles from the first on, the run of equal readings of each, and the width of a count;
    ``noise_given`` the jitter of angle, None where it is to be estimated, and of the clock.

    The prior's variance is what the data show of the fourth derivative, averaged over a window (expectation
    maximisation, each step taken ``relaxation`` times, until no acceleration changes by `CONVERGED`), but never so
    small that the window would contain less than one independent value: the fit would then assume more smoothness than
    the data can show.
    """
    (times, y, runs, resolution), (given, clock) = samples, noise_given
    rounding = resolution**2 / 12.0
    floor = 1e-9 * max(1e-3, float(np.ptp(y)))  # noiseless angles come from a computation of at best this accuracy
    jitter = max(floor, 1e-6 * float(np.ptp(y)) if given is None else given)
    knots = np.concatenate([[inner[0]] * DEGREE, inner, [inner[-1]] * DEGREE])
    size = len(knots) - DEGREE - 1
    rows, first = _design_rows(knots, times)
    rows_speed, first_speed = _design_rows(knots, times, 1)
    rows_acceleration, first_acceleration = _design_rows(knots, times, 2)
    acceleration, u = np.full(len(times), np.inf), np.zeros(len(times))
    speed = np.zeros(len(times))
    prior, at = _difference_matrix(knots, PRIOR), np.arange(size - PRIOR)
    place = np.array([knots[PRIOR + k : PRIOR + k + len(prior)] for k in range(DEGREE - PRIOR + 1)]).mean(axis=0)
    width = (knots[DEGREE + 1 : DEGREE + 1 + len(prior)] - knots[PRIOR : PRIOR + len(prior)]) / (DEGREE + 1 - PRIOR)
    prior = prior * np.sqrt(width)[:, None]  # the square is then an intensity, rad^2/s^7, whatever the sampling
    step = float(np.median(np.diff(times)))
    reach = 0.5 * max(WINDOW_S, WINDOW_SAMPLES * step)
    low, high = np.searchsorted(place, place - reach), np.searchsorted(place, place + reach, side="right")
    intensity = np.full(len(prior), 1e12)
    factor = inverse = c = np.empty(0)
    for _ in range(MOST_ITERATIONS):
        share = repeated_share(resolution, jitter) if rounding > 0.0 else 0.0
        readings = 1.0 / (1.0 - share + share * runs)  # of the rounding, how many readings each sample is
        noise = jitter**2 + (clock * speed) ** 2
        weight = 1.0 / (rounding / readings + noise)
        normal, right = np.zeros((DEGREE + 1, size)), np.zeros(size)
        banded.add_outer_products(normal, first, rows, weight)
        banded.add_outer_products(normal, at, prior, 1.0 / intensity)
        banded.add_weighted_rows(right, first, rows, weight * y)
        try:
            factor = cholesky_banded(normal)
        except np.linalg.LinAlgError:
            raise InputError(
                "key motion: angles found that no smooth motion comes near; check their unit (rad) and the times (s)"
            ) from None
        c = cho_solve_banded((factor, False), right)
        inverse = banded.inverse_band(factor)
        expected = banded.multiply_rows(c, at, prior) ** 2 + banded.row_variances(inverse, at, prior)
        for _ in range(2):
            expected = banded.window_means(expected, low, high)
        intensity = intensity * (expected / intensity) ** relaxation
        lowest = SLOWEST_RAD_PER_S ** (2 * PRIOR) * step * (rounding + jitter**2)
        intensity = np.maximum(intensity, max(lowest, SMALLEST_RATIO * float(intensity.max())))
        if given is None:
            seen = (
                (y - banded.multiply_rows(c, first, rows)) ** 2 + banded.row_variances(inverse, first, rows) - rounding
            )
            speed = banded.multiply_rows(c, first_speed, rows_speed)
            jitter, clock = fit_noise(seen, speed, readings / (rounding + noise) ** 2)
            jitter = max(floor, jitter)
        before, u_before = acceleration, u
        acceleration = banded.multiply_rows(c, first_acceleration, rows_acceleration)
        u = np.sqrt(np.maximum(banded.row_variances(inverse, first_acceleration, rows_acceleration), 0.0))
        if np.all(np.maximum(np.abs(acceleration - before), np.abs(u - u_before)) <= CONVERGED * u):
            break
    return (jitter, clock), knots, c, (factor, inverse)


def fit_key_motion(
    time_s: ArrayLike, key_rad: ArrayLike, *, resolution_rad: float | None = None, jitter_rad: float | None = None
) -> KeyFit:
    """Fit a spline to measured angles (n,), rad, of the key, NaN where lost, for angle, speed and acceleration with
    uncertainties; width of a count and jitter (rad): None, estimated."""
    times, angles = check_motion_table(time_s, key_rad)
    for name, value in (("resolution", resolution_rad), ("jitter", jitter_rad)):
        if value is not None and not 0.0 <= value <= LARGEST_U_RAD:
            raise InputError(f"{name} of the key's angle: found {value:g} rad, allowed 0 to {LARGEST_U_RAD:g}")
    resolution = find_resolution(angles) if resolution_rad is None else float(resolution_rad)
    runs = run_lengths(angles) if resolution > 0.0 else np.ones(len(angles))
    samples = times, angles - angles[0], runs, resolution
    noise, knots, coefficients, covariance = _fit_spline(samples, (jitter_rad, 0.0), times, OVER_RELAXATION)
    if resolution == 0.0 and noise[0] < NOISELESS_RAD:
        # the uncertainty is then what happens between samples: there must be a knot for it
        finer = np.sort(np.concatenate([times, 0.5 * (times[1:] + times[:-1])]))
        noise, knots, coefficients, covariance = _fit_spline(samples, noise, finer, 1.0)
    return KeyFit(times, resolution, *noise, knots, coefficients, float(angles[0]), *covariance)
