"""The motor command: a profile checked against the rig's limits and turned into volts on the sample clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration.profile import Profile
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError


@dataclass(frozen=True, eq=False)
class MotorCommand:
    """Volts for a whole trial: quiet zeros, then the profile; ends at 0 V."""

    volts: NDArray[np.float64]
    blow_start_s: float
    blow_end_s: float


def motor_command(profile: Profile, config: RigConfig) -> MotorCommand:
    """Return the motor command of a trial, V, (n,) on the sample clock: 0 V for the rig's ``quiet_s``, then the
    profile's force over the motor's N per V; RigInputError where it exceeds the limits of the rig file.

    Parameters
    ----------
    profile : Profile
    config : RigConfig

    Returns
    -------
    MotorCommand
        Volts (n,) for a whole trial; it ends at 0 V.

    Raises
    ------
    RigInputError
        When the profile exceeds the limits of force, slew rate, heating or output voltage.

    Examples
    --------
    >>> import rig
    >>> command = rig.motor_command(rig.load_profile("forte"), rig.load_rig("virtual").config)
    >>> float(command.volts[-1])
    0.0
    """
    rate, motor = config.device.sample_rate_hz, config.motor
    profile.check_limits(motor.force_limit_n, motor.slew_limit_n_per_s, rate)
    force_n = profile.sample(rate)
    heating_n = rms_force_n(force_n, rate, motor.rms_over_s)
    if heating_n > motor.rms_force_limit_n:
        raise RigInputError(
            f"{profile.source or profile.name}: RMS force {heating_n:.3g} N over {motor.rms_over_s:g} s heats the "
            f"motor, allowed {motor.rms_force_limit_n:g} N; shorten the profile or raise motor.rms_force_limit_n"
        )
    volts = force_n / motor.force_per_volt_n
    if np.max(np.abs(volts)) > motor.voltage_limit_v:
        raise RigInputError(f"{profile.name}: needs {np.max(np.abs(volts)):g} V, allowed {motor.voltage_limit_v:g} V")
    quiet = int(np.ceil(config.recording.quiet_s * rate))
    start_s = quiet / rate
    volts = np.concatenate((np.zeros(quiet), volts))
    return MotorCommand(volts, start_s + profile.onset_s, start_s + profile.duration_s)


def rms_force_n(force_n: NDArray[np.float64], sample_rate_hz: float, over_s: float) -> float:
    """Return the largest root mean square of the force over any ``over_s``; outside the profile it is zero."""
    n = max(int(round(over_s * sample_rate_hz)), 1)
    summed = np.concatenate(([0.0], np.cumsum(np.square(force_n))))
    first = np.maximum(np.arange(summed.size) - n, 0)
    return float(np.sqrt(np.max(summed - summed[first]) / n))
