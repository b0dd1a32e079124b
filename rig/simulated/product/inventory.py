"""The devices under the names they have in the system: channels, lines and terminals, looked up as a client names them,
with the driver's refusals.

Of several devices, each with its own channels, terminals and timebase, the first is the main one: its terminals are
known by their own names, those of the others in full, with a slash. A cable carries clocks between them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rig.simulated.product.capabilities import Kind, Product
from rig.simulated.status import Code, DaqStatusError, NotImplementedByDevice

DIGITAL_RATE_HZ = 10e6
Pin = Literal["source", "gate", "auxiliary", "out"]


@dataclass(frozen=True)
class PhysicalChannel:
    """One physical channel: full name, kind, and the hardware resource a task on it takes."""

    name: str
    kind: Kind
    resource: str


def channel_names(text: str) -> list[str]:
    """Return the channels a list such as ``Dev1/ai0:2, Dev1/ai7`` names, in its order."""
    names: list[str] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        if match := re.fullmatch(r"(.*?)(\d{1,3}):(?:\1)?(\d{1,3})", part):
            stem, first, last = match[1], int(match[2]), int(match[3])
            step = 1 if last >= first else -1
            names += [f"{stem}{i}" for i in range(first, last + step, step)]
        else:
            names.append(part)
    if not names:
        raise DaqStatusError(Code.PHYSICAL_CHAN_DOES_NOT_EXIST, f"Physical Channel: {text!r}")
    return names


class Inventory:
    """A product under the name it has in the system, e.g. chassis ``cDAQ1`` with modules ``cDAQ1Mod1`` …

    ``others`` are further devices of the rig, ``linked_names`` those of all that are on one RTSI cable.
    """

    def __init__(
        self,
        product: Product,
        name: str,
        clock_error: float = 0.0,
        others: Sequence[Inventory] = (),
        linked_names: Collection[str] = (),
    ) -> None:
        self.product = product
        self.name = name
        self.clock_error = clock_error
        """Relative error of the device's own timebase."""
        self._channels = {
            self.full_name(relative).lower(): PhysicalChannel(self.full_name(relative), kind, resource)
            for relative, kind, resource in product.channels
        }
        self._others, self._linked = tuple(others), frozenset(linked_names)
        for other in others:
            self._channels |= other._channels
        self._terminals: dict[tuple[str, bool], str] = {}
        """Terminals looked up so far: every read needs those of its encoder."""

    def full_name(self, relative: str) -> str:
        """Name of a channel or terminal in the system: a module's name follows its chassis's, no slash.

        What begins with a slash is named in full already, an SCXI module by its own chassis.
        """
        if relative.startswith(("/", "SC")):
            return relative.removeprefix("/")
        return self.name + relative if relative.startswith("Mod") else f"{self.name}/{relative}"

    def devices(self) -> dict[str, str]:
        """Return product types by name, of all devices and modules."""
        return {name: kind for one in (self, *self._others) for name, kind in one.own_devices().items()}

    def own_devices(self) -> dict[str, str]:
        """Return product types by device name: the card, or the chassis and its modules."""
        modules = {self.full_name(name): kind for name, kind in self.product.modules}
        return {self.name: self.product.name, **modules}

    def of(self, name: str) -> Inventory:
        """Return the device that a channel, terminal or device of this name belongs to; else the main one."""
        if self._others:
            first = name.removeprefix("/").split("/", 1)[0].lower()
            for other in self._others:
                if first in (known.lower() for known in other.own_devices()):
                    return other
        return self

    def own_name(self, terminal: str) -> str:
        """Return a terminal relative to its device."""
        owner = self.of(terminal) if terminal.startswith("/") else self
        return terminal if owner is self else terminal[1 + len(owner.name) :].lstrip("/")

    def known_as(self, owner: Inventory, relative: str) -> str:
        """Return the name by which a terminal of a device is known here."""
        return relative if owner is self or relative.startswith("/") else "/" + owner.full_name(relative)

    def linked(self, one: Inventory, other: Inventory) -> bool:
        """Whether two devices can route clocks and triggers to each other without a wire of the lab's own."""
        return one is other or {one.name, other.name} <= self._linked

    def channel(self, name: str, kind: Kind) -> PhysicalChannel:
        """Look up a physical channel and refuse a wrong device, name or kind as the driver does."""
        device = name.split("/", 1)[0]
        named = device.lower()
        if not named.startswith(self.name.lower()) and named not in map(str.lower, self.devices()):
            raise DaqStatusError(Code.INVALID_DEVICE_ID, f"Device: {device}")
        channel = self._channels.get(name.lower())
        if channel is None:
            raise DaqStatusError(Code.PHYSICAL_CHAN_DOES_NOT_EXIST, f"Physical Channel: {name}")
        if channel.kind != kind:
            output = kind in ("voltage_out",)
            code = Code.PHYS_CHAN_OUTPUT_TYPE if output else Code.PHYS_CHAN_MEAS_TYPE
            raise DaqStatusError(code, f"Physical Channel: {name} ({channel.kind}, not {kind})")
        return channel

    def names(self, *kinds: Kind) -> list[str]:
        """Return the full names of all channels of these kinds."""
        return [channel.name for channel in self._channels.values() if channel.kind in kinds]

    def lines(self, text: str) -> list[PhysicalChannel]:
        """Return the digital lines a list such as ``Dev1/port0/line0:7`` or ``Dev1/port0`` names."""
        found: list[PhysicalChannel] = []
        for name in channel_names(text):
            inside = [c for key, c in self._channels.items() if key.startswith(name.lower() + "/line")]
            if re.search(r"/port\d+$", name) and inside:
                found += inside
            else:
                try:
                    found.append(self.channel(name, "line"))
                except DaqStatusError:
                    found.append(self.channel(name, "static_line"))
        return found

    def counter_terminal(self, channel: PhysicalChannel, pin: Pin) -> str:
        """Return a counter's default terminal, by the name it has here; "" where it has none."""
        if (owner := self.of(channel.name)) is not self:
            found = owner.counter_terminal(channel, pin)
            return self.known_as(owner, found) if found else ""
        module = channel.name.split("/", 1)[0].removeprefix(self.name)
        pins = self.product.counter_pins.get(module)
        found = getattr(pins, pin)[int(channel.resource.removeprefix("ctr"))] if pins and getattr(pins, pin) else ""
        return f"{module}/{found}" if module and found else found

    def line(self, name: str) -> PhysicalChannel:
        """Return one digital line by its full name."""
        return self._channels[name.lower()]

    def terminal(self, name: str, *, output: bool = False) -> str:
        """Check a terminal name such as ``/cDAQ1/ai/SampleClock``; return it relative to the device.

        A name that does not begin with a slash, such as ``ai/SampleClock``, is one of this device.
        """
        if "/" in name and (owner := self.of(name)) is not self:
            return self.known_as(owner, owner.terminal("/" + name.removeprefix("/"), output=output))
        if (name, output) not in self._terminals:
            self._terminals[name, output] = self._checked_terminal(name, output)
        return self._terminals[name, output]

    def _checked_terminal(self, name: str, output: bool) -> str:
        given, owner = name, self.name.lower()
        if not name.startswith("/"):
            mine = re.match(re.escape(owner) + r"(mod\d+)?/", name, re.IGNORECASE)
            name = f"/{name}" if mine else f"/{self.name}/{name}"
        if not name.lower().startswith("/" + owner):
            raise DaqStatusError(Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING, f"Terminal: {name!r}")
        relative = self._spelled(name[1 + len(owner) :].lstrip("/"))
        name = f"/{self.name}{name[1 + len(owner) :]}"
        name = name[: len(name) - len(relative)] + relative
        patterns = (*self.product.terminals, self.product.timebases)
        known = relative in self.product.internal or any(re.fullmatch(p, relative) for p in patterns)
        spelled = "/" + self.full_name(relative) == name
        if spelled and re.fullmatch(self.product.unsimulated, relative):
            raise NotImplementedByDevice(f"terminal {name}")
        if not (known and spelled):
            raise DaqStatusError(Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING, f"Terminal: {given!r}")
        inputs = self.product.input_only_terminals
        inside = relative in self.product.internal or re.fullmatch(self.product.timebases, relative)
        if output and (inside or re.fullmatch(inputs, relative)):
            raise DaqStatusError(Code.ROUTE_NOT_SUPPORTED_BY_HW_ROUTING, f"Terminal: {name!r} is an input")
        return relative

    def _spelled(self, relative: str) -> str:
        """Return a terminal as the product spells it; the driver does not tell capitals from small letters."""
        for known in self.product.internal:
            if known.lower() == relative.lower():
                return known
        for word in ("PFI", "RTSI", "Mod", "MHzTimebase", "kHzTimebase", "Ctr", "InternalOutput"):
            relative = re.sub(rf"(?<![a-z]){word}(?=\d|/|$)|{word}$", word, relative, flags=re.IGNORECASE)
        return relative

    def coerced_rate(self, rate_hz: float, kind: Kind, channels: int) -> float:
        """Return a sample clock's real rate, coerced up: 50 kHz/n (n to 31) for bridges, else the timebase over n.

        Raises DaqStatusError above what the product can do with so many channels.
        """
        product = self.product
        if not rate_hz > 0 or (kind != "counter" and rate_hz < product.timebase_hz / 2**32):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Sample clock rate: {rate_hz:g}")
        most = DIGITAL_RATE_HZ
        if kind in ("bridge", "voltage_in"):
            shared = product.ai_aggregate_rate_hz if channels > 1 else math.inf
            most = min(product.ai_max_rate_hz, shared / channels)
        elif kind == "voltage_out":
            most = product.ao_rates_hz[channels - 1] if product.ao_rates_hz else product.ao_max_rate_hz
        elif kind == "counter":
            return rate_hz  # not generated: the clock comes from a terminal
        if rate_hz > most * (1 + 1e-9):
            raise DaqStatusError(Code.SAMP_RATE_TOO_HIGH, f"Requested {rate_hz:g}, maximum {most:g}")
        if kind == "bridge" and product.bridge_decimates:
            return 50e3 / min(max(math.floor(50e3 / rate_hz * (1 + 1e-12)), 1), 31)
        return product.timebase_hz / math.floor(product.timebase_hz / rate_hz * (1 + 1e-12))

    def input_delay_s(self, kind: Kind, rate_hz: float) -> float:
        """Delay between the signal and its sample: the filter of a bridge module; none otherwise."""
        if kind != "bridge":
            return 0.0
        return (40 + 5 / 512) / rate_hz + 4.5e-6 if self.product.bridge_decimates else self.product.bridge_delay_s

    def half_range(self, settings: Mapping[str, Any]) -> float:
        """Return the range a voltage input uses, as half its span, V: the one set, else what covers its limits."""
        return max(settings.get("range_v", 0.0), self.voltage_range(settings["min_val"], settings["max_val"]))

    def voltage_range(self, low_v: float, high_v: float) -> float:
        """Return the input range that covers the limits asked for, as half its span, V."""
        need = max(abs(low_v), abs(high_v))
        for half in self.product.ai_ranges_v:
            if need <= half * (1 + 1e-9):
                return half
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Input limits {low_v:g} to {high_v:g} V are out of range")
