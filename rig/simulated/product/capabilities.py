"""What each product can do: channels, ranges, rates and terminals, as the real one would refuse or coerce.

Sources: NI data sheets and manuals of PCIe-6363 (X Series), cDAQ-9189, NI 9237, 9263, 9411 and 9401; the
input delay of the 9237 is (40 + 5/512)/fs + 4.5 µs (NI knowledge base kA00Z0000004A0YSAU). Modules sit in
fixed slots: 9237, 9263, 9411, 9401 in 1 to 4.

The cards of the thesis's bench, and an analog output card in place of its motion controller: user manuals of the NI
6034E/6035E and of the SCXI-1520, specifications of NI 660x and NI 6731/6733. The SCXI-1520 is read through the card;
its filter is a four-pole Butterworth, here at 10 kHz (delay 2.61 / (2 pi f)), its gain that of a range of 5 mV/V. None
of them has a watchdog timer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Kind = Literal["bridge", "voltage_in", "voltage_out", "counter", "line", "static_line"]


@dataclass(frozen=True)
class CounterPins:
    """Default terminals of counters 0 to 3; A, Z and B of an encoder are source, gate and auxiliary.

    X Series manual, default counter pins; NI-DAQmx Help, "CompactDAQ counter signal connections" (NI 9401). Counters
    named by the NI 9411 have none.
    """

    source: tuple[str, ...] = ()
    gate: tuple[str, ...] = ()
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
    ao_range_v: float
    ao_max_rate_hz: float
    ai_max_rate_hz: float
    counter_timebase_hz: float
    modules: tuple[tuple[str, str], ...] = ()
    """Modules of a chassis: name behind the chassis's, product type."""
    lines_in_group: Mapping[str, int] = field(default_factory=dict)
    """Lines that have one direction together, by the stem of their pins; others have one each."""
    differential: tuple[int, ...] = ()
    """Numbers of the voltage inputs that can be the positive one of a pair."""
    unsimulated: str = r"(?!)"
    """Terminals that the product has and the virtual device does not, by pattern."""
    bridge_range_mv_per_v: float = 0.0
    bridge_bits: int = 24
    bridge_excitation_v: tuple[float, ...] = ()
    ai_ranges_v: tuple[float, ...] = ()
    counter_pins: Mapping[str, CounterPins] = field(default_factory=dict)
    """Default terminals of the counters, by the module that names the counter ("" on a card)."""
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
    apfi: bool = False
    """Whether it has the analog terminals APFI0 and APFI1."""
    rtsi: bool = False
    """Whether it has a connector for the RTSI cable."""
    timebases: str = r"(?!)"
    """Terminals that carry clocks of the device itself, by pattern."""

    @property
    def chassis(self) -> bool:
        """Whether its modules have converters and timing of their own, as in a chassis."""
        return any(name.startswith("Mod") for name, _ in self.modules)


UNSIMULATED = (
    r"(ai|di|ao|do)/(ReferenceTrigger|PauseTrigger|SampleClockTimebase|ConvertClock|ConvertClockTimebase|HoldCompleteEvent)|"
    r"Ctr[0-7](Source|Gate|Aux|A|B|Z|ArmStartTrigger|SampleClock)|PairedCtrInternalOutput|FrequencyOutput|"
    r"10MHzRefClock|ChangeDetectionEvent|AnalogComparisonEvent|WatchdogExpiredEvent|WatchdogExpirationTrigger|APFI[01]"
)


def numbered(prefix: str, count: int, kind: Kind, resource: str) -> tuple[tuple[str, Kind, str], ...]:
    """Return channels ``prefix0`` … with resources ``resource0`` …"""
    return tuple((f"{prefix}{i}", kind, f"{resource}{i}") for i in range(count))


CDAQ_9189 = Product(
    name="cDAQ-9189",
    counter_pins={
        "Mod4": CounterPins(
            source=("PFI0", "PFI4", "PFI3", "PFI7"),
            gate=("PFI1", "PFI5", "PFI2", "PFI6"),
            auxiliary=("PFI2", "PFI6", "PFI0", "PFI4"),
        )
    },
    lines_in_group={"pin4": 4},  # NI 9401 data sheet: direction by nibble
    modules=(("Mod1", "NI 9237"), ("Mod2", "NI 9263"), ("Mod3", "NI 9411"), ("Mod4", "NI 9401")),
    unsimulated=UNSIMULATED,
    channels=(
        *numbered("Mod1/ai", 4, "bridge", "bridge"),
        *numbered("Mod2/ao", 4, "voltage_out", "ao"),
        *numbered("Mod3/ctr", 4, "counter", "ctr"),
        *numbered("Mod4/ctr", 4, "counter", "ctr"),
        *numbered("Mod4/port0/line", 8, "line", "pin4."),
    ),
    terminals=(r"Mod3/PFI[0-5]", r"Mod4/PFI[0-7]"),
    ao_range_v=10.0,
    ao_max_rate_hz=100e3,
    ai_max_rate_hz=50e3,
    counter_timebase_hz=80e6,
    bridge_range_mv_per_v=25.0,
    bridge_excitation_v=(2.5, 3.3, 5.0, 10.0),
    input_only_terminals=r"Mod3/PFI\d+",
    watchdog_reach=("voltage_out", "line"),  # cDAQ-9185/9189 manual, "Watchdog Timer"
    watchdog_longest_s=(2**32 - 1) * 25e-9,
    expiry_locks=True,
    clocked_lines=True,
    change_detection=True,
    timebase_hz=80e6,
    timebases=r"(80|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
)

PCIE_6363 = Product(
    name="PCIe-6363",
    differential=(*range(8), *range(16, 24)),
    unsimulated=UNSIMULATED,
    channels=(
        *numbered("ai", 32, "voltage_in", "ai"),
        *numbered("ao", 4, "voltage_out", "ao"),
        *numbered("ctr", 4, "counter", "ctr"),
        *numbered("port0/line", 32, "line", "pin0."),
        *numbered("port1/line", 8, "static_line", "PFI PFI"),
        *((f"port2/line{i}", "static_line", f"PFI PFI{8 + i}") for i in range(8)),
    ),
    terminals=(r"PFI(1[0-5]|[0-9])", r"RTSI[0-7]"),
    ao_range_v=10.0,
    ao_max_rate_hz=2.86e6,
    ai_max_rate_hz=2e6,
    counter_timebase_hz=100e6,
    ai_ranges_v=(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
    counter_pins={
        "": CounterPins(
            source=("PFI8", "PFI3", "PFI0", "PFI5"),
            gate=("PFI9", "PFI4", "PFI1", "PFI6"),
            auxiliary=("PFI10", "PFI11", "PFI2", "PFI7"),
            out=("PFI12", "PFI13", "PFI14", "PFI15"),
        )
    },
    clocked_lines=True,
    change_detection=True,
    ai_aggregate_rate_hz=1e6,
    ao_rates_hz=(2.86e6, 2.0e6, 1.54e6, 1.25e6),
    timebases=r"(100|20)MHzTimebase|100kHzTimebase|Ctr[0-3]InternalOutput",
    rtsi=True,
    apfi=True,
    watchdog_reach=("line",),  # X Series manual: digital and PFI lines, not the analog outputs
)


E_SERIES_TIMEBASES = r"20MHzTimebase|100kHzTimebase|Ctr[01]InternalOutput"

PCI_6034E = Product(
    name="PCI-6034E",
    rtsi=True,
    modules=(("SC1Mod1", "SCXI-1520"),),
    unsimulated=UNSIMULATED,
    channels=(
        *numbered("SC1Mod1/ai", 8, "bridge", "bridge"),
        *numbered("ai", 16, "voltage_in", "ai"),
        *numbered("ctr", 2, "counter", "ctr"),
        *numbered("port0/line", 8, "static_line", "line"),
    ),
    terminals=(r"PFI[0-9]", r"RTSI[0-6]", r"Ctr[01]Out"),
    differential=tuple(range(8)),
    ao_range_v=10.0,
    ao_max_rate_hz=1.0,
    ai_max_rate_hz=200e3,
    ai_aggregate_rate_hz=200e3,
    ai_ranges_v=(0.05, 0.5, 5.0, 10.0),
    counter_timebase_hz=20e6,
    counter_pins={"": CounterPins(source=("PFI8", "PFI3"), gate=("PFI9", "PFI4"), out=("Ctr0Out", "Ctr1Out"))},
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
    unsimulated=UNSIMULATED,
    channels=(
        *numbered("ctr", 8, "counter", "ctr"),
        *numbered("port0/line", 32, "static_line", "line"),
    ),
    terminals=(r"PFI([12][0-9]|3[0-9]|[0-9])", r"RTSI[0-6]"),
    ao_range_v=10.0,
    ao_max_rate_hz=1.0,
    ai_max_rate_hz=1.0,
    counter_timebase_hz=80e6,
    counter_pins={
        "": CounterPins(
            source=tuple(f"PFI{39 - 4 * k}" for k in range(8)),
            gate=tuple(f"PFI{38 - 4 * k}" for k in range(8)),
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
    unsimulated=UNSIMULATED,
    channels=(
        *numbered("ao", 8, "voltage_out", "ao"),
        *numbered("ctr", 2, "counter", "ctr"),
        *numbered("port0/line", 8, "static_line", "line"),
    ),
    terminals=(r"PFI[0-9]", r"RTSI[0-6]", r"Ctr[01]Out"),
    ao_range_v=10.0,
    ao_max_rate_hz=1e6,
    ai_max_rate_hz=1.0,
    counter_timebase_hz=20e6,
    counter_pins={"": CounterPins(source=("PFI8", "PFI3"), gate=("PFI9", "PFI4"), out=("Ctr0Out", "Ctr1Out"))},
    timebase_hz=20e6,
    timebases=E_SERIES_TIMEBASES,
    internal=("ao/SampleClock", "ao/StartTrigger"),
)


PRODUCTS = {product.name: product for product in (CDAQ_9189, PCIE_6363, PCI_6034E, PCI_6602, PCI_6733)}
