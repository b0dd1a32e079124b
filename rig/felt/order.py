"""What is pressed, how fast and how hard, and the limits under which the arm may do it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.arrays import as_numbers
from rig.configuration.motor_command import motor_command
from rig.configuration.profile import Profile
from rig.configuration.rig_file import FeltConfig, RigConfig
from rig.errors import RigInputError
from rig.recording.trial_plan import MAX_TRIALS
from rig.safety.dry_run import PredictedBlow, dry_run

BLOCK = "block"
"""What is pressed to measure the compliance of arm and cell: a block of steel."""
SLOWEST_M_PER_S, FASTEST_M_PER_S = 1e-4, 0.2  # of a press: a millimetre in ten seconds; in 5 ms, below a blow's 1 m/s


@dataclass(frozen=True)
class FeltOrder:
    """One loading experiment.

    Attributes
    ----------
    contact : name of the felt, for example ``contact02``, or ``block``
    speeds_m_per_s, peaks_n : each speed is played with each peak force
    repeats : presses of each kind
    rest_s : between two presses, for the felt to recover
    """

    contact: str
    speeds_m_per_s: Sequence[float] = (0.002, 0.008, 0.02)  # choice: a decade, below ringing
    peaks_n: Sequence[float] = (15.0, 30.0)  # choice: half and whole of a forte
    repeats: int = 1
    rest_s: float = 2.0  # choice; a felt that still recovers shows in the first touch

    def __post_init__(self) -> None:
        for name in ("speeds_m_per_s", "peaks_n"):
            object.__setattr__(self, name, tuple(as_numbers(getattr(self, name), f"felt: {name}", 1).tolist()))


def check_order(order: FeltOrder, config: RigConfig, source: str) -> FeltConfig:
    """Refuse an order whose speeds, peak forces, repeats or rest the rig file's ``[felt]`` does not allow, and a rig
    file without that table, which is named ``source`` in the error; return the table."""
    felt = config.felt
    if felt is None:
        raise RigInputError(
            f"{source}: has no table [felt]; add radius_m and compliance_m_per_n of the arm as in the built-in rig "
            "'virtual'"
        )
    if not order.speeds_m_per_s or not order.peaks_n:
        raise RigInputError("felt: allowed from one speed and one peak force on")
    for speed in order.speeds_m_per_s:
        if not SLOWEST_M_PER_S <= speed <= FASTEST_M_PER_S:
            raise RigInputError(f"felt: speed {speed:g} m/s, allowed {SLOWEST_M_PER_S:g} to {FASTEST_M_PER_S:g} m/s")
    for peak in order.peaks_n:
        if not 1.0 <= peak <= felt.force_limit_n:
            raise RigInputError(
                f"felt: peak force {peak:g} N, allowed 1 to {felt.force_limit_n:g} N (felt.force_limit_n)"
            )
    most = (MAX_TRIALS - 1) // (len(order.speeds_m_per_s) * len(order.peaks_n))  # beside the ramp
    if not 1 <= order.repeats <= most or not 0 <= order.rest_s < math.inf:
        raise RigInputError(f"felt: {order.repeats} repeats, rest {order.rest_s:g} s; allowed 1 to {most}, from 0 s on")
    return felt


SPEED_MARGIN, FORCE_MARGIN = 5.0, 1.1  # interlock's limits over what a press should reach: room for ringing


def press_settings(config: RigConfig, felt: FeltConfig, peak_n: float) -> RigConfig:
    """Return a copy of the rig's settings for presses up to ``peak_n``, N: no camera; limits of the force, and of
    travel and speed of the encoder on the motor's shaft, as ``felt`` has them."""
    limits, body = config.limits, [encoder.name for encoder in config.encoders].index(felt.encoder)
    travel, speed = list(limits.travel_rad), list(limits.speed_rad_per_s)
    travel[body] = (felt.depth_limit_m + felt.compliance_m_per_n * felt.force_limit_n) / felt.radius_m
    speed[body] = SPEED_MARGIN * FASTEST_M_PER_S / felt.radius_m
    narrowed = limits.model_copy(
        update={
            "force_max_n": min(limits.force_max_n, FORCE_MARGIN * peak_n + 1.0, FORCE_MARGIN * felt.force_limit_n),
            "travel_rad": tuple(travel),
            "speed_rad_per_s": tuple(speed),
        }
    )
    return config.model_copy(update={"camera": None, "limits": narrowed})


def check_press(profile: Profile, config: RigConfig, deepest_rad: float, body: int) -> None:
    """Refuse a press beyond a limit, by a dry run of ``profile``: the encoder at index ``body`` (from 0) turns in
    proportion to the force, by ``deepest_rad`` at its largest; the others stand still."""
    rate = config.device.sample_rate_hz
    force = profile.sample(rate)
    angle = np.zeros((force.size, 3))
    angle[:, body] = deepest_rad * force / max(float(force.max()), 1e-9)
    speed = np.diff(angle, axis=0, append=angle[-1:]) * rate
    predicted = PredictedBlow(np.arange(force.size) / rate, force, angle, speed, "a felt without inertia")
    dry_run(profile, config, lambda _: predicted)
    motor_command(profile, config)
