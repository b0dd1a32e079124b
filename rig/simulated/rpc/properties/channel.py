"""Properties of a virtual channel that a client may ask for, by the driver's number: what it was created with, and what
follows from it.

Each getter returns None for a type of channel that does not have the property; the caller refuses then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.simulated import status
from rig.simulated.device.input_readings import (
    EDGES,
    FREQUENCY,
    PERIOD,
    PULSE_FREQUENCY,
    PULSE_TICKS,
    PULSE_TIME,
    WIDTH,
)
from rig.simulated.device.pulse_trains import CO_DELAY, CO_DUTY, CO_FREQ
from rig.simulated.device.sample_clock import latch
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.product.inventory import channel_names
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

CHANNEL_TYPE = {"AI": 10100, "AO": 10102, "DI": 10151, "DO": 10153, "CI": 10131, "CO": 10132}
CI_TYPE = {
    EDGES: 10125, FREQUENCY: 10179, PERIOD: 10256, WIDTH: 10359, PULSE_FREQUENCY: 15864, PULSE_TIME: 15865,
    PULSE_TICKS: 15866,
}  # fmt: skip
VOLTAGE, FORCE_BRIDGE, ANGULAR_ENCODER = 10322, 15899, 10360
MEASUREMENT_TYPE = {"bridge": FORCE_BRIDGE, "voltage_in": VOLTAGE, "voltage_out": VOLTAGE, "counter": ANGULAR_ENCODER}
VOLTS, BITS, RIGHT_JUSTIFIED = 10348, 10109, 10279
AI_MAX, AI_MIN, AO_MAX, AO_MIN = 0x17DD, 0x17DE, 0x1186, 0x1187
LIMIT_NAMES = {AI_MAX: "max_val", AI_MIN: "min_val", AO_MAX: "max_val", AO_MIN: "min_val"}
CO_HIGH_TIME, CO_LOW_TIME, CO_OUTPUT_TYPE = 0x18BA, 0x18BB, 0x18B5
Property = Callable[["SimulatedDevice", SimulatedTask, Channel], Any]


def _setting(name: str, *types: str) -> Property:
    return lambda device, task, channel: channel.settings.get(name) if task.type in types else None


def _unit(measures: str) -> Property:
    return lambda device, task, channel: (
        channel.settings["units"] if channel.settings.get("measures") == measures else None
    )


def _fixed(value: int | float, kind: str) -> Property:
    return lambda device, task, channel: value if channel.physical.kind == kind else None


def _range(sign: float) -> Property:
    def get(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> float | None:
        if channel.physical.kind != "voltage_in":
            return None
        settings = channel.settings
        return sign * device.inventory.voltage_range(settings["min_val"], settings["max_val"])

    return get


def _reach(sign: float) -> Property:
    return lambda device, task, channel: sign * device.inventory.product.ao_range_v if task.type == "AO" else None


def _bits(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> int | None:
    product = device.inventory.product
    return {"voltage_in": product.ai_bits, "bridge": product.bridge_bits}.get(channel.physical.kind)


def _resolution(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> float | None:
    bits = _bits(device, task, channel)
    return None if bits is None else float(bits)


def _raw_size(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> int | None:
    bits = _bits(device, task, channel)
    return None if bits is None else 16 if bits <= 16 else 32


def _coefficients(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> list[float] | None:
    half = _range(1.0)(device, task, channel)
    return None if half is None else [0.0, 2 * half / 2**device.inventory.product.ai_bits]


def _lines(type_: str) -> Property:
    return lambda device, task, channel: len(channel.settings["lines"]) if task.type == type_ else None


def _count(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> int | None:
    if task.type != "CI" or channel.settings.get("measures") not in (None, EDGES):
        return None
    return int(latch(device, task, *device.bench.present())[0, 0]) % 2**32 if task.live else 0


def _high_time(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> float | None:
    if task.type != "CO":
        return None
    return float(task.setting("Chan", channel.name, CO_DUTY, 0.5) / task.setting("Chan", channel.name, CO_FREQ, 1.0))


def _low_time(device: SimulatedDevice, task: SimulatedTask, channel: Channel) -> float | None:
    high = _high_time(device, task, channel)
    return None if high is None else float(1 / task.setting("Chan", channel.name, CO_FREQ, 1.0) - high)


CHANNEL_GETTABLE: dict[int, Property] = {
    0x187F: lambda device, task, channel: CHANNEL_TYPE[task.type or ""],
    0x18F5: lambda device, task, channel: channel.physical.name,
    0x1926: lambda device, task, channel: "",
    0x2304: lambda device, task, channel: False,
    0x0695: lambda device, task, channel: MEASUREMENT_TYPE[channel.physical.kind] if task.type == "AI" else None,
    0x18A0: lambda device, task, channel: (
        CI_TYPE.get(channel.settings.get("measures", ""), channel.settings.get("type", ANGULAR_ENCODER))
        if task.type == "CI"
        else None
    ),
    AI_MAX: _setting("max_val", "AI"),
    AI_MIN: _setting("min_val", "AI"),
    0x1097: _setting("terminal_config", "AI"),
    0x1094: _fixed(VOLTS, "voltage_in"),
    0x2F75: _setting("units", "AI"),
    0x1815: _range(1.0),
    0x1816: _range(-1.0),
    0x1765: _resolution,
    0x1764: lambda device, task, channel: BITS if task.type == "AI" else None,
    0x22DA: _raw_size,
    0x0050: lambda device, task, channel: RIGHT_JUSTIFIED if task.type == "AI" else None,
    0x1930: _coefficients,
    AO_MAX: _setting("max_val", "AO"),
    AO_MIN: _setting("min_val", "AO"),
    0x1108: _fixed(VOLTAGE, "voltage_out"),
    0x1184: _fixed(VOLTS, "voltage_out"),
    0x182C: _fixed(16.0, "voltage_out"),
    0x182B: _fixed(BITS, "voltage_out"),
    0x182E: _reach(1.0),
    0x182D: _reach(-1.0),
    0x2178: _lines("DI"),
    0x2179: _lines("DO"),
    0x0148: _count,
    0x0697: _setting("edge", "CI"),
    0x0696: _setting("count_direction", "CI"),
    0x0698: _setting("initial_count", "CI"),
    0x0875: _setting("pulses_per_rev", "CI"),
    0x21E6: _setting("decoding_type", "CI"),
    0x18A6: _setting("units", "CI"),
    0x0881: _setting("initial_angle", "CI"),
    0x18A1: _unit(FREQUENCY),
    0x18A3: _unit(PERIOD),
    0x0823: _unit(WIDTH),
    0x2F0B: _unit(PULSE_FREQUENCY),
    0x2F13: _unit(PULSE_TIME),
    0x189C: _setting("max_val", "CI"),
    0x189D: _setting("min_val", "CI"),
    0x0911: _setting("dist_per_pulse", "CI"),
    0x0915: _setting("initial_pos", "CI"),
    CO_OUTPUT_TYPE: _setting("output_type", "CO"),
    CO_HIGH_TIME: _high_time,
    CO_LOW_TIME: _low_time,
    0x18BC: lambda device, task, channel: task.setting("Chan", channel.name, CO_DELAY, None),
    0x1170: _setting("idle_state", "CO"),
    0x190E: lambda device, task, channel: task.done if task.type == "CO" else None,
}


def set_limit(device: SimulatedDevice, task: SimulatedTask, channel: Channel, attribute: int, value: float) -> None:
    """Change the largest or smallest value expected of a voltage channel, within what the product has."""
    wanted = "AI" if attribute in (AI_MAX, AI_MIN) else "AO"
    if task.type != wanted or channel.physical.kind not in ("voltage_in", "voltage_out"):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} of {channel.name}")
    limits = {**channel.settings, LIMIT_NAMES[attribute]: float(value)}
    if not np.isfinite(value):
        raise DaqStatusError(status.INVALID_VALUE, f"Channel: {channel.name}, limit {value:g}")
    if wanted == "AI":
        device.inventory.voltage_range(limits["min_val"], limits["max_val"])
    elif abs(value) > device.inventory.product.ao_range_v:
        raise DaqStatusError(status.INVALID_VALUE, f"Channel: {channel.name}, limit {value:g} V")
    channel.settings.update(limits)


def find_channels(task: SimulatedTask, name: str) -> list[Channel]:
    """Return the channels of a list of names, all of them for an empty one; at least one.

    Digital channels are also found by their lines or their port.
    """
    wanted = set(channel_names(name)) if name.strip() else {""}
    found = []
    for channel in task.channels:
        lines = channel.settings.get("lines", [])
        if wanted & {"", channel.name, *lines, *(line.rsplit("/", 1)[0] for line in lines)}:
            found.append(channel)
    if not found:
        raise DaqStatusError(status.NO_SUCH_CHANNEL, f"Channel: {name!r} in task {task.name}")
    return found
