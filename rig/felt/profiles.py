"""Force profiles of a press: first a slow ramp that feels its way, then presses of one speed shaped from what it found.

A torque motor commands force, not motion: a ramp of force slows down in a felt that hardens, and a loop at a changing
speed is no constant share of the felt's curve (eq. 2.7). From the ramp's curve of force over displacement follows the
force that moves the arm at one speed, with smooth beginning and end and a rest at the peak, during which nothing rings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.configuration.motor_command import MotorCommand, motor_command
from rig.configuration.profile import Profile, parse_profile
from rig.configuration.rig_file import RigConfig
from rig.configuration.toml_file import dump_toml
from rig.errors import RigInputError
from rig.safety.dry_run import PredictedBlow, dry_run

RAMP_S = 1.5
"""Of the first press, each way."""
HOLD_S = 0.08
EASE = 0.12
"""Share of the way over which the speed is reached, and left."""
POINTS = 60
SLEW_SHARE = 0.9
Array = NDArray[np.float64]


def ramp(peak_n: float) -> Profile:
    """Return the slow press: a smooth ramp to the peak, a rest, and back."""
    phase = np.linspace(0.0, 1.0, POINTS)
    rise = _eased(phase)
    return _there_and_back("ramp", RAMP_S * phase, peak_n * rise)


def at_speed(moved_m: Array, force_n: Array, speed_m_per_s: float, peak_n: float, slew_n_per_s: float) -> Profile:
    """Return the press that moves the felt's surface at one speed.

    Parameters
    ----------
    moved_m, force_n : (k,) way since the arm's rest and force above its preload, both rising from 0, as the ramp found
    speed_m_per_s, peak_n : wanted
    slew_n_per_s : fastest change of force that the rig file allows

    Raises
    ------
    RigInputError
        The felt is too hard for this speed; the message says how fast it may be.
    """
    way = float(np.interp(peak_n, force_n, moved_m))
    phase = np.linspace(0.0, 1.0, POINTS)
    moved = way * _eased(phase)
    duration = way * (1.0 + EASE) / speed_m_per_s
    force = np.interp(moved, moved_m, force_n)
    force *= peak_n / force[-1]
    steepest = float(np.max(np.diff(force))) * (POINTS - 1) / duration
    if steepest > SLEW_SHARE * slew_n_per_s:
        allowed = SLEW_SHARE * slew_n_per_s
        raise RigInputError(
            f"felt: {speed_m_per_s:g} m/s to {peak_n:g} N needs {steepest:.4g} N/s, allowed {allowed:g} N/s "
            f"(motor.slew_limit_n_per_s); press at {speed_m_per_s * allowed / steepest:.2g} m/s at most, or less hard"
        )
    return _there_and_back(f"{1e3 * speed_m_per_s:g} mm/s to {peak_n:g} N", duration * phase, force)


def checked_command(profile: Profile, config: RigConfig, deepest_rad: float, body: int) -> MotorCommand:
    """Return the motor command of a press after a dry run without inertia: the force follows the command.

    Raises
    ------
    RigInputError
        Outside the limits of motor or rig file; nothing has moved.
    """
    rate = config.device.sample_rate_hz
    force = profile.sample(rate)
    angle = np.zeros((force.size, 3))
    angle[:, body] = deepest_rad * force / max(float(force.max()), 1e-9)
    speed = np.diff(angle, axis=0, append=angle[-1:]) * rate
    predicted = PredictedBlow(np.arange(force.size) / rate, force, angle, speed, "a felt without inertia")
    dry_run(profile, config, lambda _: predicted)
    return motor_command(profile, config)


def _eased(phase: Array) -> Array:
    """Way over time, both from 0 to 1: constant speed between a smooth beginning and a smooth end."""
    fine = np.linspace(0.0, 1.0, 2001)
    at = EASE / (1.0 + EASE)
    speed = np.clip(np.minimum(fine, 1.0 - fine) / at, 0.0, 1.0)
    speed = speed * speed * (3.0 - 2.0 * speed)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    return np.interp(phase, fine, way / way[-1])


def _there_and_back(name: str, time_s: Array, force_n: Array) -> Profile:
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
