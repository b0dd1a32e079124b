"""What is pressed how often, how fast and how hard, checked against the rig file before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rig.arrays import as_numbers
from rig.configuration.rig_file import FeltConfig, RigConfig
from rig.errors import RigInputError

BLOCK = "block"
"""What is pressed to measure the compliance of arm and cell: a block of steel."""
SLOWEST_M_PER_S, FASTEST_M_PER_S = 1e-4, 0.2


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
    speeds_m_per_s: Sequence[float] = (0.002, 0.008, 0.02)
    peaks_n: Sequence[float] = (15.0, 30.0)
    repeats: int = 1
    rest_s: float = 2.0

    def __post_init__(self) -> None:
        """Take speeds and forces as they are given."""
        for name in ("speeds_m_per_s", "peaks_n"):
            object.__setattr__(self, name, tuple(as_numbers(getattr(self, name), f"felt: {name}", 1).tolist()))


def checked(order: FeltOrder, config: RigConfig, source: str) -> FeltConfig:
    """Return the rig file's ``[felt]`` after a check of the order against it.

    Raises
    ------
    RigInputError
        No ``[felt]``, or a speed, force or number out of range.
    """
    felt = config.felt
    if felt is None:
        raise RigInputError(
            f"{source}: has no table [felt]; add radius_m and compliance_m_per_n of the arm as in the built-in rig "
            "`virtual`"
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
    if not 1 <= order.repeats <= 100 or not 0 <= order.rest_s <= 3600:
        raise RigInputError(f"felt: {order.repeats} repeats, rest {order.rest_s:g} s; allowed 1 to 100, 0 to 3600 s")
    return felt


def guarded(config: RigConfig, felt: FeltConfig, peak_n: float) -> RigConfig:
    """Return the settings of a press: no camera, the limits of force and travel those of a felt."""
    limits, body = config.limits, [encoder.name for encoder in config.encoders].index(felt.encoder)
    travel, speed = list(limits.travel_rad), list(limits.speed_rad_per_s)
    travel[body] = (felt.depth_limit_m + felt.compliance_m_per_n * felt.force_limit_n) / felt.radius_m
    speed[body] = 5 * FASTEST_M_PER_S / felt.radius_m
    narrowed = limits.model_copy(
        update={
            "force_max_n": min(limits.force_max_n, 1.2 * peak_n + 1.0, 1.1 * felt.force_limit_n),
            "travel_rad": tuple(travel),
            "speed_rad_per_s": tuple(speed),
        }
    )
    return config.model_copy(update={"camera": None, "limits": narrowed})
