"""Properties of a virtual channel that a client may ask for, by the driver's names: what it was created with, and what
follows from it.

Each getter returns None for a type of channel that does not have the property; the caller refuses then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rig.simulated import daqmx
from rig.simulated.device.scales import find_scale
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.product.inventory import channel_names
from rig.simulated.rpc.messages import property_number
from rig.simulated.signals import latch_now
from rig.simulated.status import Code, DaqStatusError, Unsupported

CHANNEL_TYPE = {"AI": 10100, "AO": 10102, "DI": 10151, "DO": 10153, "CI": 10131, "CO": 10132}
CI_TYPE = {
    daqmx.EDGES: 10125, daqmx.FREQUENCY: 10179, daqmx.PERIOD: 10256, daqmx.WIDTH: 10359,
    daqmx.PULSE_FREQUENCY: 15864, daqmx.PULSE_TIME: 15865, daqmx.PULSE_TICKS: 15866,
}  # fmt: skip
FORCE_BRIDGE, ANGULAR_ENCODER = 15899, 10360
AI_TYPE = {"bridge": FORCE_BRIDGE, "voltage_in": daqmx.VOLTAGE}
BITS, RIGHT_JUSTIFIED = 10109, 10279
LIMITS = {
    property_number("Chan", f"{type_}_{end}"): (type_, f"{end.lower()}_val")
    for type_ in ("AI", "AO")
    for end in ("MAX", "MIN")
} | {property_number("Chan", f"AI_RNG_{end}"): ("AI", "range_v") for end in ("HIGH", "LOW")}
"""Task type and setting of the properties that hold a channel's limits."""
SCALES = {property_number("Chan", f"{type_}_CUSTOM_SCALE_NAME"): type_ for type_ in ("AI", "AO")}
"""Task type of the properties that name a custom scale."""
Property = Callable[[DeviceState, SimulatedTask, Channel], Any]

SETTINGS = {
    "CI_FREQ_STARTING_EDGE": "edge",
    "CI_FREQ_MEAS_METH": "method",
    "CI_FREQ_MEAS_TIME": "meas_time",
    "CI_FREQ_DIV": "divisor",
    "CI_PERIOD_STARTING_EDGE": "edge",
    "CI_PERIOD_MEAS_METH": "method",
    "CI_PERIOD_MEAS_TIME": "meas_time",
    "CI_PERIOD_DIV": "divisor",
    "CI_PULSE_WIDTH_STARTING_EDGE": "edge",
    "CI_TWO_EDGE_SEP_FIRST_EDGE": "first_edge",
    "CI_TWO_EDGE_SEP_SECOND_EDGE": "second_edge",
    "CI_CTR_TIMEBASE_SRC": "timebase_src",
    "AI_TERM_CFG": "terminal_config",
    "AI_FORCE_UNITS": "units",
    "AI_THRMCPL_TYPE": "thermocouple_type",
    "AI_THRMCPL_CJC_SRC": "cjc_source",
    "AI_THRMCPL_CJC_VAL": "cjc_val",
    "CI_MAX": "max_val",
    "CI_MIN": "min_val",
    "CI_COUNT_EDGES_ACTIVE_EDGE": "edge",
    "CI_COUNT_EDGES_DIR": "count_direction",
    "CI_COUNT_EDGES_INITIAL_CNT": "initial_count",
    "CI_ENCODER_DECODING_TYPE": "decoding_type",
    "CI_ENCODER_Z_INDEX_ENABLE": "zidx_enable",
    "CI_ENCODER_Z_INDEX_VAL": "zidx_val",
    "CI_ENCODER_Z_INDEX_PHASE": "zidx_phase",
    "CI_ANG_ENCODER_UNITS": "units",
    "CI_ANG_ENCODER_PULSES_PER_REV": "pulses_per_rev",
    "CI_ANG_ENCODER_INITIAL_ANGLE": "initial_angle",
    "CI_LIN_ENCODER_DIST_PER_PULSE": "dist_per_pulse",
    "CI_LIN_ENCODER_INITIAL_POS": "initial_pos",
    "CO_OUTPUT_TYPE": "output_type",
    "CO_PULSE_IDLE_STATE": "idle_state",
}
"""Properties that are the settings a channel was created with."""
UNITS_OF = {
    "CI_FREQ_UNITS": daqmx.FREQUENCY,
    "CI_PERIOD_UNITS": daqmx.PERIOD,
    "CI_PULSE_WIDTH_UNITS": daqmx.WIDTH,
    "CI_PULSE_FREQ_UNITS": daqmx.PULSE_FREQUENCY,
    "CI_PULSE_TIME_UNITS": daqmx.PULSE_TIME,
}
"""Units of each measurement; a channel that measures something else does not have the property."""


def _half_range(device: DeviceState, channel: Channel) -> float | None:
    if channel.physical.kind != "voltage_in":
        return None
    return device.inventory.of(channel.physical.name).half_range(channel.settings)


def _range_low(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
    half = _half_range(device, channel)
    return None if half is None else -half


def _limit(end: str) -> Property:
    """The largest or smallest value expected of an analog input: coerced to the converter's range, as by the driver."""

    def get(device: DeviceState, task: SimulatedTask, channel: Channel) -> float | None:
        half = _half_range(device, channel)
        volts = [channel.settings["min_val"], channel.settings["max_val"]] if half is None else [-half, half]
        scale = channel.settings.get("scale")
        ends = volts if scale is None else scale.scaled(volts).tolist()
        return float(max(ends) if end == "max" else min(ends))

    return get


def _bits(device: DeviceState, channel: Channel) -> int:
    product = device.inventory.of(channel.physical.name).product
    return product.ai_bits if channel.physical.kind == "voltage_in" else product.bridge_bits


def _scale_name(device: DeviceState, task: SimulatedTask, channel: Channel) -> str | None:
    scale = channel.settings.get("scale")
    return "" if scale is None else str(scale.name)


def _voltage_units(device: DeviceState, task: SimulatedTask, channel: Channel) -> int | None:
    if not channel.physical.kind.startswith("voltage") or "thermocouple_type" in channel.settings:
        return None
    return daqmx.FROM_CUSTOM_SCALE if "scale" in channel.settings else daqmx.VOLTS


def set_scale(device: DeviceState, channel: Channel, name: str) -> None:
    """Give a voltage channel another custom scale, or none for an empty name."""
    if not channel.physical.kind.startswith("voltage"):
        raise Unsupported(f"custom scale of {channel.name}")
    if name:
        channel.settings["scale"] = find_scale(device.scales, name)
    else:
        channel.settings.pop("scale", None)


def _of_voltage(value: int | float) -> Property:
    return lambda device, task, channel: value if channel.physical.kind.startswith("voltage") else None


def _coefficients(device: DeviceState, task: SimulatedTask, channel: Channel) -> list[float] | None:
    if channel.physical.kind == "bridge":
        product = device.inventory.of(channel.physical.name).product
        return [0.0, 2e-3 * product.bridge_range_mv_per_v / 2**product.bridge_bits]  # V/V
    step = volts_per_code(device, channel)
    return None if step is None else [0.0, step]


def _count(device: DeviceState, task: SimulatedTask, channel: Channel) -> int | None:
    if task.measures not in (None, daqmx.EDGES):
        return None
    return int(latch_now(device, task)[0, 0]) % 2**32 if task.progress.live else 0


def _high_time(device: DeviceState, task: SimulatedTask, channel: Channel) -> float:
    duty = task.setting("Chan", channel.name, daqmx.CO_PULSE_DUTY_CYC, 0.5)
    return float(duty / task.setting("Chan", channel.name, daqmx.CO_PULSE_FREQ, 1.0))


def _low_time(device: DeviceState, task: SimulatedTask, channel: Channel) -> float:
    period = 1 / task.setting("Chan", channel.name, daqmx.CO_PULSE_FREQ, 1.0)
    return float(period - _high_time(device, task, channel))


_GETTERS: dict[str, Property] = {
    "CHAN_TYPE": lambda device, task, channel: CHANNEL_TYPE[task.type or ""],
    "PHYSICAL_CHAN_NAME": lambda device, task, channel: channel.physical.name,
    "CHAN_DESCR": lambda device, task, channel: "",
    "CHAN_IS_GLOBAL": lambda device, task, channel: False,
    "AI_MEAS_TYPE": lambda device, task, channel: channel.settings.get("type", AI_TYPE[channel.physical.kind]),
    "AI_VOLTAGE_UNITS": _voltage_units,
    "AI_CUSTOM_SCALE_NAME": _scale_name,
    "AO_CUSTOM_SCALE_NAME": _scale_name,
    "AO_MAX": _limit("max"),
    "AO_MIN": _limit("min"),
    "AI_MAX": _limit("max"),
    "AI_MIN": _limit("min"),
    "AI_RNG_HIGH": lambda device, task, channel: _half_range(device, channel),
    "AI_RNG_LOW": _range_low,
    "AI_RESOLUTION": lambda device, task, channel: float(_bits(device, channel)),
    "AI_RESOLUTION_UNITS": lambda device, task, channel: BITS,
    "AI_RAW_SAMP_SIZE": lambda device, task, channel: raw_sample_bits(device, task, channel),
    "AI_RAW_SAMP_JUSTIFICATION": lambda device, task, channel: RIGHT_JUSTIFIED,
    "AI_DEV_SCALING_COEFF": _coefficients,
    "AO_OUTPUT_TYPE": _of_voltage(daqmx.VOLTAGE),
    "AO_VOLTAGE_UNITS": _voltage_units,
    "AO_RESOLUTION": _of_voltage(16.0),
    "AO_DAC_RNG_HIGH": lambda device, task, channel: device.inventory.of(channel.physical.name).product.ao_range_v,
    "AO_DAC_RNG_LOW": lambda device, task, channel: -device.inventory.of(channel.physical.name).product.ao_range_v,
    "DI_NUM_LINES": lambda device, task, channel: len(channel.settings["lines"]),
    "DO_NUM_LINES": lambda device, task, channel: len(channel.settings["lines"]),
    "CI_MEAS_TYPE": lambda device, task, channel: CI_TYPE.get(
        channel.settings.get("measures", ""), channel.settings.get("type", ANGULAR_ENCODER)
    ),
    "CI_CUSTOM_SCALE_NAME": _scale_name,
    "CI_COUNT": _count,
    "CO_PULSE_HIGH_TIME": _high_time,
    "CO_PULSE_LOW_TIME": _low_time,
    "CO_PULSE_TIME_INITIAL_DELAY": lambda device, task, channel: task.setting(
        "Chan", channel.name, daqmx.CO_PULSE_FREQ_INITIAL_DELAY, None
    ),
    "CO_PULSE_DONE": lambda device, task, channel: task.done,
}
_NAME_OF_NUMBER = {property_number("Chan", name): name for name in (*_GETTERS, *SETTINGS, *UNITS_OF)}


def channel_property(device: DeviceState, task: SimulatedTask, channel: Channel, number: int) -> Any:
    """Return a property of a channel by the driver's number; None where the channel does not have it."""
    name = _NAME_OF_NUMBER.get(number, "")
    if name[:2] in CHANNEL_TYPE and name[:2] != task.type:
        return None
    units = {*UNITS_OF, "CI_ANG_ENCODER_UNITS", "CI_LIN_ENCODER_UNITS"}
    if "scale" in channel.settings and task.type == "CI" and name in units:
        return daqmx.FROM_CUSTOM_SCALE
    if name in SETTINGS:
        return channel.settings.get(SETTINGS[name])
    if name in UNITS_OF:
        return channel.settings["units"] if channel.settings.get("measures") == UNITS_OF[name] else None
    return _GETTERS[name](device, task, channel) if name else None


def raw_sample_bits(device: DeviceState, task: SimulatedTask, channel: Channel) -> int | None:
    """Return the bits of a raw sample of an analog input: whole words; None for other channels."""
    if task.type != "AI":
        return None
    return 16 if _bits(device, channel) <= 16 else 32


def volts_per_code(device: DeviceState, channel: Channel) -> float | None:
    """Return the converter's step of a voltage input, V; None for other channels."""
    half = _half_range(device, channel)
    return None if half is None else 2 * half / 2 ** device.inventory.of(channel.physical.name).product.ai_bits


def set_limit(device: DeviceState, task: SimulatedTask, channel: Channel, attribute: int, value: float) -> None:
    """Change the largest or smallest value expected of a voltage channel, within what the product has."""
    wanted, limit = LIMITS[attribute]
    if limit == "range_v":
        if task.type != "AI" or channel.physical.kind != "voltage_in" or not np.isfinite(value):
            raise Unsupported(f"Property: 0x{attribute:04X} of {channel.name}")
        channel.settings["range_v"] = device.inventory.of(channel.physical.name).voltage_range(-abs(value), abs(value))
        return
    if task.type != wanted or channel.physical.kind not in ("voltage_in", "voltage_out"):
        raise Unsupported(f"Property: 0x{attribute:04X} of {channel.name}")
    limits = {**channel.settings, limit: float(value)}
    if not np.isfinite(value):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Channel: {channel.name}, limit {value:g}")
    if wanted == "AI":
        device.inventory.of(channel.physical.name).voltage_range(limits["min_val"], limits["max_val"])
    elif abs(value) > device.inventory.of(channel.physical.name).product.ao_range_v:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Channel: {channel.name}, limit {value:g} V")
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
        raise DaqStatusError(Code.PHYSICAL_CHAN_DOES_NOT_EXIST, f"Channel: {name!r} in task {task.name}")
    return found
