"""Which terminal of the virtual device each sensor and actuator of the bench is wired to.

The wiring belongs to the bench, not to the rig file: a rig file that names another channel reads an open
input, as in the lab. ``[wiring]`` of a bench file plants other wiring: ``force``, ``motor``, ``drive_enable`` (a line,
or "bridged"), ``key``, ``whippen``, ``hammer`` (A and B terminal). A bad table is :class:`rig.errors.RigInputError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError
from rig.simulated.bench.plant_protocol import ENCODED_BODIES
from rig.simulated.product import PCI_6602


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
    opposite: tuple[str, str] | None = None
    """A and B terminal of a second head on the key's scale."""
    exposure: str | None = None
    """Terminal with the exposure signal of a camera that runs by itself."""
    loopback: str | None = None
    """Voltage input that is wired to the motor's output."""
    conditioner_v_per_mv_per_v: float = 5.0  # 10 V at 2 mV/V
    wires: Mapping[str, str] = field(default_factory=dict)
    """Wires between devices: the terminal at the far end, and the one whose signal it gets."""
    rtsi: bool = True
    """Whether the cards share a registered RTSI cable."""


WIRING_OF_PRODUCT = {
    "PCI-6034E": Wiring(
        force="SC1Mod1/ai0",
        motor="ao0",
        encoders=(("PFI8", "PFI9"), ("PFI3", "PFI4"), ("PFI0", "PFI1")),  # only two counters: a further card has them
        drive_enable="port0/line0",
    ),
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


def usual_wiring(config: RigConfig) -> Wiring:
    """Return how the products of a rig are usually wired: encoders to a counter card, the motor to a card with outputs.

    A wire between devices is where the rig file says; ``[wiring]`` of a bench file plants another one, or none.
    """
    wiring = WIRING_OF_PRODUCT[config.device.product]
    changed: dict[str, Any] = {}
    for further in config.devices:
        name = further.name
        if further.product == "PCI-6602":
            pins = PCI_6602.counter_pins[""]
            heads = [(f"/{name}/{a}", f"/{name}/{b}") for a, b in zip(pins.source, pins.auxiliary, strict=True)]
            changed |= {"encoders": tuple(heads[:3]), "opposite": heads[3]}
        elif further.product == "PCI-6733":
            changed |= {"motor": f"/{name}/ao0", "drive_enable": f"/{name}/port0/line0"}
        elif further.product == "PCIe-6363":
            card = WIRING_OF_PRODUCT["PCIe-6363"]
            changed["encoders"] = tuple((f"/{name}/{a}", f"/{name}/{b}") for a, b in card.encoders)
            changed |= {"motor": f"/{name}/{card.motor}", "exposure": f"/{name}/{card.exposure}"}
    wires = {
        # a terminal of the main device by the name it has there: /cDAQ1Mod4/PFI5 is Mod4/PFI5
        str(further.clock_to): str(further.clock_from).removeprefix(f"/{config.device.name}").removeprefix("/")
        for further in config.devices
        if further.clock_to is not None
    }
    return replace(wiring, wires=wires, **changed)


def plant_wiring_faults(table: Mapping[str, Any], wiring: Wiring, where: str) -> Wiring:
    """Copy of ``wiring`` with the faults of ``table`` (``[wiring]`` of the bench file): other terminals of force,
    motor, drive enable or an encoder (A, B), no RTSI cable, no wires; refuse other entries, naming the file ``where``.
    """
    encoders = dict(zip(ENCODED_BODIES, wiring.encoders, strict=True))
    changed: dict[str, Any] = {}
    for name, value in table.items():
        if name in encoders and isinstance(value, list) and len(value) == 2 and all(isinstance(v, str) for v in value):
            encoders[name] = (value[0], value[1])
        elif name in ("force", "motor", "drive_enable") and isinstance(value, str):
            changed[name] = None if (name, value) == ("drive_enable", "bridged") else value
        elif name in ("rtsi", "wires") and isinstance(value, bool):
            changed[name] = value if name == "rtsi" else (wiring.wires if value else {})
        else:
            raise RigInputError(
                f"{where}: wiring.{name} = {value!r}: allowed are force, motor, drive_enable with a name, "
                f"{', '.join(ENCODED_BODIES)} with [A, B], rtsi and wires with true or false"
            )
    key, whippen, hammer = (encoders[body] for body in ENCODED_BODIES)
    return replace(wiring, encoders=(key, whippen, hammer), **changed)
