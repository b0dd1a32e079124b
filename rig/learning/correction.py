"""One step of learning: the measured force is compared with the target, and the command corrected.

Iterative learning control with a first-order law, u' = Q(u + gain · e): e is target less measured force, taken where
the command of the same instant is felt (the force channel's delay and the sample from output to input are taken
back); Q is a zero-phase low-pass, below the resonance of arm and load cell. Nothing is learned after the earlier of
the two key bottoms: the last correction fades there. Conventions: force in N, positive downwards; arrays on the sample
clock from the start of the profile. Law and convergence: Bristow, Tharayil & Alleyne, IEEE Control Systems 26 (2006).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from rig.learning.target import TargetForce, key_bottom
from rig.session.trial_data import TrialData

CUTOFF_HZ = 150.0
FADE_S = 0.01
HARMONICS = (1, 2, 3)
LATE_S = 0.0015
GUARD_S = 0.001
"""Learning ends this long before key bottom: a zero-phase filter spreads the spike backwards."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured blow: force on the target's clock, N, and its key bottom, s (None: none found)."""

    force_n: NDArray[np.float64]
    bottom_s: float | None


def measured_force(data: TrialData, target: TargetForce, start_s: float) -> Measured:
    """Map a trial's force to the clock of the target, whose time zero was output at ``start_s`` of the trial.

    Resting force and mains hum, fitted to the time before the blow, are subtracted; the channel's delay and the sample
    between output and input are taken back.
    """
    force = data.force_n - _resting(data)
    rate = data.sample_rate_hz
    at_s = start_s + target.time_s + data.force_info.group_delay_s + 1.0 / rate
    on_clock = np.interp(at_s, data.time_s, force)
    bottom = key_bottom(on_clock, rate)
    return Measured(on_clock, None if bottom is None else bottom / rate)


def _resting(data: TrialData) -> NDArray[np.float64]:
    """Mean and mains hum of the force before the blow, continued over the whole trial, (n,)."""
    mains = 2 * np.pi * data.force_info.mains_frequency_hz
    waves = [wave(k * mains * data.time_s) for k in HARMONICS for wave in (np.cos, np.sin)]
    basis = np.column_stack([np.ones_like(data.time_s), *waves])
    before = data.time_s < data.blow_start_s
    fit, *_ = np.linalg.lstsq(basis[before], data.force_n[before], rcond=None)
    return np.asarray(basis @ fit)


def window(target: TargetForce, measured: Measured) -> NDArray[np.bool_]:
    """Where target and measured force are compared: from the onset to the earlier key bottom."""
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


def corrected(
    command_n: NDArray[np.float64], target: TargetForce, measured: Measured, gain: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return the next command, (n,), N; zero at both ends."""
    time_s, inside = target.time_s, window(target, measured)
    error = target.force_n - measured.force_n
    error[time_s < target.onset_s - FADE_S] = 0.0
    last = max(int(np.flatnonzero(inside)[-1]) - int(GUARD_S * rate_hz), 0) if inside.any() else 0
    error[last:] = error[last]  # so that the filter meets no edge
    lowpass = butter(2, min(CUTOFF_HZ, 0.4 * rate_hz), fs=rate_hz, output="sos")
    error = sosfiltfilt(lowpass, error)
    error[last:] *= np.exp(-np.arange(error.size - last) / (FADE_S * rate_hz))
    # the profile begins with LEAD_S of zeros: the correction comes in smoothly before the onset
    error *= np.clip((time_s - (target.onset_s - FADE_S)) / FADE_S, 0.0, 1.0)
    corrected_n = command_n + gain * error
    corrected_n[0] = corrected_n[-1] = 0.0
    return np.asarray(corrected_n)


def within_limits(
    command_n: NDArray[np.float64], force_limit_n: float, slew_limit_n_per_s: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return the nearest command within the limits of force and slew rate, from both ends."""
    step = 0.98 * slew_limit_n_per_s / rate_hz  # a little less: key points are rounded
    limited = np.clip(command_n, -0.98 * force_limit_n, 0.98 * force_limit_n)
    for order in (range(1, limited.size), range(limited.size - 2, -1, -1)):
        back = 1 if order.step < 0 else -1
        for k in order:
            before = limited[k + back]
            limited[k] = min(max(limited[k], before - step), before + step)
    return limited
