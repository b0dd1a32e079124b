"""The cubic of eq. 2.5, f_fit(x) = a x^3 + b x^2 + c x, fitted to the mid-line of a loading experiment.

Each phase is smoothed by a polynomial (degree chosen by the Bayesian information criterion); the cubic is the
least-squares fit to their mid-line, with a, c >= 0 and f_fit' >= 0, so that penetrations beyond the measured ones stay
physical. Standard errors: sandwich estimator (HC3). A loop that is no constant share of the cubic, as eq. 2.7 has it,
is said and widens them. Source: thesis Section 2.2.3, Figs 2.5 and 2.6.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar, nnls

from model.arrays import ArrayRecord, as_numbers
from model.calibration.curve import LoadingCurve
from model.calibration.parts import RESOLVED, check_numbers
from model.errors import InputError

GRID = 201  # points of the mid-line
DEGREES = range(3, 10)
# a misfit counts from this many times the mid-line's own uncertainty, and from this share of the largest force
EXPLAINED, NEGLIGIBLE = 3.0, 1e-3

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Phase:
    """One phase smoothed: coefficients are ``solve @ force``; values at x are ``basis(x) @ coefficients``."""

    low_m: float
    high_m: float
    solve: Array  # (k, m)
    coefficients: Array  # (k,)
    variance: Array  # (m,) of each measured force, from its residual

    def basis(self, x_m: ArrayLike) -> Array:
        """Rows of the polynomial at displacements (n,)."""
        x = as_numbers(x_m, "displacements", 1)
        scaled = (2.0 * x - self.low_m - self.high_m) / (self.high_m - self.low_m)
        return np.asarray(chebyshev.chebvander(scaled, len(self.coefficients) - 1), dtype=float)

    def force_n(self, x_m: ArrayLike) -> Array:
        """Smoothed force at displacements (n,)."""
        return self.basis(x_m) @ self.coefficients


@dataclass(frozen=True)
class FeltFit(ArrayRecord):
    """A felt's cubic with standard errors.

    Attributes
    ----------
    abc : (3,) a, N/m^3, b, N/m^2, c, N/m
    covariance : (3, 3) of them
    measured_m : smallest and largest displacement of the mid-line
    mid_m, mid_n : (GRID,) the mid-line
    misfit_n : root mean square of mid-line minus cubic
    u_mid_n : root mean square standard uncertainty of the mid-line, from the scatter of the points
    loop_misfit_n : root mean square of half the loop minus the best constant share of the cubic
    bound : the bound the fit lies on, in words, or None
    loading, unloading : the smoothed phases
    gain : (3, m + k) d(abc)/d(forces of loading, then unloading) of the free fit
    free_abc : (3,) of the fit without bounds
    off : by common error, the fit with this error one standard uncertainty off
    """

    abc: Array
    covariance: Array
    measured_m: tuple[float, float]
    mid_m: Array
    mid_n: Array
    misfit_n: float
    u_mid_n: float
    loop_misfit_n: float
    bound: str | None
    loading: Phase
    unloading: Phase
    gain: Array
    free_abc: Array
    off: Mapping[str, FeltFit] = field(default_factory=dict)

    @property
    def law_fits(self) -> bool:
        """Whether the scatter of the points explains how far the mid-line is from the cubic, eq. 2.5."""
        return not self._excess_ratio(self.misfit_n)

    @property
    def loop_fits(self) -> bool:
        """Whether it explains how far the loop is from a constant share of the cubic, as eq. 2.7 has it."""
        return not self._excess_ratio(self.loop_misfit_n)

    def _excess_ratio(self, misfit_n: float) -> bool:
        return misfit_n > max(EXPLAINED * self.u_mid_n, NEGLIGIBLE * float(self.mid_n[-1]))

    @property
    def inflation_factor(self) -> float:
        """Factor by which the errors are widened: misfit over the mid-line's uncertainty where the law does not fit."""
        return 1.0 if self.law_fits else self.misfit_n / max(self.u_mid_n, 1e-300)

    widened = inflation_factor  # former names, for one release

    @property
    def u_abc(self) -> Array:
        """(3,) standard uncertainties of a, b, c."""
        return np.sqrt(np.diag(self.covariance))

    def force_n(self, x_m: ArrayLike) -> Array:
        """f_fit at displacements (n,), eq. 2.5."""
        return _cubic_columns(x_m) @ self.abc

    def loading_ratio(self, x_m: float) -> tuple[float, float]:
        """Force of the smoothed loading curve over that of the cubic at the displacement ``x_m``, m, and its standard
        uncertainty."""
        fit, load = float(self.force_n([x_m])[0]), float(self.loading.force_n([x_m])[0])
        by_force = -load / fit**2 * (_cubic_columns([x_m])[0] @ self.gain)
        by_force[: self.loading.solve.shape[1]] += (self.loading.basis([x_m])[0] @ self.loading.solve) / fit
        variance = np.concatenate([self.loading.variance, self.unloading.variance])
        u = self.inflation_factor * float(np.sqrt(by_force**2 @ variance))
        # where the share depends on the depth, which depth it is read at is arbitrary
        other = 0.0 if self.loop_fits else self.loop_misfit_n / float(np.sqrt(np.mean(self.force_n(self.mid_m) ** 2)))
        shared = [other_fit._share(x_m) - load / fit for other_fit in self.off.values()]
        return load / fit, math.hypot(u, other, *shared)

    def _share(self, x_m: float) -> float:
        return float(self.loading.force_n([x_m])[0]) / float(self.force_n([x_m])[0])


def _cubic_columns(x_m: ArrayLike) -> Array:
    x = as_numbers(x_m, "displacements", 1)
    return np.column_stack([x**3, x**2, x])


def smooth_phase(x_m: Array, force_n: Array) -> Phase:
    """Fit force (m,) over displacement ``x_m`` (m,) by the polynomial whose degree the Bayesian information criterion
    prefers."""
    best: tuple[float, Phase] | None = None
    n = len(x_m)
    for degree in DEGREES:
        if degree + 4 > n:
            break
        phase = Phase(float(x_m.min()), float(x_m.max()), np.empty((0, n)), np.zeros(degree + 1), np.empty(0))
        rows = phase.basis(x_m)
        solve: Array = np.linalg.pinv(rows).astype(np.float64)
        coefficients = solve @ force_n
        residual = force_n - rows @ coefficients
        # rounding alone must not drive the choice where the data are free of noise
        floor = (1e-12 * np.abs(force_n).max()) ** 2
        score = n * math.log(float(residual @ residual) / n + floor) + (degree + 1) * math.log(n)
        if best is None or score < best[0]:
            leverage = np.einsum("ij,ji->i", rows, solve)
            variance = (residual / np.maximum(1.0 - leverage, 1e-6)) ** 2
            best = (score, Phase(phase.low_m, phase.high_m, solve, coefficients, variance))
    assert best is not None  # the curve has at least FEWEST_POINTS points
    return best[1]


def fit_felt(curve: LoadingCurve) -> FeltFit:
    """Fit the cubic a x^3 + b x^2 + c x (thesis eq. 2.5) to the mean of loading and unloading force over the
    displacements both have; covariance of a, b, c from scatter, misfit and shared errors.

    Parameters
    ----------
    curve : both phases of the experiment

    Returns
    -------
    FeltFit
        The cubic's a, b and c with their covariance, and how well the curve follows it.

    Raises
    ------
    InputError : the mid-line is not a compressive force

    Examples
    --------
    >>> import model
    >>> fit = model.calibration.fit_felt(model.calibration.read_curve("felt.csv"))
    >>> fit.abc.shape, fit.misfit_n < 0.1
    ((3,), True)
    """
    fit = _fit_midline(curve)
    off = {name: _fit_midline(curve.with_common_error(name)) for name in curve.common}
    covariance = fit.inflation_factor**2 * fit.covariance
    for other in off.values():
        # of the free fits: on a bound, an error that pushes against it would count for nothing
        moved = other.free_abc - fit.free_abc
        covariance = covariance + np.outer(moved, moved)
    return replace(fit, covariance=covariance, off=off)


def _fit_midline(curve: LoadingCurve) -> FeltFit:
    """Fit the cubic a x^3 + b x^2 + c x to the mean of loading and unloading force, with the covariance that the
    scatter of the points alone makes; `InputError` where it is no pressing force."""
    loading = smooth_phase(curve.loading_m, curve.loading_n)
    unloading = smooth_phase(curve.unloading_m, curve.unloading_n)
    low, high = curve.shared_m
    x = np.linspace(low, high, GRID)
    half = 0.5 * np.hstack([loading.basis(x) @ loading.solve, unloading.basis(x) @ unloading.solve])
    mid = half @ np.concatenate([curve.loading_n, curve.unloading_n])
    if mid[-1] <= 0.0:
        raise InputError(
            f"loading curve: mean force at {high:g} m found {mid[-1]:g} N, allowed above 0; check the sign"
        )
    scale = high ** np.array([3.0, 2.0, 1.0])  # so that the three columns are of one size
    columns = _cubic_columns(x) / scale
    free = np.linalg.pinv(columns)
    beta, bound = _fit_stiffening_cubic(columns, mid, free @ mid)
    if not beta.sum() > 0.0:
        raise InputError(
            "loading curve: pulls more than it presses; allowed a mid-line above 0 N; check the zero of the force"
        )
    # that of the free fit: going to the nearest point of a convex set lengthens no error, so it is safe on a bound too
    gain = (free @ half) / scale[:, None]
    variance = np.concatenate([loading.variance, unloading.variance])
    cubic = columns @ beta
    loop = 0.5 * (loading.force_n(x) - unloading.force_n(x))
    return FeltFit(
        abc=beta / scale,
        covariance=(gain * variance) @ gain.T,
        measured_m=(low, high),
        mid_m=x,
        mid_n=mid,
        misfit_n=float(np.sqrt(np.mean((mid - cubic) ** 2))),
        u_mid_n=float(np.sqrt(np.mean(half**2 @ variance))),
        loop_misfit_n=float(np.sqrt(np.mean((loop - float(loop @ cubic) / float(cubic @ cubic) * cubic) ** 2))),
        bound=bound,
        loading=loading,
        unloading=unloading,
        gain=gain,
        free_abc=(free @ mid) / scale,
    )


def _fit_stiffening_cubic(columns: Array, mid: Array, free: Array) -> tuple[Array, str | None]:
    """Best a, b, c (3,) of ``columns`` (m, 3) for forces ``mid`` (m,) with a, c >= 0 and b >= -sqrt(3 a c), and words
    for the bound they lie on; where ``free`` (3,), the unbounded best, obeys: that, and None.

    The set is convex, so the best point is the free one or lies on one of three faces.
    """
    a, b, c = free
    if a >= 0.0 and c >= 0.0 and (b >= 0.0 or b * b <= 3.0 * a * c):
        return free, None

    def inflected_cubic(s: float) -> Array:
        # stiffness a (x - s)^2, which just touches zero at depth s
        return np.array([1.0, -3.0 * s, 3.0 * s * s])

    def height(s: float) -> float:
        shape = columns @ inflected_cubic(s)
        return max(0.0, float(shape @ mid) / float(shape @ shape))

    def misfit(beta: Array) -> float:
        return float(np.sum((mid - columns @ beta) ** 2))

    candidates: list[tuple[float, Array, str]] = []
    for keep, words in (((1, 2), "a = 0"), ((0, 1), "c = 0")):
        beta = np.zeros(3)
        beta[list(keep)] = nnls(columns[:, keep], mid)[0]
        candidates.append((misfit(beta), beta, words))
    depths = np.concatenate([np.linspace(0.0, 2.0, 201), np.geomspace(2.02, 1e3, 200)])  # beyond: a straight line
    k = int(np.argmin([misfit(height(s) * inflected_cubic(s)) for s in depths]))
    s = float(
        minimize_scalar(
            lambda r: misfit(height(r) * inflected_cubic(r)),
            bounds=(depths[max(k - 1, 0)], depths[min(k + 1, 400)]),
            method="bounded",
            options={"xatol": RESOLVED},
        ).x
    )
    beta = height(s) * inflected_cubic(s)
    candidates.append((misfit(beta), beta, "stiffness zero at one depth"))
    _, beta, bound = min(candidates, key=lambda item: item[0])
    return beta, bound


@dataclass(frozen=True)
class Damping:
    """D with its standard uncertainty, s/m, and the depth ``at_m`` where loading and fit differ most."""

    d: float
    u_d: float
    at_m: float
    speed_m_per_s: float


def damping_factor(fit: FeltFit, speed_m_per_s: float, u_speed_m_per_s: float = 0.0) -> Damping:
    """Damping factor D, s/m, (thesis eq. 2.7): loading force over the cubic's, less 1, over the mean speed, m/s, at the
    depth where loading exceeds the cubic most; with its standard uncertainty.

    Parameters
    ----------
    fit : cubic and smoothed loading curve
    speed_m_per_s, u_speed_m_per_s : mean normal speed of the contact and its standard uncertainty

    Returns
    -------
    Damping
        D and its standard uncertainty, s/m.

    Raises
    ------
    InputError : the speed is not positive, or loading is nowhere above the fit

    Examples
    --------
    >>> import model
    >>> fit = model.calibration.fit_felt(model.calibration.read_curve("felt.csv"))
    >>> model.calibration.damping_factor(fit, speed_m_per_s=0.05).d > 0.0
    True
    """
    check_numbers("damping", {"mean normal speed": speed_m_per_s}, {"mean normal speed": u_speed_m_per_s}, "m/s")
    x, above = fit.mid_m, fit.loading.force_n(fit.mid_m) - fit.force_n(fit.mid_m)
    k = int(np.argmax(above))
    if above[k] <= 0.0 or x[k] <= 0.0:
        raise InputError(
            f"damping: loading minus fit found {above[k]:g} N at most, allowed above 0; are the phases swapped?"
        )
    ratio, u_ratio = fit.loading_ratio(float(x[k]))
    d = (ratio - 1.0) / speed_m_per_s
    return Damping(
        d=d,
        u_d=math.hypot(u_ratio / speed_m_per_s, d * u_speed_m_per_s / speed_m_per_s),
        at_m=float(x[k]),
        speed_m_per_s=speed_m_per_s,
    )
