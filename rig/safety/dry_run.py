"""The dry run: a model's prediction of a profile's blow, checked against the rig file's limits before anything moves.

``pianorig`` supplies the ``predict(profile)`` callable, because the rig does not know the model; the recorder calls it
once per profile, before it touches the bench. Checked: force and its rate, travel, speed and the encoders' pulse rate
of the predicted blow, and speed and energy of the arm if it met no key. The predicted values go into ``session.toml``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.arrays import ArrayRecord
from rig.configuration.profile import Profile
from rig.configuration.rig_file import BODIES, ArmConfig, RigConfig
from rig.errors import RigInputError


@dataclass(frozen=True, eq=False)
class PredictedBlow(ArrayRecord):
    """A predicted blow at n successive samples.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    force_n : ndarray, shape (n,)
        Force of the arm on the key, N, positive downwards.
    angle_rad, speed_rad_per_s : ndarray, shape (n, 3)
        Of key, whippen and hammer, counter-clockwise.
    model : str
        What predicted it.
    """

    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    model: str


Predict = Callable[[Profile], PredictedBlow]


def dry_run(profile: Profile, config: RigConfig, predict: Predict) -> dict[str, float | str]:
    """Predict a profile's blow, refuse it outside the limits, and return the predicted values by name.

    Parameters
    ----------
    profile : Profile
    config : RigConfig
    predict : callable
        Gives the :class:`PredictedBlow` of a profile.

    Returns
    -------
    dict
        The predicted values, for the session file; names carry units.

    Raises
    ------
    RigInputError
        Naming the quantity, the value predicted, when, and the limit; or a rig file without an arm.

    Examples
    --------
    >>> import numpy as np
    >>> import rig
    >>> def nothing_moves(profile):
    ...     force_n = profile.sample(5000.0)
    ...     still = np.zeros((force_n.size, 3))
    ...     return rig.PredictedBlow(np.arange(force_n.size) / 5000.0, force_n, still, still, "a key nailed down")
    >>> figures = rig.dry_run(rig.load_profile("forte"), rig.load_rig("virtual").config, nothing_moves)
    >>> figures["hammer_speed_rad_per_s"]
    0.0
    """
    where = profile.source or profile.name
    if config.arm is None:
        raise RigInputError(f"rig {config.name}: the dry run needs the motor arm's data; add [arm] to the rig file")
    rate = config.device.sample_rate_hz
    free_rad_per_s, free_j = free_arm(config.arm, profile.sample(rate), rate)
    _refuse_above(where, "speed of the arm without a key", "rad/s", free_rad_per_s,
                  config.arm.free_speed_limit_rad_per_s, "arm.free_speed_limit_rad_per_s")  # fmt: skip
    _refuse_above(where, "energy of the arm without a key", "J", free_j,
                  config.arm.free_energy_limit_j, "arm.free_energy_limit_j")  # fmt: skip
    predicted = predict(profile)
    arrays = (predicted.force_n, predicted.angle_rad, predicted.speed_rad_per_s)
    if not all(np.all(np.isfinite(values)) for values in arrays):
        raise RigInputError(f"{where}: dry run: {predicted.model} ends in values that are not finite; ease the profile")
    figures = _refuse_above_limits(where, config, predicted)
    return {
        "profile_sha256": profile.sha256,
        "model": predicted.model,
        **figures,
        "free_arm_speed_rad_per_s": round(free_rad_per_s, 4),
        "free_arm_energy_j": round(free_j, 6),
    }


def free_arm(arm: ArmConfig, force_n: NDArray[np.float64], sample_rate_hz: float) -> tuple[float, float]:
    """Return the largest speed, rad/s, and kinetic energy, J, of the motor arm if it met no key under forces at its tip
    (n,), N, up to its hard stop, or to the end where it does not reach that.

    The torque of each sample is held to the next, so that angle and speed follow exactly; spring and friction, which
    only slow it down, are left out. Both ways count: a pull away from the key is not stopped any sooner.
    """
    acceleration = force_n * (arm.length_m / arm.inertia_kg_m2)
    step_s = 1.0 / sample_rate_hz
    speed = np.concatenate(([0.0], np.cumsum(acceleration) * step_s))
    angle = np.concatenate(([0.0], np.cumsum(speed[:-1] * step_s + 0.5 * acceleration * step_s**2)))
    beyond = np.abs(angle) > arm.free_travel_rad
    last = int(np.argmax(beyond)) if beyond.any() else angle.size - 1
    fastest = float(np.max(np.abs(speed[:last]), initial=0.0))
    if beyond.any():
        # within the sample in which it meets the stop: v² = v0² + 2 a s
        before, way = speed[last - 1], arm.free_travel_rad - abs(angle[last - 1])
        towards = np.sign(angle[last]) * acceleration[last - 1]
        fastest = max(fastest, float(np.sqrt(max(before**2 + 2 * towards * way, 0.0))))
    else:
        fastest = max(fastest, float(abs(speed[last])))
    return fastest, (0.5 * arm.inertia_kg_m2 * fastest**2)


def _refuse_above_limits(where: str, config: RigConfig, predicted: PredictedBlow) -> dict[str, float | str]:
    """Return the largest force, rate of force, and travel, speed and pulse rate of each body of a predicted blow, by
    names with units; refuse one above its limit, naming the profile ``where`` and the time."""
    limits, force_n = config.limits, predicted.force_n

    def largest(what: str, unit: str, values: NDArray[np.float64], limit: float, key: str) -> float:
        at = int(np.argmax(values))
        _refuse_above(where, what, unit, float(values[at]), limit, key, predicted.time_s[at])
        return float(values[at])

    rate = np.abs(np.diff(force_n)) * config.device.sample_rate_hz
    figures: dict[str, float | str] = {
        "force_n": round(largest("force", "N", force_n, limits.force_max_n, "limits.force_max_n"), 4),
        "force_rate_n_per_s": round(
            largest("rate of force", "N/s", rate, limits.force_rate_n_per_s, "limits.force_rate_n_per_s"), 1
        ),
    }
    for body, (name, encoder) in enumerate(zip(BODIES, config.encoders, strict=True)):
        angle, speed = predicted.angle_rad[:, body], np.abs(predicted.speed_rad_per_s[:, body])
        per_rad = encoder.pulses_per_revolution / (2 * np.pi)
        travel = largest(
            f"travel of the {name}", "rad", np.abs(angle - angle[0]), limits.travel_rad[body], "limits.travel_rad"
        )
        fastest = largest(
            f"speed of the {name}", "rad/s", speed, limits.speed_rad_per_s[body], "limits.speed_rad_per_s"
        )
        pulses_hz = largest(
            f"pulse rate of the {name} encoder", "Hz", speed * per_rad, encoder.greatest_speed_rad_per_s * per_rad,
            f"encoders[{body}].max_pulse_rate_hz",
        )  # fmt: skip
        figures[f"{name}_travel_rad"] = round(travel, 5)
        figures[f"{name}_speed_rad_per_s"] = round(fastest, 4)
        figures[f"{name}_pulse_rate_hz"] = round(pulses_hz, 1)
    return figures


def _refuse_above(
    where: str, what: str, unit: str, value: float, limit: float, key: str, time_s: float | None = None
) -> None:
    """Refuse a ``value`` above its ``limit``, both in ``unit``; the message says where (the profile), what, when, and
    the entry ``key`` of the rig file that sets the limit."""
    if value > limit:
        when = "" if time_s is None else f" at {time_s:.4f} s"
        raise RigInputError(
            f"{where}: dry run: {what} {value:.4g} {unit}{when}, allowed {limit:.4g} {unit} ({key}); "
            "ease the profile, or change the rig file if the bench can take it"
        )
