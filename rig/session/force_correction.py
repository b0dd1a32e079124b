"""Corrected force of one trial: quiet baseline, offset, mains hum, preload and delay of the load cell.

Conventions: force positive downwards; sample i of the force was taken at ``time_s[i] - group_delay_s``, so the delay
moves the force's time axis and never its values; nothing is ever smoothed or resampled. Source:
docs/explanation/uncertainty.md and acquisition.md. Mains hum of a force is subtracted where it helps
(`fit_hum`); of a position whose mains are declared whatever it gains (`rig.mains_hum`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.special import fdtri

from rig.arrays import as_numbers
from rig.errors import RigInputError
from rig.keywords import make_options
from rig.mains_hum import HARMONICS, SEARCH_HZ, hum_terms
from rig.tabular import Tabular

Array = NDArray[np.float64]

GRID = 17  # frequencies from which the least residual is refined: 0.025 Hz apart, below 1 over any baseline
SEARCH_BASELINE_S = 0.2  # ten periods of 50 Hz; a shorter baseline takes the nominal frequency
MAINS_HZ = (50.0, 60.0)  # nominal frequencies of public grids
TOO_SHORT = "baseline of"  # how the reason begins when hum could not be looked for
REFUSAL_P = 1e-3  # probability with which a baseline without hum passes the variance test
MOST_CORRELATION = 0.98  # of neighbouring samples: choice; a baseline that drifts has one mean in 99 samples then


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
        """Offset and, where the hum was accepted, its three sinusoids at times (n,), s on the clock of the fit: what is
        subtracted from the raw force, N, (n,)."""
        time = np.asarray(time_s, dtype=float)
        out = np.full(time.shape, self.offset_n)
        if self.accepted:
            for k, (a, phase) in enumerate(zip(self.amplitude_n, self.phase_rad, strict=True), start=1):
                out += a * np.cos(2 * np.pi * k * self.frequency_hz * time + phase)
        return out

    def u_baseline_n(self, time_s: Array) -> Array:
        """Standard uncertainty of `baseline_n` at times (n,), s: N, (n,); where the hum's frequency was fitted too, it
        grows away from the baseline."""
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
    return np.column_stack([np.ones(time.shape), hum_terms(time, frequency_hz)])


def _fit_at_frequency(time: Array, force: Array, frequency_hz: float) -> tuple[Array, float]:
    """Coefficients and residual sum of squares at a fixed frequency."""
    design = _design(time, frequency_hz)
    # seven nearly orthogonal columns: the normal equations are well conditioned and cheap
    coefficient = np.linalg.solve(design.T @ design, design.T @ force)
    return np.asarray(coefficient, dtype=float), float(np.sum((force - design @ coefficient) ** 2))


def _search_frequency(time: Array, force: Array, centre_hz: float) -> float:
    """Frequency, Hz, within `SEARCH_HZ` of ``centre_hz``, at which offset and hum of three harmonics fit a force (n,),
    N, best by least squares; ``time``: (n,), s, about its middle."""
    grid = np.linspace(centre_hz - SEARCH_HZ, centre_hz + SEARCH_HZ, GRID)
    cost = [_fit_at_frequency(time, force, f)[1] for f in grid]
    best = int(np.argmin(cost))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    return float(
        minimize_scalar(lambda f: _fit_at_frequency(time, force, f)[1], bounds=(low, high), method="bounded").x
    )


def correlation_inflation(residual: Array) -> float:
    """Factor, from 1 on, by which the variance of a mean grows when neighbouring residuals (n,) are correlated, by
    first-order autoregression; 1 for fewer than three.

    For a first-order autoregressive noise of lag-one correlation ρ the variance of a mean is (1 + ρ)/(1 − ρ)
    times that of independent samples; an anti-alias filter makes ρ > 0.
    """
    r = residual - residual.mean()
    power = float(r @ r)
    if power == 0.0 or r.size < 3:
        return 1.0
    rho = float(np.clip(float(r[1:] @ r[:-1]) / power, 0.0, MOST_CORRELATION))
    return (1 + rho) / (1 - rho)


def fit_hum(time_s: Array, force_n: Array, mains_hz: float | None = None) -> HumFit:
    """Fit a constant offset and three harmonics of mains hum to a quiet baseline; the hum is kept (``accepted``) only
    where it lowers the residual significantly, else the fit is the mean alone, with a reason. Nothing is subtracted
    here.

    The peak of the blow is never filtered: the sinusoids are subtracted as they were found, so a trial without hum
    passes through unchanged. A baseline shorter than two mains periods gets an offset only, and the result states the
    reason. Conventions: force in N, positive downwards; phase is that of a cosine at time 0 of the DAQ clock. Source:
    ordinary least squares of offset + sin/cos at 1, 2, 3 × mains; the frequency is a free parameter only on baselines
    of at least 0.2 s. A notch run forwards and backwards changes the peak by up to newtons, which is why none is used.

    Parameters
    ----------
    time_s, force_n : (n,), the quiet baseline only, in s and N
    mains_hz : nominal mains frequency.  50 and 60 Hz are tried beside it, and the best one kept: hum may come from
        elsewhere than the mains the rig file declares.

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
        polar = _amplitudes_and_phases(np.zeros(2 * HARMONICS + 1) if coefficient is None else coefficient)
        return HumFit(offset, float(u_mean), f, searched, *polar, before, after, False, reason, np.zeros((0, 0)))

    declared = min(nominal) if mains_hz is None else mains_hz
    if length < 2.0 / declared:
        reason = f"{TOO_SHORT} {1e3 * length:.0f} ms is shorter than two periods of {declared:g} Hz"
        return refused(reason, declared, None, before, False)
    nominal = tuple(f for f in nominal if length >= 2.0 / f)

    searched = length >= SEARCH_BASELINE_S * (1 - 1e-9)
    middle = time.mean()  # fitting about the middle keeps frequency and phase uncorrelated
    candidates = [_search_frequency(time - middle, force, f) if searched else f for f in nominal]
    frequency = min(candidates, key=lambda f: _fit_at_frequency(time - middle, force, f)[1])
    coefficient, cost = _fit_at_frequency(time - middle, force, frequency)
    parameters = coefficient.size + (1 if searched else 0)
    after = float(np.sqrt(cost / (n - parameters)))

    reason = _reason_to_refuse(time - middle, force, frequency, before, after, parameters)
    if reason:
        return refused(reason, frequency, coefficient, after, searched)

    coefficient = _shift_origin(coefficient, frequency, float(middle))
    polar = _amplitudes_and_phases(coefficient)
    fit = HumFit(
        float(coefficient[0]), 0.0, frequency, searched, *polar, before, after, True, "", covariance=np.zeros((0, 0))
    )
    columns = _design(time, frequency)
    if searched:
        columns = np.column_stack([columns, fit._frequency_column(time)])
    inflation = correlation_inflation(force - fit.baseline_n(time))
    covariance = np.asarray(np.linalg.pinv(columns.T @ columns) * after**2 * inflation, dtype=float)
    return replace(fit, u_offset_n=float(np.sqrt(covariance[0, 0])), covariance=covariance)


def _reason_to_refuse(time: Array, force: Array, f: float, before: float, after: float, parameters: int) -> str:
    """Why hum at ``f``, Hz, must not be subtracted from a baseline, empty where it may; ``before``, ``after``: residual
    standard deviation, N, without and with it; ``parameters``: how many the fit with hum has."""
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
    coefficient, _ = _fit_at_frequency(time[:cut], force[:cut], f)
    ahead = force[cut:] - _design(time[cut:], f) @ coefficient
    plain = force[cut:] - force[:cut].mean()
    if np.sqrt(np.mean(ahead**2)) >= np.sqrt(np.mean(plain**2)):
        return "hum fitted on the first two thirds of the baseline does not predict the last third"
    return ""


def _shift_origin(coefficient: Array, frequency_hz: float, middle_s: float) -> Array:
    """Coefficients (7,) of 1 and of cosine, sine at one, two, three times ``frequency_hz`` for time counted from 0,
    from those for time counted from ``middle_s``."""
    out = coefficient.copy()
    for k in range(1, HARMONICS + 1):
        c, s = coefficient[2 * k - 1], coefficient[2 * k]
        turn = 2 * np.pi * k * frequency_hz * middle_s
        out[2 * k - 1] = c * np.cos(turn) - s * np.sin(turn)
        out[2 * k] = c * np.sin(turn) + s * np.cos(turn)
    return out


def _amplitudes_and_phases(coefficient: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    c, s = coefficient[1::2], coefficient[2::2]
    return tuple(float(v) for v in np.hypot(c, s)), tuple(float(v) for v in np.arctan2(-s, c))


MINIMUM_QUIET_S = 0.02  # one period of 50 Hz: a shorter mean holds a part of the hum
MARGIN_S = 0.01  # kept before the onset, which is found only when the force is above its noise
ONSET_SIGMA = 5.0  # standard deviations of noise that force or encoder leaves its level by: 6e-7 a sample, if normal
FIRST_SAMPLES = 8  # from which a first level and its scatter are taken at least: the scatter is known to a quarter
ONSET_SAMPLES = 5  # successive ones, so that a spike on a wire is no onset
ONSET_SHARE = 0.01  # of the largest excursion: below it lie drift and what is left of hum
MOVED_COUNTS = 3  # a resting encoder may flicker between neighbouring counts


@dataclass(frozen=True)
class Quiet:
    """The baseline before the blow: samples ``[0, stop)``; `onset_s` is when the force began to act."""

    stop: int
    start_s: float
    end_s: float
    onset_s: float

    @property
    def length_s(self) -> float:
        """Length of the baseline, s."""
        return self.end_s - self.start_s


@dataclass(frozen=True, repr=False)
class CorrectedForce(Tabular):
    """The force on the key as it acted.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        When the force acted, s: sample times less the group delay.
    force_n : ndarray, shape (n,)
        Force, N, positive downwards, offset and hum taken off, preload included.
    u_force_n : ndarray, shape (n,)
        Standard uncertainty of a sample: noise, offset, hum, preload and delay. That of the gain,
        ``channel.gain_relative_u``, is common to all samples and not part of it.
    quiet : Quiet
        Baseline on which offset and hum were fitted.
    hum : HumFit
    noise_n : float
        Standard deviation of the baseline after the fit, N.
    channel : ForceChannel
        What is declared of the channel.
    """

    time_s: Array
    force_n: Array
    u_force_n: Array
    quiet: Quiet
    hum: HumFit
    noise_n: float
    channel: ForceChannel

    def __repr__(self) -> str:
        largest = int(self.force_n.argmax())
        peak = f"largest {self.force_n[largest]:.2f} N at {self.time_s[largest]:.4f} s"
        return f"<CorrectedForce: {self.time_s.size} samples, {peak}, offset taken off {self.hum.offset_n:.3f} N>"

    @property
    def preload_n(self) -> float:
        """Declared force of the resting arm, N."""
        return self.channel.preload_n

    def columns(self) -> dict[str, Array]:
        """Columns by name: time, force and its standard uncertainty."""
        return {"time_s": self.time_s, "force_n": self.force_n, "u_force_n": self.u_force_n}

    def _names_to_plot(self) -> list[str]:
        return ["force_n"]


class ForceChannelValues(TypedDict, total=False):
    group_delay_s: float
    preload_n: float
    u_preload_n: float
    u_group_delay_s: float
    gain_relative_u: float
    mains_hz: float | None


@dataclass(frozen=True)
class ForceChannel:
    """What is declared of the force channel.

    Parameters
    ----------
    group_delay_s, u_group_delay_s : sample i was taken at ``time_s[i] - group_delay_s``, known with this standard
        uncertainty
    preload_n, u_preload_n : declared force of the resting arm and its standard uncertainty
    gain_relative_u : relative standard uncertainty of the calibration factor
    mains_hz : nominal mains frequency; None tries 50 and 60 Hz
    """

    group_delay_s: float = 0.0
    preload_n: float = 0.0
    u_preload_n: float = 0.0
    u_group_delay_s: float = 0.0
    gain_relative_u: float = 0.0
    mains_hz: float | None = None


def _two_columns(time_s: ArrayLike, force_n: ArrayLike) -> tuple[Array, Array]:
    times, force = as_numbers(time_s, "force: time_s"), as_numbers(force_n, "force")
    if times.ndim != 1 or times.shape != force.shape:
        raise RigInputError(f"force: found shapes {times.shape} and {force.shape}, allowed two equal columns")
    return times, force


def _refuse_lost(time: Array, force: Array) -> None:
    """Raise RigInputError for times (n,), s, that do not increase, or forces (n,), N, that are not finite."""
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise RigInputError("force: found times that are lost or do not increase, allowed finite ones that increase")
    lost = np.flatnonzero(~np.isfinite(force))
    if lost.size:
        raise RigInputError(
            f"force: {lost.size} lost samples, the first at {time[lost[0]]:.4f} s; the model needs every sample; "
            "reject the trial or record it again"
        )


def first_run(mask: NDArray[np.bool_], length: int) -> int | None:
    """Index of the first of `length` successive True values."""
    if mask.size < length:
        return None
    runs = np.convolve(mask.astype(np.int64), np.ones(length, dtype=np.int64), mode="valid")
    hits = np.flatnonzero(runs == length)
    return int(hits[0]) if hits.size else None


def _find_force_onset(force: Array, first: int) -> int | None:
    """Index of the sample at which the force (n,), N, leaves the mean of its ``first`` samples, up or down, for five
    samples in a row, walked back to its last crossing of that mean; None where it never leaves.

    It has left when it is 5 σ away, and at least a hundredth of its largest excursion, so that a slow drift is no blow.
    """
    centre = float(np.mean(force[:first]))
    sigma = float(np.std(force[:first], ddof=1))
    excursion = np.abs(force - centre)
    away = excursion > max(ONSET_SIGMA * sigma, ONSET_SHARE * float(excursion.max()), 1e-9)
    onset = first_run(away, ONSET_SAMPLES)
    if onset is None:
        return None
    side = np.sign(force[onset] - centre)
    back = np.flatnonzero(side * (force[: onset + 1] - centre) <= 0)
    return int(back[-1]) if back.size else 0


def find_quiet(
    time_s: ArrayLike,
    force_n: ArrayLike,
    encoder_count: ArrayLike | None = None,
    *,
    mains_hz: float | None = None,
    group_delay_s: float = 0.0,
) -> Quiet:
    """Find the samples of rest before the blow, from the first to 10 ms before force or encoders move, and the time of
    the force's onset; RigInputError for less than 20 ms of them, or a force that never leaves its rest.

    The force leaves its baseline when it is 5 σ away for five samples; hum is fitted on a first baseline and
    taken off before the onset is looked for again.  An encoder that moves by more than three counts, and
    5 σ of its jitter, also ends the baseline.  A margin of 10 ms is kept.

    Parameters
    ----------
    time_s, force_n : (n,) arrays
    encoder_count : (n, m) array of int, optional
    mains_hz : float or None
        Nominal mains frequency; None tries 50 and 60 Hz.
    group_delay_s : float
        Delay of the force channel; the onset is given at the time the force acted.

    Returns
    -------
    Quiet

    Raises
    ------
    RigInputError
        When force samples are lost, times do not increase, less than 20 ms of baseline are left, or the force never
        leaves it.

    Examples
    --------
    >>> import rig
    >>> trial = rig.Session.open("sessions/example_forte").trial(1).read()
    >>> print(f"{rig.find_quiet(trial.time_s, trial.raw_force_n).onset_s:.2f} s")
    0.41 s
    """
    time, force = _two_columns(time_s, force_n)
    _refuse_lost(time, force)
    step = float(np.median(np.diff(time)))
    first = max(int(round(MINIMUM_QUIET_S / step)), FIRST_SAMPLES)
    if time.size <= 2 * first:
        raise RigInputError(
            f"record of {1e3 * step * time.size:.0f} ms is too short; record at least 0.3 s before the blow"
        )
    onset = _find_force_onset(force, first)
    margin = int(round(MARGIN_S / step))
    if onset is not None and onset - margin >= 2 * first:
        hum = fit_hum(time[: onset - margin], force[: onset - margin], mains_hz)
        clean = force - hum.baseline_n(time)
        onset = _find_force_onset(clean, onset - margin)
    if onset is None:
        raise RigInputError(
            "force never leaves its baseline by 5 sigma; was the blow played? check motor and load cell"
        )
    first_change = onset
    if encoder_count is not None:
        counts = as_numbers(encoder_count, "encoder counts", 2)
        if len(counts) != time.size:
            raise RigInputError(f"encoder counts: found {len(counts)} rows, allowed {time.size}, one for each sample")
        hit = _find_first_move(counts, first)
        first_change = onset if hit is None else min(onset, hit)
    return _quiet_before(
        time, first_change, float(time[onset]) - group_delay_s, "quiet baseline is", "to find the force offset"
    )


def quiet_of_motion(time_s: Array, encoder_count: NDArray[np.int64]) -> Quiet:
    step = float(np.median(np.diff(time_s)))
    first_change = _find_first_move(encoder_count, max(round(MINIMUM_QUIET_S / step), FIRST_SAMPLES))
    if first_change is None:
        raise RigInputError("no encoder moves by more than three counts; was the blow played?")
    return _quiet_before(time_s, first_change, float(time_s[first_change]), "encoders rest for", "before the blow")


def _find_first_move(counts: NDArray[Any], first: int) -> int | None:
    """Sample from which an encoder has left the place of its first samples."""
    start = counts[:first]
    away = np.abs(counts - np.median(start, axis=0)) > np.maximum(MOVED_COUNTS, ONSET_SIGMA * start.std(axis=0))
    return first_run(away.any(axis=1), ONSET_SAMPLES)


def _quiet_before(time: Array, first_change: int, onset_s: float, what: str, needed: str) -> Quiet:
    """The baseline from the first sample to 10 ms before the sample ``first_change``, with ``onset_s`` as stated;
    RigInputError, worded by ``what`` and ``needed``, where less than 20 ms are left."""
    step = float(np.median(np.diff(time)))
    stop = first_change - round(MARGIN_S / step)
    if stop < round(MINIMUM_QUIET_S / step):
        raise RigInputError(
            f"{what} {1e3 * max(stop, 0) * step:.0f} ms; at least {1e3 * MINIMUM_QUIET_S:.0f} ms are "
            f"needed {needed}; record a longer rest, with readings that do not drift"
        )
    return Quiet(stop, float(time[0]), float(time[stop - 1]), onset_s)


def correct_force(
    time_s: ArrayLike, force_n: ArrayLike, quiet: Quiet, **declared: Unpack[ForceChannelValues]
) -> CorrectedForce:
    """Subtract offset and mains hum, fitted on the baseline, from a calibrated force, add the declared preload, and
    shift the times back by the channel's delay; nothing is smoothed.

    Corrected force = force − (fitted offset and hum) + declared preload: the arm already rests on the key
    with its preload during the baseline, so the baseline is the preload and not zero.

    Parameters
    ----------
    time_s, force_n : (n,) arrays
        DAQ time, s, and calibrated force, N.
    quiet : Quiet
        The baseline, from `find_quiet`.
    **declared
        What is declared of the force channel: the fields of `ForceChannel`.

    Returns
    -------
    CorrectedForce
        Times at which the force acted, force and standard uncertainty, (n,) each.

    Raises
    ------
    RigInputError
        When force samples are lost (NaN), or times do not increase.

    Examples
    --------
    >>> import rig
    >>> trial = rig.Session.open("sessions/example_forte").trial(1).read()
    >>> quiet = rig.find_quiet(trial.time_s, trial.raw_force_n)
    >>> corrected = rig.correct_force(trial.time_s, trial.raw_force_n, quiet, preload_n=0.05)
    >>> print(f"{corrected.force_n.max():.0f} N")
    33 N
    """
    channel = make_options(ForceChannel, "rig.correct_force", declared)
    time, force = _two_columns(time_s, force_n)
    _refuse_lost(time, force)
    hum = fit_hum(time[: quiet.stop], force[: quiet.stop], channel.mains_hz)
    corrected = force - hum.baseline_n(time) + channel.preload_n
    noise = hum.residual_after_n if hum.accepted else hum.residual_before_n
    slope = np.gradient(corrected, time)
    u_delay = slope * channel.u_group_delay_s
    u = np.sqrt(noise**2 + hum.u_baseline_n(time) ** 2 + channel.u_preload_n**2 + u_delay**2)
    return CorrectedForce(time - channel.group_delay_s, corrected, u, quiet, hum, noise, channel)
