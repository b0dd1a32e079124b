"""Which terminal of the virtual device each sensor and actuator of the bench is wired to.

The wiring belongs to the bench, not to the rig file: a rig file that names another channel reads an open
input, as in the lab. ``[wiring]`` of a bench file plants other wiring: ``force``, ``motor``, ``drive_enable`` (a line,
or "bridged"), ``key``, ``whippen``, ``hammer`` (A and B terminal). A bad table is :class:`rig.errors.RigInputError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from rig.errors import RigInputError
from rig.simulated.bench.plant_protocol import ENCODED_BODIES


@dataclass(frozen=True)
class Wiring:
    """Names relative to the device (``Mod1/ai0``, ``PFI3``); encoders as (A, B) terminals for key, whippen, hammer.

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


def planted_wiring(table: Mapping[str, Any], product: str, where: str) -> Wiring:
    """Return a product's usual wiring with what the ``[wiring]`` table of a bench file changes."""
    wiring = WIRING_OF_PRODUCT[product]
    encoders = dict(zip(ENCODED_BODIES, wiring.encoders, strict=True))
    changed: dict[str, Any] = {}
    for name, value in table.items():
        if name in encoders and isinstance(value, list) and len(value) == 2 and all(isinstance(v, str) for v in value):
            encoders[name] = (value[0], value[1])
        elif name in ("force", "motor", "drive_enable") and isinstance(value, str):
            changed[name] = None if (name, value) == ("drive_enable", "bridged") else value
        else:
            raise RigInputError(
                f"{where}: wiring.{name} = {value!r}: allowed are force, motor, drive_enable with a name, and "
                f"{', '.join(ENCODED_BODIES)} with [A, B]"
            )
    key, whippen, hammer = (encoders[body] for body in ENCODED_BODIES)
    return replace(wiring, encoders=(key, whippen, hammer), **changed)
