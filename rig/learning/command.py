"""The next command of a blow: corrected by the error of the last one, held within limits, made a profile.

A first-order law of iterative learning control, u' = Q(u + gain · e). e is target less measured force, taken where the
command of the same instant is felt (the force channel's delay and the sample from output to input are taken back); Q is
a zero-phase low-pass, below the resonance of arm and load cell. Nothing is learned after the earlier of the two key
bottoms: the last correction fades there. Law and convergence: Bristow, Tharayil & Alleyne, IEEE Control Systems 26
(2006).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.configuration import toml_file
from rig.configuration.profile import Profile, parse_profile
from rig.learning.measured_force import Measured, window
from rig.learning.target_force import FADE_S, TargetForce, low_pass

CUTOFF_HZ = 150.0  # of the low-pass Q: below the resonance of arm and cell
GUARD_S = 1 / (2 * np.pi * CUTOFF_HZ)  # before key bottom, where learning ends: Q spreads the spike backwards so far


def correct_command(
    command_n: NDArray[np.float64], target: TargetForce, measured: Measured, gain: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return the next command (n,), N, at the target's times: ``command_n`` plus ``gain`` times the low-passed
    difference of target and measured force from onset to key bottom, which fades after it; zero at both ends."""
    time_s, inside = target.time_s, window(target, measured)
    error = target.force_n - measured.force_n
    error[time_s < target.onset_s - FADE_S] = 0.0
    last = max(int(np.flatnonzero(inside)[-1]) - int(GUARD_S * rate_hz), 0) if inside.any() else 0
    error[last:] = error[last]  # so that the filter meets no edge
    error = low_pass(error, CUTOFF_HZ, rate_hz)
    error[last:] *= np.exp(-np.arange(error.size - last) / (FADE_S * rate_hz))
    # the profile begins with LEAD_S of zeros: the correction comes in smoothly before the onset
    error *= np.clip((time_s - (target.onset_s - FADE_S)) / FADE_S, 0.0, 1.0)
    corrected_n = command_n + gain * error
    corrected_n[0] = corrected_n[-1] = 0.0
    return np.asarray(corrected_n)


LIMIT_SHARE = 0.98  # of the motor's limits, that a command takes: key points are rounded


def limit_command(
    command_n: NDArray[np.float64], force_limit_n: float, slew_limit_n_per_s: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return a copy of a command (n,), N, sampled at ``rate_hz``, held within 98 % of the limits of force, N, of either
    sign, and of slew rate, N/s."""
    step = LIMIT_SHARE * slew_limit_n_per_s / rate_hz
    limited = np.clip(command_n, -LIMIT_SHARE * force_limit_n, LIMIT_SHARE * force_limit_n)
    for k in range(1, limited.size):
        limited[k] = min(max(limited[k], limited[k - 1] - step), limited[k - 1] + step)
    return limited


POINT_TOLERANCE = 0.002  # of the peak: smaller changes of the command get no key point; a fifteenth of the goal


def make_profile(name: str, command_n: NDArray[np.float64], rate_hz: float, description: str) -> Profile:
    """Return a profile of few points joined by straight lines that stay within 0.2 % of the peak of a command (n,), N,
    sampled at ``rate_hz``; it begins and ends at 0 N. Nothing is written."""
    samples = key_points(command_n, POINT_TOLERANCE * float(np.max(np.abs(command_n), initial=1e-9)))
    points = [{"time_s": round(float(k / rate_hz), 7), "force_n": round(float(command_n[k]), 4)} for k in samples]
    points[0]["force_n"] = points[-1]["force_n"] = 0.0
    head = toml_file.dump_toml({"name": name, "description": description, "interpolation": "linear"})
    rows = "".join(f"  {{ time_s = {p['time_s']!r}, force_n = {p['force_n']!r} }},\n" for p in points)
    return parse_profile(f"{head}points = [\n{rows}]\n", name)


def key_points(values: NDArray[np.float64], tolerance: float) -> list[int]:
    """Return the sample numbers, rising, both ends among them, between which straight lines stay within ``tolerance``
    of all values (n,) (Ramer 1972)."""
    points, open_spans = {0, values.size - 1}, [(0, values.size - 1)]
    while open_spans:
        low, high = open_spans.pop()
        if high - low < 2:
            continue
        inner = np.arange(low + 1, high)
        away = np.abs(values[inner] - np.interp(inner, [low, high], values[[low, high]]))
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            middle = int(inner[worst])
            points.add(middle)
            open_spans += [(low, middle), (middle, high)]
    return sorted(points)
