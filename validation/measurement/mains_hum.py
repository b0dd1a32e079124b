"""Mains hum on the load cell: fitted on the quiet baseline, subtracted over the whole trial, unless it does not help.

The peak of the blow is never filtered: the sinusoids are subtracted as they were found, so a trial without hum passes
through unchanged. A baseline shorter than two mains periods gets an offset only, and the result states the reason.
Conventions: force in N, positive downwards; phase is that of a cosine at time 0 of the DAQ clock.
Source: ordinary least squares of offset + sin/cos at 1, 2, 3 × mains; the frequency is a free parameter only
on baselines of at least 0.2 s. A notch run forwards and backwards changes the peak by up to newtons, which
is why none is used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import fdtri

from validation.conventions import Array

HARMONICS = 3
SEARCH_HZ = 0.2
SEARCH_BASELINE_S = 0.2
MAINS_HZ = (50.0, 60.0)
TOO_SHORT = "baseline of"  # how the reason begins when hum could not be looked for
# probability with which a baseline without hum would pass the variance test
REFUSAL_P = 1e-3


@dataclass(frozen=True)
class HumFit:
    """What was found on the quiet baseline.

    ``amplitude_n`` and ``phase_rad`` are those of the 1st, 2nd and 3rd harmonic as fitted, also when
    `accepted` is False (then nothing but the offset is subtracted).  ``residual_before_n`` and
    ``residual_after_n`` are standard deviations of the baseline without and with the sinusoids, both
    corrected for the number of fitted parameters.
    """

    offset_n: float
    u_offset_n: float
    frequency_hz: float
    frequency_searched: bool
    amplitude_n: tuple[float, ...]
    phase_rad: tuple[float, ...]
    residual_before_n: float
    residual_after_n: float
    accepted: bool
    reason: str
    covariance: Array

    def baseline_n(self, time_s: Array) -> Array:
        """What is subtracted from the raw force: the offset and, when accepted, the sinusoids, N."""
        time = np.asarray(time_s, dtype=float)
        out = np.full(time.shape, self.offset_n)
        if self.accepted:
            for k, (a, phase) in enumerate(zip(self.amplitude_n, self.phase_rad, strict=True), start=1):
                out += a * np.cos(2 * np.pi * k * self.frequency_hz * time + phase)
        return out

    def u_baseline_n(self, time_s: Array) -> Array:
        """Standard uncertainty of `baseline_n`, N; grows away from the baseline if f was searched."""
        time = np.asarray(time_s, dtype=float)
        if not self.accepted:
            return np.full(time.shape, self.u_offset_n)
        columns = _design(time, self.frequency_hz)
        if self.frequency_searched:
            columns = np.column_stack([columns, self._frequency_column(time)])
        return np.sqrt(np.einsum("ij,jk,ik->i", columns, self.covariance, columns))

    def _frequency_column(self, time: Array) -> Array:
        column = np.zeros(time.shape)
        for k, (a, phase) in enumerate(zip(self.amplitude_n, self.phase_rad, strict=True), start=1):
            column -= a * 2 * np.pi * k * time * np.sin(2 * np.pi * k * self.frequency_hz * time + phase)
        return column


def _design(time: Array, frequency_hz: float) -> Array:
    turn = 2 * np.pi * frequency_hz * time
    first = np.cos(turn) + 1j * np.sin(turn)
    columns, harmonic = [np.ones(time.shape)], first
    for k in range(1, HARMONICS + 1):  # by products: sines cost most of a trial's correction
        columns += [harmonic.real, harmonic.imag]
        harmonic = harmonic * first if k < HARMONICS else harmonic
    return np.column_stack(columns)


def _solve(time: Array, force: Array, frequency_hz: float) -> tuple[Array, float]:
    """Coefficients and residual sum of squares at a fixed frequency."""
    design = _design(time, frequency_hz)
    # seven nearly orthogonal columns: the normal equations are well conditioned and cheap
    coefficient = np.linalg.solve(design.T @ design, design.T @ force)
    return np.asarray(coefficient, dtype=float), float(np.sum((force - design @ coefficient) ** 2))


def _search(time: Array, force: Array, centre_hz: float) -> float:
    """Frequency of least residual within ± SEARCH_HZ of the nominal one."""
    grid = np.linspace(centre_hz - SEARCH_HZ, centre_hz + SEARCH_HZ, 17)
    cost = [_solve(time, force, f)[1] for f in grid]
    best = int(np.argmin(cost))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(
        lambda f: _solve(time, force, f)[1], bounds=(low, high), method="bounded", options={"xatol": 1e-7}
    )
    return float(found.x)


def correlation_inflation(residual: Array) -> float:
    """Factor ≥ 1 on the variance of a mean when neighbouring residuals are correlated (first-order model).

    For a first-order autoregressive noise of lag-one correlation ρ the variance of a mean is (1 + ρ)/(1 − ρ)
    times that of independent samples; an anti-alias filter makes ρ > 0.
    """
    r = residual - residual.mean()
    power = float(r @ r)
    if power == 0.0 or r.size < 3:
        return 1.0
    rho = float(np.clip(float(r[1:] @ r[:-1]) / power, 0.0, 0.98))
    return (1 + rho) / (1 - rho)


def fit_hum(time_s: Array, force_n: Array, mains_hz: float | None = None) -> HumFit:
    """Fit offset and mains hum on a quiet baseline.

    Parameters
    ----------
    time_s, force_n : (n,) arrays
        The quiet baseline only, in s and N.
    mains_hz : float or None
        Nominal mains frequency.  50 and 60 Hz are tried beside it, and the best one kept: hum may come from elsewhere
        than the mains the rig file declares.

    Returns
    -------
    HumFit
        ``accepted`` is False, with a reason, when the baseline is shorter than two periods, or when the
        sinusoids do not lower the baseline's residual: by an F test, and on the last third of the baseline
        fitted from the first two.
    """
    time, force = np.asarray(time_s, dtype=float), np.asarray(force_n, dtype=float)
    n = time.size
    step = (time[-1] - time[0]) / (n - 1)
    length = n * step
    nominal = MAINS_HZ if mains_hz is None else tuple(sorted({mains_hz, *MAINS_HZ}))
    offset = float(force.mean())
    before = float(force.std(ddof=1))
    u_mean = before * np.sqrt(correlation_inflation(force) / n)

    def refused(reason: str, f: float, coefficient: Array | None, after: float, searched: bool) -> HumFit:
        polar = _polar(np.zeros(2 * HARMONICS + 1) if coefficient is None else coefficient)
        return HumFit(offset, float(u_mean), f, searched, *polar, before, after, False, reason, np.zeros((0, 0)))

    declared = min(nominal) if mains_hz is None else mains_hz
    if length < 2.0 / declared:
        reason = f"{TOO_SHORT} {1e3 * length:.0f} ms is shorter than two periods of {declared:g} Hz"
        return refused(reason, declared, None, before, False)
    nominal = tuple(f for f in nominal if length >= 2.0 / f)

    searched = length >= SEARCH_BASELINE_S * (1 - 1e-9)
    middle = time.mean()  # fitting about the middle keeps frequency and phase uncorrelated
    candidates = [_search(time - middle, force, f) if searched else f for f in nominal]
    frequency = min(candidates, key=lambda f: _solve(time - middle, force, f)[1])
    coefficient, cost = _solve(time - middle, force, frequency)
    parameters = coefficient.size + (1 if searched else 0)
    after = float(np.sqrt(cost / (n - parameters)))

    reason = _refusal(time - middle, force, frequency, before, after, parameters)
    if reason:
        return refused(reason, frequency, coefficient, after, searched)

    coefficient = _shift(coefficient, frequency, float(middle))
    polar = _polar(coefficient)
    fit = HumFit(
        float(coefficient[0]), 0.0, frequency, searched, *polar, before, after, True, "", covariance=np.zeros((0, 0))
    )
    columns = _design(time, frequency)
    if searched:
        columns = np.column_stack([columns, fit._frequency_column(time)])
    inflation = correlation_inflation(force - fit.baseline_n(time))
    covariance = np.asarray(np.linalg.pinv(columns.T @ columns) * after**2 * inflation, dtype=float)
    return replace(fit, u_offset_n=float(np.sqrt(covariance[0, 0])), covariance=covariance)


def _refusal(time: Array, force: Array, f: float, before: float, after: float, parameters: int) -> str:
    """Why the sinusoids must not be subtracted, or an empty string."""
    n = time.size
    gained = before**2 * (n - 1) - after**2 * (n - parameters)
    if after == 0.0:
        return "" if gained > 0 else "the baseline is constant: there is no hum to remove"
    ratio = gained / (parameters - 1) / after**2
    limit = float(fdtri(parameters - 1, n - parameters, 1 - REFUSAL_P))
    if ratio < limit:
        return f"hum does not lower the baseline residual ({before:.4g} N before, {after:.4g} N after)"
    cut = 2 * n // 3
    if cut * (time[-1] - time[0]) / (n - 1) < 1.0 / f:  # too short to hold a third back
        return ""
    coefficient, _ = _solve(time[:cut], force[:cut], f)
    ahead = force[cut:] - _design(time[cut:], f) @ coefficient
    plain = force[cut:] - force[:cut].mean()
    if np.sqrt(np.mean(ahead**2)) >= np.sqrt(np.mean(plain**2)):
        return "hum fitted on the first two thirds of the baseline does not predict the last third"
    return ""


def _shift(coefficient: Array, frequency_hz: float, middle_s: float) -> Array:
    """Coefficients for time from 0 instead of from the middle of the baseline."""
    out = coefficient.copy()
    for k in range(1, HARMONICS + 1):
        c, s = coefficient[2 * k - 1], coefficient[2 * k]
        turn = 2 * np.pi * k * frequency_hz * middle_s
        out[2 * k - 1] = c * np.cos(turn) - s * np.sin(turn)
        out[2 * k] = c * np.sin(turn) + s * np.cos(turn)
    return out


def _polar(coefficient: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Amplitude and phase of ``a cos(ωt + φ)`` from cosine and sine coefficients."""
    c, s = coefficient[1::2], coefficient[2::2]
    return tuple(float(v) for v in np.hypot(c, s)), tuple(float(v) for v in np.arctan2(-s, c))
