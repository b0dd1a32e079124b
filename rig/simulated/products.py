"""What each product can do: channels, ranges, rates and terminals, as the real one would refuse or coerce.

Sources: NI data sheets and manuals of PCIe-6363 (X Series), cDAQ-9189, NI 9237, 9263, 9411 and 9401; the
input delay of the 9237 is (40 + 5/512)/fs + 4.5 µs (NI knowledge base kA00Z0000004A0YSAU). Modules sit in
fixed slots: 9237, 9263, 9411, 9401 in 1 to 4.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any, Literal

from rig.simulated import status
from rig.simulated.status import DaqStatusError

DIGITAL_RATE_HZ = 10e6
Kind = Literal["bridge", "voltage_in", "voltage_out", "counter", "line", "static_line"]


@dataclass(frozen=True)
class PhysicalChannel:
    """One physical channel: full name, kind, and the hardware resource a task on it takes."""

    name: str
    kind: Kind
    resource: str


@dataclass(frozen=True)
class Product:
    """Table of one product (a chassis with its modules counts as one)."""

    name: str
    channels: tuple[tuple[str, Kind, str], ...]
    """(name relative to the device, kind, resource)"""
    terminals: tuple[str, ...]
    """Terminals by pattern, relative to the device."""
    ao_range_v: float
    ao_max_rate_hz: float
    ai_max_rate_hz: float
    counter_timebase_hz: float
    bridge_range_mv_per_v: float = 0.0
    bridge_bits: int = 24
    bridge_excitation_v: tuple[float, ...] = ()
    ai_ranges_v: tuple[float, ...] = ()
    encoder_terminals: tuple[tuple[str, str], ...] = ()
    """A and B terminals each counter has unless told otherwise; empty: they must be told."""
    edge_terminals: tuple[str, ...] = ()
    """Terminal on which each counter counts edges unless told otherwise; empty: it must be told."""
    pulse_terminals: tuple[str, ...] = ()
    """Terminal on which each counter puts out pulses unless told otherwise."""
    clocked_lines: bool = False
    """Whether digital lines can have a sample clock."""
    change_detection: bool = False
    ai_aggregate_rate_hz: float = math.inf
    """Sum of the rates of several AI channels on one converter."""
    ao_rates_hz: tuple[float, ...] = ()
    """Largest AO rate with one, two, … channels; empty: ``ao_max_rate_hz`` for each."""
    timebase_hz: float = 100e6
    ai_bits: int = 16
    watchdog_reach: tuple[Kind, ...] = ()
    """Kinds of outputs the product's watchdog timer can put into a state."""
    input_only_terminals: str = r"(?!)"
    internal: tuple[str, ...] = field(
        default=tuple(
            f"{kind}/{signal}" for kind in ("ai", "ao", "di", "do") for signal in ("SampleClock", "StartTrigger")
        )
    )
    timebases: str = r"(?!)"
    """Terminals that carry clocks of the device itself, by pattern."""

    def count_terminal(self, channel: Any) -> str:
        """Return the terminal on which a counter counts edges unless told otherwise."""
        number = int(channel.physical.resource.removeprefix("ctr"))
        if not self.edge_terminals:
            raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Channel: {channel.name}: its input terminal must be told")
        return self.edge_terminals[number]

    def pulse_terminal(self, resource: str) -> str:
        """Return the terminal on which a counter puts out pulses unless told otherwise; "" for none."""
        return self.pulse_terminals[int(resource.removeprefix("ctr"))] if self.pulse_terminals else ""


def _numbered(prefix: str, count: int, kind: Kind, resource: str) -> tuple[tuple[str, Kind, str], ...]:
    return tuple((f"{prefix}{i}", kind, f"{resource}{i}") for i in range(count))


CDAQ_9189 = Product(
    name="cDAQ-9189",
    channels=(
        *_numbered("Mod1/ai", 4, "bridge", "bridge"),
        *_numbered("Mod2/ao", 4, "voltage_out", "ao"),
        *_numbered("Mod3/ctr", 4, "counter", "ctr"),
        *_numbered("Mod4/ctr", 4, "counter", "ctr"),
        *_numbered("Mod4/port0/line", 8, "line", "pin4."),
    ),
    terminals=(r"Mod3/PFI[0-5]", r"Mod4/PFI[0-7]"),
    ao_range_v=10.0,
    ao_max_rate_hz=100e3,
    ai_max_rate_hz=50e3,
    counter_timebase_hz=80e6,
    bridge_range_mv_per_v=25.0,
    bridge_excitation_v=(2.5, 3.3, 5.0, 10.0),
    input_only_terminals=r"Mod3/PFI\d+",
    watchdog_reach=("voltage_out", "line"),
    clocked_lines=True,
    change_detection=True,
    timebase_hz=80e6,
    timebases=r"(80|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
)

PCIE_6363 = Product(
    name="PCIe-6363",
    channels=(
        *_numbered("ai", 32, "voltage_in", "ai"),
        *_numbered("ao", 4, "voltage_out", "ao"),
        *_numbered("ctr", 4, "counter", "ctr"),
        *_numbered("port0/line", 32, "line", "pin0."),
        *_numbered("port1/line", 8, "static_line", "PFI PFI"),
        *((f"port2/line{i}", "static_line", f"PFI PFI{8 + i}") for i in range(8)),
    ),
    terminals=(r"PFI(1[0-5]|[0-9])",),
    ao_range_v=10.0,
    ao_max_rate_hz=2.86e6,
    ai_max_rate_hz=2e6,
    counter_timebase_hz=100e6,
    ai_ranges_v=(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
    encoder_terminals=(("PFI8", "PFI10"), ("PFI3", "PFI11"), ("PFI0", "PFI1"), ("PFI5", "PFI6")),
    edge_terminals=("PFI8", "PFI3", "PFI0", "PFI5"),
    pulse_terminals=("PFI12", "PFI13", "PFI14", "PFI15"),
    clocked_lines=True,
    change_detection=True,
    ai_aggregate_rate_hz=1e6,
    ao_rates_hz=(2.86e6, 2.0e6, 1.54e6, 1.25e6),
    timebases=r"(100|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
    watchdog_reach=("line",),  # X Series manual: digital and PFI lines, not the analog outputs
)

PRODUCTS = {product.name: product for product in (CDAQ_9189, PCIE_6363)}


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
        raise DaqStatusError(status.NO_SUCH_CHANNEL, f"Physical Channel: {text!r}")
    return names


class Inventory:
    """A product under the name it has in the system, e.g. chassis ``cDAQ1`` with modules ``cDAQ1Mod1`` …"""

    def __init__(self, product: Product, name: str) -> None:
        self.product = product
        self.name = name
        self._channels = {
            self.full_name(relative).lower(): PhysicalChannel(self.full_name(relative), kind, resource)
            for relative, kind, resource in product.channels
        }

    def full_name(self, relative: str) -> str:
        """Name of a channel or terminal in the system: a module's name follows its chassis's, no slash."""
        return self.name + relative if relative.startswith("Mod") else f"{self.name}/{relative}"

    def channel(self, name: str, kind: Kind) -> PhysicalChannel:
        """Look up a physical channel and refuse a wrong device, name or kind as the driver does."""
        device = name.split("/", 1)[0]
        if not device.lower().startswith(self.name.lower()):
            raise DaqStatusError(status.INVALID_DEVICE, f"Device: {device}")
        channel = self._channels.get(name.lower())
        if channel is None:
            raise DaqStatusError(status.NO_SUCH_CHANNEL, f"Physical Channel: {name}")
        if channel.kind != kind:
            output = kind in ("voltage_out",)
            code = status.WRONG_OUTPUT_TYPE if output else status.WRONG_MEASUREMENT_TYPE
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

    def line(self, name: str) -> PhysicalChannel:
        """Return one digital line by its full name."""
        return self._channels[name.lower()]

    def terminal(self, name: str, *, output: bool = False) -> str:
        """Check a terminal name such as ``/cDAQ1/ai/SampleClock``; return it relative to the device."""
        if not name.startswith("/" + self.name):
            raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Terminal: {name!r}")
        relative = name[1 + len(self.name) :].lstrip("/")
        patterns = (*self.product.terminals, self.product.timebases)
        known = relative in self.product.internal or any(re.fullmatch(p, relative) for p in patterns)
        if not known or "/" + self.full_name(relative) != name:
            raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Terminal: {name!r}")
        inputs = self.product.input_only_terminals
        inside = relative in self.product.internal or re.fullmatch(self.product.timebases, relative)
        if output and (inside or re.fullmatch(inputs, relative)):
            raise DaqStatusError(status.NO_ROUTE, f"Terminal: {name!r} is an input")
        return relative

    def coerced_rate(self, rate_hz: float, kind: Kind, channels: int) -> float:
        """Return a sample clock's real rate, coerced up: 50 kHz/n (n to 31) for bridges, else the timebase over n.

        Raises DaqStatusError above what the product can do with so many channels.
        """
        product = self.product
        if not rate_hz > 0:
            raise DaqStatusError(status.INVALID_VALUE, f"Sample clock rate: {rate_hz:g}")
        most = DIGITAL_RATE_HZ
        if kind in ("bridge", "voltage_in"):
            most = (
                product.ai_max_rate_hz
                if channels == 1
                else min(product.ai_max_rate_hz, product.ai_aggregate_rate_hz / channels)
            )
        elif kind == "voltage_out":
            most = product.ao_rates_hz[channels - 1] if product.ao_rates_hz else product.ao_max_rate_hz
        elif kind == "counter":
            return rate_hz  # told, not generated: the clock comes from a terminal
        if rate_hz > most * (1 + 1e-9):
            raise DaqStatusError(status.RATE_TOO_HIGH, f"Requested {rate_hz:g}, maximum {most:g}")
        if kind == "bridge":
            return 50e3 / min(max(math.floor(50e3 / rate_hz * (1 + 1e-12)), 1), 31)
        return product.timebase_hz / math.floor(product.timebase_hz / rate_hz * (1 + 1e-12))

    def input_delay_s(self, kind: Kind, rate_hz: float) -> float:
        """Delay between the signal and its sample: the 9237's decimation filter; none otherwise."""
        return (40 + 5 / 512) / rate_hz + 4.5e-6 if kind == "bridge" else 0.0

    def voltage_range(self, low_v: float, high_v: float) -> float:
        """Return the input range that covers the limits asked for, as half its span, V."""
        need = max(abs(low_v), abs(high_v))
        for half in self.product.ai_ranges_v:
            if need <= half * (1 + 1e-9):
                return half
        raise DaqStatusError(status.INVALID_VALUE, f"Input limits {low_v:g} to {high_v:g} V are out of range")
