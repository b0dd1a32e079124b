"""Properties of a virtual channel that a client may ask for, by the driver's names: what it was created with, and what
follows from it.

Each getter returns None for a type of channel that does not have the property; the caller refuses then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.product.inventory import channel_names
from rig.simulated.rpc.messages import property_number
from rig.simulated.signals.input_samples import latch_now
from rig.simulated.status import DaqStatusError

CHANNEL_TYPE = {"AI": 10100, "AO": 10102, "DI": 10151, "DO": 10153, "CI": 10131, "CO": 10132}
CI_TYPE = {
    daqmx.EDGES: 10125, daqmx.FREQUENCY: 10179, daqmx.PERIOD: 10256, daqmx.WIDTH: 10359,
    daqmx.PULSE_FREQUENCY: 15864, daqmx.PULSE_TIME: 15865, daqmx.PULSE_TICKS: 15866,
}  # fmt: skip
FORCE_BRIDGE, ANGULAR_ENCODER = 15899, 10360
MEASUREMENT_TYPE = {
    "bridge": FORCE_BRIDGE,
    "voltage_in": daqmx.VOLTAGE,
    "voltage_out": daqmx.VOLTAGE,
    "counter": ANGULAR_ENCODER,
}
BITS, RIGHT_JUSTIFIED = 10109, 10279
LIMITS = {
    property_number("Chan", f"{type_}_{end}"): (type_, f"{end.lower()}_val")
    for type_ in ("AI", "AO")
    for end in ("MAX", "MIN")
}
"""Task type and setting of the properties that hold a channel's limits."""
Property = Callable[[DeviceState, SimulatedTask, Channel], Any]


def _setting(name: str, *types: str) -> Property:
    return lambda device, task, channel: channel.settings.get(name) if task.type in types else None


def _unit(measures: str) -> Property:
    return lambda device, task, channel: (
        channel.settings["units"] if channel.settings.get("measures") == measures else None
    )


def _fixed(value: int | float, kind: str) -> Property:
    return lambda device, task, channel: value if channel.physical.kind == kind else None


def _range(sign: float) -> Property:
    def get(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
        if channel.physical.kind != "voltage_in":
            return None
        settings = channel.settings
        return sign * device.inventory.voltage_range(settings["min_val"], settings["max_val"])

    return get


def _reach(sign: float) -> Property:
    return lambda device, task, channel: sign * device.inventory.product.ao_range_v if task.type == "AO" else None


def _bits(device: DeviceState, channel: Channel) -> int | None:
    product = device.inventory.product
    return {"voltage_in": product.ai_bits, "bridge": product.bridge_bits}.get(channel.physical.kind)


def _resolution(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
    bits = _bits(device, channel)
    return None if bits is None else float(bits)


def _coefficients(device: DeviceState, task: SimulatedTask, channel: Channel) -> list[float] | None:
    step = volts_per_code(device, channel)
    return None if step is None else [0.0, step]


def _lines(type_: str) -> Property:
    return lambda device, task, channel: len(channel.settings["lines"]) if task.type == type_ else None


def _count(device: DeviceState, task: SimulatedTask, channel: Channel) -> int | None:
    if task.type != "CI" or task.measures not in (None, daqmx.EDGES):
        return None
    return int(latch_now(device, task)[0, 0]) % 2**32 if task.progress.live else 0


def _high_time(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
    if task.type != "CO":
        return None
    return float(
        task.setting("Chan", channel.name, daqmx.CO_PULSE_DUTY_CYC, 0.5)
        / task.setting("Chan", channel.name, daqmx.CO_PULSE_FREQ, 1.0)
    )


def _low_time(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
    high = _high_time(device, task, channel)
    return None if high is None else float(1 / task.setting("Chan", channel.name, daqmx.CO_PULSE_FREQ, 1.0) - high)


_GETTERS: dict[str, Property] = {
    "CHAN_TYPE": lambda device, task, channel: CHANNEL_TYPE[task.type or ""],
    "PHYSICAL_CHAN_NAME": lambda device, task, channel: channel.physical.name,
    "CHAN_DESCR": lambda device, task, channel: "",
    "CHAN_IS_GLOBAL": lambda device, task, channel: False,
    "AI_MEAS_TYPE": lambda device, task, channel: (
        MEASUREMENT_TYPE[channel.physical.kind] if task.type == "AI" else None
    ),
    "CI_MEAS_TYPE": lambda device, task, channel: (
        CI_TYPE.get(channel.settings.get("measures", ""), channel.settings.get("type", ANGULAR_ENCODER))
        if task.type == "CI"
        else None
    ),
    "AI_MAX": _setting("max_val", "AI"),
    "AI_MIN": _setting("min_val", "AI"),
    "AI_TERM_CFG": _setting("terminal_config", "AI"),
    "AI_VOLTAGE_UNITS": _fixed(daqmx.VOLTS, "voltage_in"),
    "AI_FORCE_UNITS": _setting("units", "AI"),
    "AI_RNG_HIGH": _range(1.0),
    "AI_RNG_LOW": _range(-1.0),
    "AI_RESOLUTION": _resolution,
    "AI_RESOLUTION_UNITS": lambda device, task, channel: BITS if task.type == "AI" else None,
    "AI_RAW_SAMP_SIZE": lambda device, task, channel: raw_sample_bits(device, channel),
    "AI_RAW_SAMP_JUSTIFICATION": lambda device, task, channel: RIGHT_JUSTIFIED if task.type == "AI" else None,
    "AI_DEV_SCALING_COEFF": _coefficients,
    "AO_MAX": _setting("max_val", "AO"),
    "AO_MIN": _setting("min_val", "AO"),
    "AO_OUTPUT_TYPE": _fixed(daqmx.VOLTAGE, "voltage_out"),
    "AO_VOLTAGE_UNITS": _fixed(daqmx.VOLTS, "voltage_out"),
    "AO_RESOLUTION": _fixed(16.0, "voltage_out"),
    "AO_RESOLUTION_UNITS": _fixed(BITS, "voltage_out"),
    "AO_DAC_RNG_HIGH": _reach(1.0),
    "AO_DAC_RNG_LOW": _reach(-1.0),
    "DI_NUM_LINES": _lines("DI"),
    "DO_NUM_LINES": _lines("DO"),
    "CI_COUNT": _count,
    "CI_COUNT_EDGES_ACTIVE_EDGE": _setting("edge", "CI"),
    "CI_COUNT_EDGES_DIR": _setting("count_direction", "CI"),
    "CI_COUNT_EDGES_INITIAL_CNT": _setting("initial_count", "CI"),
    "CI_ANG_ENCODER_PULSES_PER_REV": _setting("pulses_per_rev", "CI"),
    "CI_ENCODER_DECODING_TYPE": _setting("decoding_type", "CI"),
    "CI_ANG_ENCODER_UNITS": _setting("units", "CI"),
    "CI_ANG_ENCODER_INITIAL_ANGLE": _setting("initial_angle", "CI"),
    "CI_FREQ_UNITS": _unit(daqmx.FREQUENCY),
    "CI_PERIOD_UNITS": _unit(daqmx.PERIOD),
    "CI_PULSE_WIDTH_UNITS": _unit(daqmx.WIDTH),
    "CI_PULSE_FREQ_UNITS": _unit(daqmx.PULSE_FREQUENCY),
    "CI_PULSE_TIME_UNITS": _unit(daqmx.PULSE_TIME),
    "CI_MAX": _setting("max_val", "CI"),
    "CI_MIN": _setting("min_val", "CI"),
    "CI_LIN_ENCODER_DIST_PER_PULSE": _setting("dist_per_pulse", "CI"),
    "CI_LIN_ENCODER_INITIAL_POS": _setting("initial_pos", "CI"),
    "CO_OUTPUT_TYPE": _setting("output_type", "CO"),
    "CO_PULSE_HIGH_TIME": _high_time,
    "CO_PULSE_LOW_TIME": _low_time,
    "CO_PULSE_TIME_INITIAL_DELAY": lambda device, task, channel: task.setting(
        "Chan", channel.name, daqmx.CO_PULSE_FREQ_INITIAL_DELAY, None
    ),
    "CO_PULSE_IDLE_STATE": _setting("idle_state", "CO"),
    "CO_PULSE_DONE": lambda device, task, channel: task.done if task.type == "CO" else None,
}
_GETTER_OF_NUMBER = {property_number("Chan", name): getter for name, getter in _GETTERS.items()}


def channel_property(device: DeviceState, task: SimulatedTask, channel: Channel, number: int) -> Any:
    """Return a property of a channel by the driver's number; None where the channel does not have it."""
    getter = _GETTER_OF_NUMBER.get(number)
    return getter(device, task, channel) if getter else None


def raw_sample_bits(device: DeviceState, channel: Channel) -> int | None:
    """Return the bits of a raw sample of an analog input: whole words; None for other channels."""
    bits = _bits(device, channel)
    return None if bits is None else 16 if bits <= 16 else 32


def volts_per_code(device: DeviceState, channel: Channel) -> float | None:
    """Return the converter's step of a voltage input, V; None for other channels."""
    if channel.physical.kind != "voltage_in":
        return None
    half = device.inventory.voltage_range(channel.settings["min_val"], channel.settings["max_val"])
    return 2 * half / 2**device.inventory.product.ai_bits


def set_limit(device: DeviceState, task: SimulatedTask, channel: Channel, attribute: int, value: float) -> None:
    """Change the largest or smallest value expected of a voltage channel, within what the product has."""
    wanted, limit = LIMITS[attribute]
    if task.type != wanted or channel.physical.kind not in ("voltage_in", "voltage_out"):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} of {channel.name}")
    limits = {**channel.settings, limit: float(value)}
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
