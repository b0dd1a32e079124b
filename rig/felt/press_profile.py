"""Profiles of the motor's force that press a felt: a slow ramp, and presses at one speed.

A torque motor commands force, not motion: a ramp of force slows down in a felt that hardens, and a loop at a changing
speed is no constant share of the felt's curve (eq. 2.7). From the ramp's curve of force over displacement follows the
force that moves the arm at one speed, with smooth beginning and end and a rest at the peak, during which nothing rings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.configuration.profile import Profile, parse_profile
from rig.configuration.toml_file import dump_toml
from rig.errors import RigInputError

Array = NDArray[np.float64]
EASE = 0.12  # share of the way over which the speed is reached, and left: choice; shorter rings more
RAMP_S = 1.5  # of the first press, each way
HOLD_S = 0.08  # at the deepest point, between loading and unloading
POINTS = 60  # key points of a press, straight lines between them
SLEW_SHARE = 0.9  # of the rig file's slew limit that a press may ask for


def make_ramp(peak_n: float) -> Profile:
    """Return the slow press: a smooth ramp to the peak, a rest, and back."""
    phase = np.linspace(0.0, 1.0, POINTS)
    rise = _ease_in_out(phase)
    return _make_press_and_release("ramp", RAMP_S * phase, peak_n * rise)


def make_constant_speed_press(
    ramp_way_m: Array, ramp_force_n: Array, speed_m_per_s: float, peak_n: float, slew_n_per_s: float
) -> Profile:
    """Profile that presses at one speed to ``peak_n``, N above rest, holds 80 ms and goes back, by the curve of a slow
    ramp: compression, m, and force, N, since rest, (k,), rising; refused over 90 % of the slew limit."""
    way = float(np.interp(peak_n, ramp_force_n, ramp_way_m))
    phase = np.linspace(0.0, 1.0, POINTS)
    displacement_m = way * _ease_in_out(phase)
    duration = way * (1.0 + EASE) / speed_m_per_s
    force = np.interp(displacement_m, ramp_way_m, ramp_force_n)
    force *= peak_n / force[-1]
    steepest = float(np.max(np.diff(force))) * (POINTS - 1) / duration
    if steepest > SLEW_SHARE * slew_n_per_s:
        allowed = SLEW_SHARE * slew_n_per_s
        raise RigInputError(
            f"felt: {speed_m_per_s:g} m/s to {peak_n:g} N needs {steepest:.4g} N/s, allowed {allowed:g} N/s "
            f"(motor.slew_limit_n_per_s); press at {speed_m_per_s * allowed / steepest:.2g} m/s at most, or less hard"
        )
    return _make_press_and_release(f"{1e3 * speed_m_per_s:g} mm/s to {peak_n:g} N", duration * phase, force)


def _ease_in_out(phase: Array) -> Array:
    """Way over time, both from 0 to 1: constant speed between a smooth beginning and a smooth end."""
    eased = EASE / (1.0 + EASE)
    near = np.minimum(phase, 1.0 - phase)
    u = np.minimum(near / eased, 1.0)  # the speed is 3 u^2 - 2 u^3
    way = (eased * (u**3 - 0.5 * u**4 - u) + near) / (1.0 - eased)
    return np.where(phase < 0.5, way, 1.0 - way)


def _make_press_and_release(name: str, time_s: Array, force_n: Array) -> Profile:
    """Profile of a press and its release: the force (n,), N, at times (n,), s from 0, held for 80 ms at the last one,
    then run backwards; it begins and ends at 0 N."""
    at = np.concatenate((time_s, time_s[-1] + HOLD_S + time_s))
    force = np.concatenate((force_n, force_n[::-1]))
    force[0] = force[-1] = 0.0
    points = [{"time_s": float(f"{t:.7g}"), "force_n": float(f"{f:.7g}")} for t, f in zip(at, force, strict=True)]
    table = {
        "name": name,
        "description": "a press and its release, made by `pianorig record --felt`",
        "interpolation": "pchip",
        "points": points,
    }
    return parse_profile(dump_toml(table), name)
