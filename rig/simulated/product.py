"""What each product can do: channels, ranges, rates and terminals, as the real one would refuse or coerce.

Sources: NI data sheets and manuals of PCIe-6363 (X Series), cDAQ-9189, NI 9237, 9263, 9411 and 9401; the input delay of
the 9237 is (40 + 5/512)/fs + 4.5 µs (NI knowledge base kA00Z0000004A0YSAU). Modules sit in fixed slots: 9237, 9263,
9411, 9401 in 1 to 4.

The cards of the thesis's bench, and an analog output card in place of its motion controller: user manuals of the NI
6034E/6035E and of the SCXI-1520, specifications of NI 660x and NI 6731/6733. The SCXI-1520 is read through the card;
its filter is a four-pole Butterworth, here at 10 kHz (delay 2.61 / (2 pi f)), its gain that of a range of 5 mV/V. None
of them has a watchdog timer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rig.simulated.status import Code, DaqStatusError, NotAnswered

Kind = Literal["bridge", "voltage_in", "voltage_out", "counter", "line", "static_line"]


UNSIMULATED = (
    r"(ai|di|ao|do)/(ReferenceTrigger|PauseTrigger|SampleClockTimebase|ConvertClock|ConvertClockTimebase|HoldCompleteEvent)|"
    r"Ctr[0-7](Source|Gate|Aux|A|B|Z|ArmStartTrigger|SampleClock)|PairedCtrInternalOutput|FrequencyOutput|"
    r"10MHzRefClock|ChangeDetectionEvent|AnalogComparisonEvent|WatchdogExpiredEvent|WatchdogExpirationTrigger|APFI[01]"
)


@dataclass(frozen=True)
class CounterPins:
    """Default terminals of counters 0 to 3; A and B of an encoder are source and auxiliary.

    X Series manual, default counter pins; NI-DAQmx Help, "CompactDAQ counter signal connections" (NI 9401). Counters
    named by the NI 9411 have none.
    """

    source: tuple[str, ...] = ()
    auxiliary: tuple[str, ...] = ()
    out: tuple[str, ...] = ()


@dataclass(frozen=True)
class Product:
    """Table of one product (a chassis with its modules counts as one)."""

    name: str
    channels: tuple[tuple[str, Kind, str], ...]
    """(name relative to the device, kind, resource)"""
    terminals: tuple[str, ...]
    """Terminals by pattern, relative to the device."""
    counter_timebase_hz: float
    ao_range_v: float = 10.0
    ao_max_rate_hz: float = 0.0
    ai_max_rate_hz: float = 0.0
    modules: tuple[tuple[str, str], ...] = ()
    """Modules of a chassis: name behind the chassis's, product type."""
    differential: tuple[int, ...] = ()
    """Numbers of the voltage inputs that can be the positive one of a pair."""
    unsimulated: str = UNSIMULATED
    """Terminals that the product has and the virtual device does not, by pattern."""
    bridge_range_mv_per_v: float = 0.0
    bridge_bits: int = 24
    bridge_excitation_v: tuple[float, ...] = ()
    ai_ranges_v: tuple[float, ...] = ()
    counter_pins: Mapping[str, CounterPins] = field(default_factory=dict)
    """Default terminals of the counters, by the module that names the counter ("" on a card)."""
    ai_aggregate_rate_hz: float = math.inf
    """Sum of the rates of several AI channels on one converter."""
    ao_rates_hz: tuple[float, ...] = ()
    """Largest AO rate with one, two, … channels; empty: ``ao_max_rate_hz`` for each."""
    timebase_hz: float = 100e6
    ai_bits: int = 16
    watchdog_reach: tuple[Kind, ...] = ()
    """Kinds of outputs the product's watchdog timer can put into a state."""
    watchdog_longest_s: float = (2**32 - 1) * 8e-9
    expiry_locks: bool = False
    """Whether after an expiration nothing works until the device is reset; else only the outputs it holds refuse."""
    input_only_terminals: str = r"(?!)"
    internal: tuple[str, ...] = field(
        default=tuple(
            f"{kind}/{signal}" for kind in ("ai", "ao", "di", "do") for signal in ("SampleClock", "StartTrigger")
        )
    )
    bridge_decimates: bool = True
    """Whether the bridge input is a 9237's: rates of 50 kHz/n, delay of its filter."""
    bridge_delay_s: float = 0.0
    """Delay of another bridge input."""
    rtsi: bool = False
    """Whether it has a connector for the RTSI cable."""
    timebases: str = r"(?!)"
    """Terminals that carry clocks of the device itself, by pattern."""

    @property
    def chassis(self) -> bool:
        """Whether its modules have converters and timing of their own, as in a chassis."""
        return any(name.startswith("Mod") for name, _ in self.modules)


def number_channels(prefix: str, count: int, kind: Kind, resource: str) -> tuple[tuple[str, Kind, str], ...]:
    return tuple((f"{prefix}{i}", kind, f"{resource}{i}") for i in range(count))


CDAQ_9189 = Product(
    name="cDAQ-9189",
    counter_pins={
        "Mod4": CounterPins(source=("PFI0", "PFI4", "PFI3", "PFI7"), auxiliary=("PFI2", "PFI6", "PFI0", "PFI4"))
    },
    modules=(("Mod1", "NI 9237"), ("Mod2", "NI 9263"), ("Mod3", "NI 9411"), ("Mod4", "NI 9401")),
    channels=(
        *number_channels("Mod1/ai", 4, "bridge", "bridge"),
        *number_channels("Mod2/ao", 4, "voltage_out", "ao"),
        *number_channels("Mod3/ctr", 4, "counter", "ctr"),
        *number_channels("Mod4/ctr", 4, "counter", "ctr"),
        *number_channels("Mod4/port0/line", 8, "line", "pin4."),
    ),
    terminals=(r"Mod3/PFI[0-5]", r"Mod4/PFI[0-7]"),
    ao_max_rate_hz=100e3,
    ai_max_rate_hz=50e3,
    counter_timebase_hz=80e6,
    bridge_range_mv_per_v=25.0,
    bridge_excitation_v=(2.5, 3.3, 5.0, 10.0),
    input_only_terminals=r"Mod3/PFI\d+",
    watchdog_reach=("voltage_out", "line"),  # cDAQ-9185/9189 manual, "Watchdog Timer"
    watchdog_longest_s=(2**32 - 1) * 25e-9,
    expiry_locks=True,
    timebase_hz=80e6,
    timebases=r"(80|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
)

PCIE_6363 = Product(
    name="PCIe-6363",
    differential=(*range(8), *range(16, 24)),
    channels=(
        *number_channels("ai", 32, "voltage_in", "ai"),
        *number_channels("ao", 4, "voltage_out", "ao"),
        *number_channels("ctr", 4, "counter", "ctr"),
        *number_channels("port0/line", 32, "line", "pin0."),
        *number_channels("port1/line", 8, "static_line", "PFI PFI"),
        *((f"port2/line{i}", "static_line", f"PFI PFI{8 + i}") for i in range(8)),
    ),
    terminals=(r"PFI(1[0-5]|[0-9])", r"RTSI[0-7]"),
    ao_max_rate_hz=2.86e6,
    ai_max_rate_hz=2e6,
    counter_timebase_hz=100e6,
    ai_ranges_v=(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
    counter_pins={
        "": CounterPins(
            source=("PFI8", "PFI3", "PFI0", "PFI5"),
            auxiliary=("PFI10", "PFI11", "PFI2", "PFI7"),
            out=("PFI12", "PFI13", "PFI14", "PFI15"),
        )
    },
    ai_aggregate_rate_hz=1e6,
    ao_rates_hz=(2.86e6, 2.0e6, 1.54e6, 1.25e6),
    timebases=r"(100|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
    rtsi=True,
    watchdog_reach=("line",),  # X Series manual: digital and PFI lines, not the analog outputs
)


E_SERIES_TIMEBASES = r"20MHzTimebase|100kHzTimebase|Ctr[01]InternalOutput"

PCI_6034E = Product(
    name="PCI-6034E",
    rtsi=True,
    modules=(("SC1Mod1", "SCXI-1520"),),
    channels=(
        *number_channels("SC1Mod1/ai", 8, "bridge", "bridge"),
        *number_channels("ai", 16, "voltage_in", "ai"),
        *number_channels("ctr", 2, "counter", "ctr"),
        *number_channels("port0/line", 8, "static_line", "line"),
    ),
    terminals=(r"PFI[0-9]", r"RTSI[0-6]", r"Ctr[01]Out"),
    differential=tuple(range(8)),
    ai_max_rate_hz=200e3,
    ai_aggregate_rate_hz=200e3,
    ai_ranges_v=(0.05, 0.5, 5.0, 10.0),
    counter_timebase_hz=20e6,
    counter_pins={"": CounterPins(source=("PFI8", "PFI3"), out=("Ctr0Out", "Ctr1Out"))},
    timebase_hz=20e6,
    timebases=E_SERIES_TIMEBASES,
    internal=("ai/SampleClock", "ai/StartTrigger"),
    bridge_range_mv_per_v=5.0,
    bridge_bits=16,
    bridge_excitation_v=tuple(0.625 * k for k in range(1, 17)),
    bridge_decimates=False,
    bridge_delay_s=2.613 / (2 * math.pi * 10e3),
)

PCI_6602 = Product(
    name="PCI-6602",
    rtsi=True,
    channels=(*number_channels("ctr", 8, "counter", "ctr"), *number_channels("port0/line", 32, "static_line", "line")),
    terminals=(r"PFI([12][0-9]|3[0-9]|[0-9])", r"RTSI[0-6]"),
    counter_timebase_hz=80e6,
    counter_pins={
        "": CounterPins(
            source=tuple(f"PFI{39 - 4 * k}" for k in range(8)),
            auxiliary=tuple(f"PFI{37 - 4 * k}" for k in range(8)),
            out=tuple(f"PFI{36 - 4 * k}" for k in range(8)),
        )
    },
    timebase_hz=20e6,
    internal=(),
    timebases=r"(80|20)MHzTimebase|100kHzTimebase|Ctr[0-7]InternalOutput",
)

PCI_6733 = Product(
    name="PCI-6733",
    rtsi=True,
    channels=(
        *number_channels("ao", 8, "voltage_out", "ao"),
        *number_channels("ctr", 2, "counter", "ctr"),
        *number_channels("port0/line", 8, "static_line", "line"),
    ),
    terminals=(r"PFI[0-9]", r"RTSI[0-6]", r"Ctr[01]Out"),
    ao_max_rate_hz=1e6,
    counter_timebase_hz=20e6,
    counter_pins={"": CounterPins(source=("PFI8", "PFI3"), out=("Ctr0Out", "Ctr1Out"))},
    timebase_hz=20e6,
    timebases=E_SERIES_TIMEBASES,
    internal=("ao/SampleClock", "ao/StartTrigger"),
)


PRODUCTS = {product.name: product for product in (CDAQ_9189, PCIE_6363, PCI_6034E, PCI_6602, PCI_6733)}


Pin = Literal["source", "auxiliary", "out"]


@dataclass(frozen=True)
class PhysicalChannel:
    """One physical channel: full name, kind, and the hardware resource a task on it takes."""

    name: str
    kind: Kind
    resource: str


def channel_names(text: str) -> list[str]:
    """Return the names in a list such as ``Dev1/ai0:2, Dev1/ai7``, its ranges expanded, in its order; refuse an empty
    list. Whether a channel exists is not checked."""
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
        """Name in the system of a channel or terminal, from that within the device: ``ai0`` of card ``Dev1`` is
        ``Dev1/ai0``, ``Mod1/ai0`` of chassis ``cDAQ1`` is ``cDAQ1Mod1/ai0``.

        What begins with a slash is named in full already, an SCXI module by its own chassis.
        """
        if relative.startswith(("/", "SC")):
            return relative.removeprefix("/")
        return self.name + relative if relative.startswith("Mod") else f"{self.name}/{relative}"

    def devices(self) -> dict[str, str]:
        return {name: kind for one in (self, *self._others) for name, kind in one.own_devices().items()}

    def own_devices(self) -> dict[str, str]:
        modules = {self.full_name(name): kind for name, kind in self.product.modules}
        return {self.name: self.product.name, **modules}

    def owner_of(self, name: str) -> Inventory:
        """Return the device that a channel, terminal or device of this name belongs to; else the main one."""
        if self._others:
            first = name.removeprefix("/").split("/", 1)[0].lower()
            for other in self._others:
                if first in (known.lower() for known in other.own_devices()):
                    return other
        return self

    def own_name(self, terminal: str) -> str:
        owner = self.owner_of(terminal) if terminal.startswith("/") else self
        return terminal if owner is self else terminal[1 + len(owner.name) :].lstrip("/")

    def known_as(self, owner: Inventory, relative: str) -> str:
        """Return the name by which a terminal of a device is known here."""
        return relative if owner is self or relative.startswith("/") else "/" + owner.full_name(relative)

    def are_linked(self, one: Inventory, other: Inventory) -> bool:
        return one is other or {one.name, other.name} <= self._linked

    def channel(self, name: str, kind: Kind) -> PhysicalChannel:
        """Return the physical channel of a full name such as ``Dev1/ai0``, in capitals or small letters; refuse, as the
        driver does, an unknown device or name, and a channel of another kind."""
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
        return [channel.name for channel in self._channels.values() if channel.kind in kinds]

    def lines(self, text: str) -> list[PhysicalChannel]:
        """Return the digital lines that a list such as ``Dev1/port0/line0:7`` names, of ``Dev1/port0`` all lines of the
        port; refuse, as the driver does, a name that is no line."""
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
        """Return the default terminal of a counter's ``pin``, source, auxiliary or out: relative to this device, in
        full with a slash where another device has the counter, "" where there is none."""
        if (owner := self.owner_of(channel.name)) is not self:
            found = owner.counter_terminal(channel, pin)
            return self.known_as(owner, found) if found else ""
        module = channel.name.split("/", 1)[0].removeprefix(self.name)
        pins = self.product.counter_pins.get(module)
        found = getattr(pins, pin)[int(channel.resource.removeprefix("ctr"))] if pins and getattr(pins, pin) else ""
        return f"{module}/{found}" if module and found else found

    def line(self, name: str) -> PhysicalChannel:
        return self._channels[name.lower()]

    def terminal(self, name: str, *, output: bool = False) -> str:
        """Check a terminal's name such as ``/cDAQ1/ai/SampleClock`` and return it relative to this device, in full
        where another device has it; ``output``: refuse one that cannot put a signal out.

        A name that does not begin with a slash, such as ``ai/SampleClock``, is one of this device.
        """
        if "/" in name and (owner := self.owner_of(name)) is not self:
            return self.known_as(owner, owner.terminal("/" + name.removeprefix("/"), output=output))
        if (name, output) not in self._terminals:
            self._terminals[name, output] = self._relative_terminal(name, output)
        return self._terminals[name, output]

    def _relative_terminal(self, name: str, output: bool) -> str:
        """Canonical name of a terminal without its device; refuses unknown ones, and inputs as an output."""
        given, owner = name, self.name.lower()
        if not name.startswith("/"):
            mine = re.match(re.escape(owner) + r"(mod\d+)?/", name, re.IGNORECASE)
            name = f"/{name}" if mine else f"/{self.name}/{name}"
        if not name.lower().startswith("/" + owner):
            raise DaqStatusError(Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING, f"Terminal: {name!r}")
        relative = self._canonical_name(name[1 + len(owner) :].lstrip("/"))
        name = f"/{self.name}{name[1 + len(owner) :]}"
        name = name[: len(name) - len(relative)] + relative
        patterns = (*self.product.terminals, self.product.timebases)
        known = relative in self.product.internal or any(re.fullmatch(p, relative) for p in patterns)
        spelled = "/" + self.full_name(relative) == name
        if spelled and re.fullmatch(self.product.unsimulated, relative):
            raise NotAnswered(f"terminal {name}")
        if not (known and spelled):
            raise DaqStatusError(Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING, f"Terminal: {given!r}")
        inputs = self.product.input_only_terminals
        inside = relative in self.product.internal or re.fullmatch(self.product.timebases, relative)
        if output and (inside or re.fullmatch(inputs, relative)):
            raise DaqStatusError(Code.ROUTE_NOT_SUPPORTED_BY_HW_ROUTING, f"Terminal: {name!r} is an input")
        return relative

    def _canonical_name(self, relative: str) -> str:
        """Return a terminal's name within the device in the product's own capitals and small letters, which the driver
        does not tell apart; whether the terminal exists is not checked."""
        for known in self.product.internal:
            if known.lower() == relative.lower():
                return known
        for word in ("PFI", "RTSI", "Mod", "MHzTimebase", "kHzTimebase", "Ctr", "InternalOutput"):
            relative = re.sub(rf"(?<![a-z]){word}(?=\d|/|$)|{word}$", word, relative, flags=re.IGNORECASE)
        return relative

    def coerced_rate(self, rate_hz: float, kind: Kind, channels: int) -> float:
        """Return the real rate of a sample clock, Hz, coerced up from ``rate_hz``: 50 kHz/n (n to 31) for bridge
        modules, else the timebase over n, a counter's as it is; refuse more than ``channels`` channels of this kind can
        do."""
        product = self.product
        if not rate_hz > 0 or (kind != "counter" and rate_hz < product.timebase_hz / 2**32):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Sample clock rate: {rate_hz:g}")
        if kind == "counter":
            return rate_hz  # not generated: the clock comes from a terminal
        if kind == "voltage_out":
            most = product.ao_rates_hz[channels - 1] if product.ao_rates_hz else product.ao_max_rate_hz
        else:
            shared = product.ai_aggregate_rate_hz if channels > 1 else math.inf
            most = min(product.ai_max_rate_hz, shared / channels)
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
        """Return the range a voltage input uses, as half its span, V: the least that covers its limits."""
        return self.voltage_range(settings["min_val"], settings["max_val"])

    def voltage_range(self, low_v: float, high_v: float) -> float:
        """Return the input range that covers the limits asked for, as half its span, V."""
        need = max(abs(low_v), abs(high_v))
        for half in self.product.ai_ranges_v:
            if need <= half * (1 + 1e-9):
                return half
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Input limits {low_v:g} to {high_v:g} V are out of range")
