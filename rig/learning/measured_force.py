"""The force of a blow as it was measured, on the clock of its target, and how far it is from that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.learning.target_force import TargetForce, find_key_bottom
from rig.mains_hum import fit_mains_hum
from rig.session.trial_data import TrialData

LATE_S = 0.0015  # before key bottom; a message names the share of the error that lies there


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured blow: force on the target's clock, N, and its key bottom, s (None: none found)."""

    force_n: NDArray[np.float64]
    bottom_s: float | None


def measured_force(data: TrialData, target: TargetForce, start_s: float) -> Measured:
    """Return a trial's force above rest, N, without mains hum, at the target's times, and when its key bottom is, s
    (None: not found); the target's time zero was put out at ``start_s`` of the trial.

    Resting force and mains hum, fitted to the time before the blow, are subtracted; the channel's delay and the sample
    between output and input are taken back.
    """
    force = data.raw_force_n - _resting(data)
    rate = data.sample_rate_hz
    at_s = start_s + target.time_s + data.force_info.group_delay_s + 1.0 / rate
    on_clock = np.interp(at_s, data.time_s, force)
    bottom = find_key_bottom(on_clock, rate)
    return Measured(on_clock, None if bottom is None else bottom / rate)


def _resting(data: TrialData) -> NDArray[np.float64]:
    mains_hz = np.array([data.force_info.mains_frequency_hz])
    fit = fit_mains_hum(data.time_s, data.raw_force_n, data.time_s < data.blow_start_s, mains_hz)
    return fit.rest + fit.hum


def window(target: TargetForce, measured: Measured) -> NDArray[np.bool_]:
    end_s = target.bottom_s if measured.bottom_s is None else min(target.bottom_s, measured.bottom_s)
    return (target.time_s >= target.onset_s) & (target.time_s <= end_s)


def relative_rms(target: TargetForce, measured: Measured) -> float:
    """RMS of target less measured force before key bottom, relative to the target's peak there."""
    inside = window(target, measured)
    if not inside.any():
        return float("inf")
    error = target.force_n[inside] - measured.force_n[inside]
    return float(np.sqrt(np.mean(error**2))) / target.peak_n


def late_share(target: TargetForce, measured: Measured) -> float:
    """Fraction of the squared error before key bottom that lies in its last `LATE_S`."""
    inside = window(target, measured)
    squared = np.where(inside, (target.force_n - measured.force_n) ** 2, 0.0)
    end_s = target.time_s[inside][-1] if inside.any() else 0.0
    return float(squared[target.time_s > end_s - LATE_S].sum() / max(squared.sum(), 1e-30))
