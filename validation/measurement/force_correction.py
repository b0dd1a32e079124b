"""Quiet baseline, force correction and encoder zero of one trial.

Conventions: force positive downwards; sample i of the force was taken at ``time_s[i] - group_delay_s``, so
the delay moves the force's time axis and never its values; nothing is ever smoothed or resampled.
Source: docs/explanation/uncertainty.md and acquisition.md; mains hum in
`validation.measurement.mains_hum`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.files.time_table import two_columns
from validation.conventions import Array
from validation.errors import TrialError
from validation.measurement.mains_hum import HumFit, fit_hum

FIRST_BASELINE_S = 0.02
MINIMUM_QUIET_S = 0.02
MARGIN_S = 0.01
ONSET_SIGMA = 5.0
ONSET_SAMPLES = 5
ONSET_SHARE = 0.01
MOVED_COUNTS = 3
MOVED_SIGMA = 5.0


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


@dataclass(frozen=True)
class CorrectedForce:
    """The force on the key as the model must see it.

    ``time_s`` is when the force acted (group delay taken off); ``u_force_n`` the standard uncertainty of each
    sample: noise, offset, hum and preload; the gain's, ``channel.gain_relative_u``, is common to all samples and not
    part of it.
    """

    time_s: Array
    force_n: Array
    u_force_n: Array
    hum: HumFit
    noise_n: float
    channel: ForceChannel

    @property
    def preload_n(self) -> float:
        """Declared force of the resting arm, N."""
        return self.channel.preload_n

    @property
    def u_level_n(self) -> float:
        """Standard uncertainty common to all samples, of the preload and the fitted offset, N."""
        return float(np.hypot(self.channel.u_preload_n, self.hum.u_offset_n))


class ForceChannelValues(TypedDict, total=False):
    """Keywords of `correct_force`, see `ForceChannel`."""

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
    group_delay_s, u_group_delay_s : float
        Sample i was taken at ``time_s[i] - group_delay_s``, known with this standard uncertainty.
    preload_n, u_preload_n : float
        Declared force of the resting arm and its standard uncertainty.
    gain_relative_u : float
        Relative standard uncertainty of the calibration factor.
    mains_hz : float or None
        Nominal mains frequency; None tries 50 and 60 Hz.
    """

    group_delay_s: float = 0.0
    preload_n: float = 0.0
    u_preload_n: float = 0.0
    u_group_delay_s: float = 0.0
    gain_relative_u: float = 0.0
    mains_hz: float | None = None


def _refuse_lost(time: Array, force: Array) -> None:
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise TrialError("force: found times that are lost or do not increase, allowed finite ones that increase")
    lost = np.flatnonzero(~np.isfinite(force))
    if lost.size:
        raise TrialError(
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


def _force_onset(force: Array, first: int) -> int | None:
    """Sample at which the force leaves its first baseline, walked back to its last crossing of it.

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
    """Find the quiet baseline before the blow.

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
    TrialError
        When force samples are lost, times do not increase, less than 20 ms of baseline are left, or the force never
        leaves it.

    Examples
    --------
    >>> import rig, validation
    >>> trial = rig.Session.open("sessions/example_forte").trial(1).read()
    >>> print(f"{validation.find_quiet(trial.time_s, trial.force_n).onset_s:.2f} s")
    0.41 s
    """
    time, force = two_columns(time_s, force_n, "force")
    _refuse_lost(time, force)
    step = float(np.median(np.diff(time)))
    first = max(int(round(FIRST_BASELINE_S / step)), 8)
    if time.size <= 2 * first:
        raise TrialError(
            f"record of {1e3 * step * time.size:.0f} ms is too short; record at least 0.3 s before the blow"
        )
    onset = _force_onset(force, first)
    margin = int(round(MARGIN_S / step))
    need = int(round(MINIMUM_QUIET_S / step))
    if onset is not None and onset - margin >= 2 * first:
        hum = fit_hum(time[: onset - margin], force[: onset - margin], mains_hz)
        clean = force - hum.baseline_n(time)
        onset = _force_onset(clean, onset - margin)
    if onset is None:
        raise TrialError("force never leaves its baseline by 5 sigma; was the blow played? check motor and load cell")
    moved = onset
    if encoder_count is not None:
        counts = as_numbers(encoder_count, "encoder counts", 2)
        if len(counts) != time.size:
            raise TrialError(f"encoder counts: found {len(counts)} rows, allowed {time.size}, one for each sample")
        jitter = MOVED_SIGMA * counts[:first].std(axis=0)
        away = np.abs(counts - np.median(counts[:first], axis=0)) > np.maximum(MOVED_COUNTS, jitter)
        hit = first_run(away.any(axis=1), ONSET_SAMPLES)
        moved = onset if hit is None else min(onset, hit)
    stop = moved - margin
    if stop < need:
        raise TrialError(
            f"quiet baseline is {1e3 * max(stop, 0) * step:.0f} ms long; at least "
            f"{1e3 * MINIMUM_QUIET_S:.0f} ms are needed to find the force offset; "
            "record a longer rest before the blow"
        )
    return Quiet(stop, float(time[0]), float(time[stop - 1]), float(time[onset]) - group_delay_s)


def correct_force(
    time_s: ArrayLike, force_n: ArrayLike, quiet: Quiet, **declared: Unpack[ForceChannelValues]
) -> CorrectedForce:
    """Correct a calibrated force for offset, mains hum and channel delay; never smooth it.

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
    TrialError
        When force samples are lost (NaN), or times do not increase.

    Examples
    --------
    >>> import rig, validation
    >>> trial = rig.Session.open("sessions/example_forte").trial(1).read()
    >>> quiet = validation.find_quiet(trial.time_s, trial.force_n)
    >>> corrected = validation.correct_force(trial.time_s, trial.force_n, quiet, preload_n=0.05)
    >>> print(f"{corrected.force_n.max():.0f} N")
    33 N
    """
    channel = ForceChannel(**declared)
    time, force = two_columns(time_s, force_n, "force")
    _refuse_lost(time, force)
    hum = fit_hum(time[: quiet.stop], force[: quiet.stop], channel.mains_hz)
    corrected = force - hum.baseline_n(time) + channel.preload_n
    noise = hum.residual_after_n if hum.accepted else hum.residual_before_n
    slope = np.gradient(corrected, time)
    u_delay = slope * channel.u_group_delay_s
    u = np.sqrt(noise**2 + hum.u_baseline_n(time) ** 2 + channel.u_preload_n**2 + u_delay**2)
    return CorrectedForce(time - channel.group_delay_s, corrected, u, hum, noise, channel)


def encoder_change(angle_rad: Array, quiet: Quiet, resolution_rad: Array) -> tuple[Array, Array, Array]:
    """Angles since rest and their standard uncertainties.

    Zero is the mean over the quiet interval.  The uncertainty holds the quantisation of the sample, the
    quantisation left in the zero (an encoder that stands still repeats the same rounding error) and the
    jitter seen while nothing moves.

    Parameters
    ----------
    angle_rad : (n, m) array
    quiet : Quiet
    resolution_rad : (m,) array
        One count.

    Returns
    -------
    change_rad : (n, m) array
    u_rad : (m,) array
        Standard uncertainty of one sample against its neighbours.
    u_zero_rad : (m,) array
        Standard uncertainty of the zero, common to all samples.
    """
    angle = np.asarray(angle_rad, dtype=float)
    still = angle[: quiet.stop]
    jitter = still.std(axis=0, ddof=1)
    quantisation = np.asarray(resolution_rad, dtype=float) / np.sqrt(12.0)
    return angle - still.mean(axis=0), np.hypot(quantisation, jitter), quantisation
