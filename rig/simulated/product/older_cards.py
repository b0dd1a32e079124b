"""The cards of the thesis's bench, and an analog output card in place of its motion controller.

Sources: user manuals of the NI 6034E/6035E and of the SCXI-1520, specifications of NI 660x and NI 6731/6733. The
SCXI-1520 is read through the card; its filter is a four-pole Butterworth, here at 10 kHz (delay 2.61 / (2 pi f)), its
gain that of a range of 5 mV/V. None of them has a watchdog timer.
"""

from __future__ import annotations

import math

from rig.simulated.product.capabilities import UNSIMULATED, CounterPins, Product, numbered

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
