"""Which terminal of the virtual device each sensor and actuator of the bench is wired to.

The wiring belongs to the bench, not to the rig file: a rig file that names another channel reads an open
input, as in the lab.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wiring:
    """Names relative to the device (``Mod1/ai0``, ``PFI3``); encoders as (A, B) terminals for key, whippen,
    hammer.

    ``drive_enable`` None means that the drive's enable input is bridged. ``conditioner_v_per_mv_per_v`` is
    the gain of the bridge amplifier where the force goes to a voltage input.
    """

    force: str
    motor: str
    encoders: tuple[tuple[str, str], tuple[str, str], tuple[str, str]]
    drive_enable: str | None
    exposure: str | None = None
    """Terminal with the exposure signal of a camera that runs by itself."""
    loopback: str | None = None
    """Voltage input that is wired to the motor's output."""
    conditioner_v_per_mv_per_v: float = 5.0


WIRING_OF_PRODUCT = {
    "cDAQ-9189": Wiring(
        force="Mod1/ai0",
        motor="Mod2/ao0",
        encoders=(("Mod3/PFI0", "Mod3/PFI1"), ("Mod3/PFI2", "Mod3/PFI3"), ("Mod3/PFI4", "Mod3/PFI5")),
        drive_enable="Mod4/port0/line7",
        exposure="Mod4/PFI0",
    ),
    "PCIe-6363": Wiring(
        force="ai0",
        motor="ao0",
        encoders=(("PFI8", "PFI10"), ("PFI3", "PFI11"), ("PFI0", "PFI1")),
        drive_enable="port0/line0",
        exposure="PFI12",
        loopback="ai1",
    ),
}
