"""How strong a stroke was: force held for a while, and impulse; the peak at the key's bed is the action's as well."""

from __future__ import annotations

import numpy as np

from validation.measurement.trial import MeasuredTrial

HELD_S = 0.02


def sustained_force_n(m: MeasuredTrial) -> float:
    """Largest force above the preload that is reached for 20 ms in all, N."""
    force = np.sort(m.force.force_n - m.force.preload_n)[::-1]
    step = float(np.median(np.diff(m.force.time_s)))
    return float(force[min(round(HELD_S / step), force.size - 1)])


def onset_u_s(m: MeasuredTrial) -> float:
    """Standard uncertainty of when the force began to act, s: the channel's noise over the slope of the rise."""
    above = m.force.force_n - m.force.preload_n
    held = sustained_force_n(m)
    low, high = (int(np.argmax(above > share * held)) for share in (0.1, 0.5))
    rise = float(m.force.time_s[high] - m.force.time_s[low])
    return m.force.noise_n * rise / (0.4 * held) if held > 0 else float("inf")


def impulse_n_s(m: MeasuredTrial) -> float:
    """Impulse above the preload, N s."""
    step = np.gradient(m.force.time_s)
    return float(np.sum(step * np.maximum(m.force.force_n - m.force.preload_n, 0.0)))
