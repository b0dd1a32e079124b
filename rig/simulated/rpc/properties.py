"""The properties of tasks and their channels that a client may get, set and reset, by the driver's category and name.

Timing: its kind, and rate, source, mode and samples of the sample clock. A task on demand answers with the driver's
defaults and keeps the number of samples that is set for the clock to come.

Virtual channels: what one was created with, and what follows from it. Each getter returns None for a type of channel
that does not have the property; the caller refuses then.

What is not in these tables is refused, never answered with an invented value. Some properties can be set that the
virtual device does not act on: those that change nothing a client can see are only kept; with any other, a task that is
not at its default is refused when it is committed or started, so that a setting is never taken and then ignored.

Analog and pause triggers are taken over from the properties when a task is verified. Built are edges (with hysteresis)
and windows of the first analog input of a card as start and reference triggers, and a digital level that pauses a task
with a sample clock of its own. Other kinds are kept and their tasks refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.simulated import daqmx
from rig.simulated.device.scales import scale_of
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import AnalogShape, Channel, SampleClock, SimulatedTask, Timing
from rig.simulated.driver import configure_clock, find_task
from rig.simulated.product import channel_names
from rig.simulated.rpc.messages import Key, Properties, property_number
from rig.simulated.signals import latch_now
from rig.simulated.status import UNSUPPORTED, Code, DaqStatusError, Unsupported, refuse_any
from rig.simulated.timing import await_something

IMPLICIT, CHANGE_DETECTION, SAMPLE_CLOCK, ON_DEMAND = 10451, 12504, 10388, 10390
"""Sample timing types."""
DEFAULT = SampleClock(1000.0, "", daqmx.CONTINUOUS, 1000)
FEWEST_SAMPLES = 2
"""Of a clocked analog task."""
_KINDS = ("AI", "AO", "DI", "DO")
TIMING_TYPE = property_number("Timing", "SAMP_TIMING_TYPE")
DIVISOR = property_number("Timing", "SAMP_CLK_TIMEBASE_DIV")
FIELDS = {
    property_number("Timing", name): field
    for name, field in (
        ("SAMP_CLK_RATE", "rate_hz"),
        ("SAMP_CLK_SRC", "source"),
        ("SAMP_QUANT_SAMP_MODE", "mode"),
        ("SAMP_QUANT_SAMP_PER_CHAN", "samples"),
    )
}
_BEFORE = ("Timing", "before the divisor", DIVISOR)
NUMBERS = frozenset({*FIELDS, TIMING_TYPE, DIVISOR})
"""Properties of this module."""


def get_clock(device: DeviceState, task: SimulatedTask, number: int) -> Any:
    """Return a property of the timing; refuses what the task's kind of timing does not have."""
    if number == TIMING_TYPE:
        return _timing_type(task)
    field = FIELDS.get(number, "")
    clock = task.timing.clock
    if number == DIVISOR:
        if clock is None or not task.timing.own_clock:
            raise _unsupported(task, ("Timing", number))
        return round(_timebase_hz(device, task) / clock.rate_hz)
    if clock is None and task.type in _KINDS:
        clock = _planned(task)
    if clock is None or (task.timing.implicit and field in ("rate_hz", "source")):
        raise Unsupported(f"Task: {task.name} has no sample clock")
    if field == "samples" and clock.samples < FEWEST_SAMPLES and task.type in ("AI", "AO"):
        raise DaqStatusError(
            Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {clock.samples}, at least {FEWEST_SAMPLES}"
        )
    if field != "source":
        return getattr(clock, field)
    if clock.source:
        return "/" + device.inventory.full_name(clock.source)
    owner = device.inventory.of(task.channels[0].physical.name)
    if owner.product.chassis or task.type not in _KINDS:
        return ""  # on a chassis the driver chooses an engine only when it reserves one
    return f"/{owner.name}/{str(task.type).lower()}/SampleClockTimebase"


def put_clock(device: DeviceState, task: SimulatedTask, number: int, value: Any) -> None:
    """Set a property of the timing; None puts it back to the driver's default."""
    task.refuse_while_running()
    clock, name = task.timing.clock, FIELDS.get(number, "")
    if number == TIMING_TYPE:
        _change_type(device, task, ON_DEMAND if value is None else value)
    elif number == DIVISOR and value is None:
        if _BEFORE in task.properties and clock is not None:
            configure_clock(device, task, replace(clock, rate_hz=task.properties.pop(_BEFORE)))
    elif number == DIVISOR:
        if clock is None or not task.timing.own_clock or type(value) is not int or value < 2:
            raise _unsupported(task, ("Timing", number))
        task.properties.setdefault(_BEFORE, clock.rate_hz)
        configure_clock(device, task, replace(clock, rate_hz=_timebase_hz(device, task) / value))
    elif clock is None and value is None:
        task.properties.pop(("Timing", "", number), None)
    elif name == "samples" and type(value) is int and not 1 <= value < 2**63:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {value}")
    elif clock is None and name == "samples" and task.type in _KINDS and type(value) is int:
        task.properties["Timing", "", number] = value
    else:
        value = getattr(DEFAULT, name) if value is None else value
        if clock is None or task.timing.implicit or type(value) is not type(getattr(clock, name)):
            raise Unsupported(f"Task: {task.name} has no sample clock with {name}")
        changed = replace(clock, **{name: value})
        if changed.mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Sample mode {changed.mode}")
        configure_clock(device, task, changed)


def _planned(task: SimulatedTask) -> SampleClock:
    samples = task.setting("Timing", "", property_number("Timing", "SAMP_QUANT_SAMP_PER_CHAN"), DEFAULT.samples)
    return replace(DEFAULT, samples=samples)


def _timing_type(task: SimulatedTask) -> int:
    if task.timing.implicit or (task.type == "CO" and task.timing.clock is None):
        return IMPLICIT
    return CHANGE_DETECTION if task.timing.change_lines else SAMPLE_CLOCK if task.timing.clock else ON_DEMAND


def _change_type(device: DeviceState, task: SimulatedTask, value: Any) -> None:
    if task.type not in _KINDS or value not in (ON_DEMAND, SAMPLE_CLOCK):
        raise _unsupported(task, ("Timing", TIMING_TYPE))
    if value == ON_DEMAND:
        task.timing = Timing()
    elif _timing_type(task) != SAMPLE_CLOCK:
        configure_clock(device, task, _planned(task))


def _timebase_hz(device: DeviceState, task: SimulatedTask) -> float:
    return device.inventory.of(task.channels[0].physical.name).product.timebase_hz


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
    if not channel.physical.kind.startswith("voltage") or "thermocouple_type" in channel.settings:
        raise Unsupported(f"custom scale of {channel.name}")
    if name:
        channel.settings["scale"] = scale_of(device.scales, name, (daqmx.VOLTS,))
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


def _part_of_pulse(high: bool) -> Property:
    """The time a counter's pulse is high or low, s."""

    def get(device: DeviceState, task: SimulatedTask, channel: Channel) -> float:
        duty = task.setting("Chan", channel.name, daqmx.CO_PULSE_DUTY_CYC, 0.5)
        return float((duty if high else 1 - duty) / task.setting("Chan", channel.name, daqmx.CO_PULSE_FREQ, 1.0))

    return get


_CHANNEL_GETTERS: dict[str, Property] = {
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
    "AI_RNG_LOW": lambda device, task, channel: None if (half := _half_range(device, channel)) is None else -half,
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
    "CO_PULSE_HIGH_TIME": _part_of_pulse(True),
    "CO_PULSE_LOW_TIME": _part_of_pulse(False),
    "CO_PULSE_TIME_INITIAL_DELAY": lambda device, task, channel: task.setting(
        "Chan", channel.name, daqmx.CO_PULSE_FREQ_INITIAL_DELAY, None
    ),
    "CO_PULSE_DONE": lambda device, task, channel: task.done,
}
_NAME_OF_NUMBER = {property_number("Chan", name): name for name in (*_CHANNEL_GETTERS, *SETTINGS, *UNITS_OF)}


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
    return _CHANNEL_GETTERS[name](device, task, channel) if name else None


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
    if task.type != wanted or not channel.physical.kind.startswith("voltage") or "scale" in channel.settings:
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


CURRENT_READ_POSITION, CURRENT_WRITE_POSITION, LOGGING_OFF, POLL, CREATE = 10425, 10430, 10231, 12524, 15848
PULSE = 10265
PT3750_A = 0.00381
RISING, ENTERING_WINDOW = 10280, 10163
Value = str | bool | int | float
_PARTS: tuple[tuple[str, dict[str, Value]], ...] = (
    ("ANLG_EDGE", {"SRC": "", "SLOPE": RISING, "LVL": 0.0, "HYST": 0.0}),
    ("ANLG_WIN", {"SRC": "", "WHEN": ENTERING_WINDOW, "TOP": 0.0, "BTM": 0.0}),
)
ANALOG_TRIGGERS: dict[str, Value] = {
    f"{shape}_{which}_TRIG_{what}": default
    for which in ("START", "REF")
    for shape, parts in _PARTS
    for what, default in parts.items()
}
"""Settings of analog triggers by name: kept; the trigger itself is what a task cannot run with."""


@dataclass(frozen=True)
class Stored:
    """Default of a property, and whether a task with another value can run all the same."""

    default: Value
    harmless: bool = False


_STORED: dict[tuple[str, str], Stored] = {
    ("Read", "OFFSET"): Stored(0),
    ("Read", "RELATIVE_TO"): Stored(CURRENT_READ_POSITION),
    ("Read", "SLEEP_TIME"): Stored(0.001, harmless=True),
    ("Read", "WAIT_MODE"): Stored(POLL, harmless=True),
    ("Read", "LOGGING_MODE"): Stored(LOGGING_OFF, harmless=True),
    ("Read", "LOGGING_FILE_PATH"): Stored("", harmless=True),
    ("Read", "LOGGING_FILE_WRITE_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_FILE_PREALLOCATION_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_SAMPS_PER_FILE"): Stored(0),
    ("Read", "LOGGING_TDMS_GROUP_NAME"): Stored("", harmless=True),
    ("Read", "LOGGING_TDMS_OPERATION"): Stored(CREATE, harmless=True),
    ("Read", "LOGGING_PAUSE"): Stored(False),
    ("Write", "OFFSET"): Stored(0),
    ("Write", "RELATIVE_TO"): Stored(CURRENT_WRITE_POSITION),
    ("Write", "SLEEP_TIME"): Stored(0.001, harmless=True),
    ("Write", "WAIT_MODE"): Stored(POLL, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_ENABLE"): Stored(False),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_RATE"): Stored(0.0, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Trig", "DIG_EDGE_ARM_START_TRIG_EDGE"): Stored(daqmx.RISING),
    ("Trig", "PAUSE_TRIG_TYPE"): Stored(daqmx.NO_TRIGGER, harmless=True),
    ("Trig", "DIG_LVL_PAUSE_TRIG_SRC"): Stored("", harmless=True),
    ("Trig", "DIG_LVL_PAUSE_TRIG_WHEN"): Stored(daqmx.HIGH, harmless=True),
    ("Trig", "REF_TRIG_PRETRIG_SAMPLES"): Stored(2, harmless=True),
    ("ExportedSignal", "SAMP_CLK_OUTPUT_BEHAVIOR"): Stored(PULSE),
    ("ExportedSignal", "START_TRIG_OUTPUT_TERM"): Stored(""),
    ("ExportedSignal", "SAMP_CLK_OUTPUT_TERM"): Stored(""),
    ("Timing", "ON_DEMAND_SIMULTANEOUS_AO_ENABLE"): Stored(False),
    ("Read", "READ_ALL_AVAIL_SAMP"): Stored(False),
    **{("Trig", name): Stored(default, harmless=True) for name, default in ANALOG_TRIGGERS.items()},
    ("Chan", "AO_RESOLUTION_UNITS"): Stored(BITS),
    ("Chan", "AI_EXCIT_USE_FOR_SCALING"): Stored(False),
    ("Chan", "AI_LOSSY_LSB_REMOVAL_COMPRESSED_SAMP_SIZE"): Stored(16),
    ("Chan", "AI_RTD_A"): Stored(PT3750_A, harmless=True),
    ("Chan", "AI_RTD_R0"): Stored(100.0, harmless=True),
    ("Chan", "AO_USE_ONLY_ON_BRD_MEM"): Stored(False, harmless=True),
    ("Chan", "DI_TRISTATE"): Stored(True, harmless=True),
    ("Chan", "DO_TRISTATE"): Stored(False, harmless=True),
    ("Chan", "CI_CTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Chan", "CI_CTR_TIMEBASE_DIG_FLTR_TIMEBASE_SRC"): Stored("100MHzTimebase", harmless=True),
}
STORED = {(category, property_number(category, name)): stored for (category, name), stored in _STORED.items()}
_NAMES = {key: name for name, key in zip(_STORED, STORED, strict=True)}


def note_unsimulated(task: SimulatedTask, key: tuple[str, int], channel: str, value: Value | None) -> None:
    """Note, or take back, that a task has a setting it cannot run with."""
    if key not in STORED:
        return
    what = f"{_NAMES[key][1]} {channel}".strip()
    task.unsimulated.pop(what, None)
    if value not in (None, STORED[key].default) and not STORED[key].harmless:
        task.unsimulated[what] = str(value)


def note_edge(task: SimulatedTask, what: str, edge: int) -> None:
    """Note, or take back, that a task is to act on falling edges, with which it cannot run."""
    task.unsimulated.pop(what, None)
    if edge == daqmx.FALLING:
        task.unsimulated[what] = "falling edge"


BUILT = ("analog edge", "analog window")
DIGITAL_LEVEL = 10152
PAUSE_TYPE = property_number("Trig", "PAUSE_TRIG_TYPE")


def settle_triggers(device: DeviceState, task: SimulatedTask) -> None:
    """Take over what a client has set; refuses, by the driver's code, what the product cannot do."""
    kinds = task.triggers.analog_kinds
    for what in ("pause trigger", "start trigger on", "reference trigger on"):
        task.unsimulated.pop(what, None)
    task.triggers.analog_start = _shape(device, task, kinds.get("start trigger", ""), "START")
    if task.triggers.analog_start and task.setting("Trig", "", daqmx.START_TRIG_RETRIGGERABLE, False):
        task.unsimulated["start trigger on"] = "a level, again and again"
    task.triggers.analog_reference = _shape(device, task, kinds.get("reference trigger", ""), "REF")
    task.triggers.pause, task.triggers.pause_high = _pause(device, task)


def _set(task: SimulatedTask, name: str) -> Any:
    number = property_number("Trig", name)
    return task.setting("Trig", "", number, STORED["Trig", number].default)


def _shape(device: DeviceState, task: SimulatedTask, kind: str, which: str) -> AnalogShape | None:
    if kind not in BUILT:
        return None
    product = device.inventory.of(task.channels[0].physical.name).product
    if task.type != "AI" or product.chassis:
        task.unsimulated[f"{'start' if which == 'START' else 'reference'} trigger on"] = f"{kind}, {product.name}"
        return None
    if not product.apfi:
        raise DaqStatusError(Code.NO_ANALOG_TRIG_HW, f"Task: {task.name}: {kind} on {product.name}")
    shape = "ANLG_EDGE" if kind == "analog edge" else "ANLG_WIN"
    source = _set(task, f"{shape}_{which}_TRIG_SRC")
    first = task.channels[0]
    wired = source in (first.name, first.physical.name)
    if not wired and "APFI" not in source:
        others = any(source in (channel.name, channel.physical.name) for channel in task.channels)
        code = Code.ANALOG_TRIG_CHAN_NOT_FIRST_IN_SCAN_LIST if others else Code.INVALID_ANALOG_TRIG_SRC
        raise DaqStatusError(code, f"Task: {task.name}, source: {source!r}")
    name = first.name if wired else ""
    if kind == "analog window":
        entering = _set(task, f"{shape}_{which}_TRIG_WHEN") == ENTERING_WINDOW
        window = (_set(task, f"{shape}_{which}_TRIG_BTM"), _set(task, f"{shape}_{which}_TRIG_TOP"))
        if window[0] >= window[1]:
            raise DaqStatusError(
                Code.INVALID_ATTRIBUTE_VALUE, f"Task: {task.name}: window {window[0]:g} to {window[1]:g}"
            )
        return AnalogShape(name, entering, 0.0, 0.0, window)
    level, hysteresis = _set(task, f"{shape}_{which}_TRIG_LVL"), _set(task, f"{shape}_{which}_TRIG_HYST")
    rising = _set(task, f"{shape}_{which}_TRIG_SLOPE") == RISING
    return AnalogShape(name, rising, level, level - hysteresis if rising else level + hysteresis)


def _pause(device: DeviceState, task: SimulatedTask) -> tuple[str, bool]:
    kind = task.setting("Trig", "", PAUSE_TYPE, daqmx.NO_TRIGGER)
    if kind == daqmx.NO_TRIGGER:
        return "", True
    if task.triggers.referenced:
        raise DaqStatusError(Code.REF_AND_PAUSE_TRIG_CONFIGURED, f"Task: {task.name}")
    source, when = _set(task, "DIG_LVL_PAUSE_TRIG_SRC"), _set(task, "DIG_LVL_PAUSE_TRIG_WHEN")
    if kind != DIGITAL_LEVEL or not task.timing.own_clock:
        task.unsimulated["pause trigger"] = f"type {kind} of a {task.type} task"
        return "", True
    return device.inventory.terminal(source), when == daqmx.HIGH


DO_NOT_OVERWRITE = 10159
READ_OVERWRITE = property_number("Read", "OVERWRITE")
CI_INPUT_TERMS = (
    daqmx.CI_ENCODER_A_INPUT_TERM,
    daqmx.CI_ENCODER_B_INPUT_TERM,
    daqmx.CI_ENCODER_Z_INPUT_TERM,
    *daqmx.CI_TERM.values(),
)
ANALOG_EDGE, ANALOG_WINDOW, DIGITAL_PATTERN = 10099, 10103, 10398
TRIGGER_KINDS = {"analog edge": ANALOG_EDGE, "analog window": ANALOG_WINDOW, "digital pattern": DIGITAL_PATTERN}
TRIGGER_TYPES = {
    ("Trig", property_number("Trig", "START_TRIG_TYPE")): "start trigger",
    ("Trig", property_number("Trig", "REF_TRIG_TYPE")): "reference trigger",
}
READ_DEFAULT_SAMPLES = 0x31E8
"""A property of newer drivers without a name in the service: samples a read takes when a client gives no number."""
CLOCKED = ("AI", "AO", "DI", "DO")
ANY = (*CLOCKED, "CI", "CO")
SETTABLE: dict[Key, tuple[type, tuple[str, ...]]] = {
    ("Read", READ_OVERWRITE): (int, ANY),
    ("Buffer", daqmx.BUF_INPUT_BUF_SIZE): (int, ("AI", "CI", "DI")),
    ("Buffer", daqmx.BUF_OUTPUT_BUF_SIZE): (int, ("AO", "CO", "DO")),
    ("Write", daqmx.WRITE_REGEN_MODE): (int, ANY),
    **{("Chan", number): (str, ("CI",)) for number in CI_INPUT_TERMS},
    **{
        ("Chan", property_number("Chan", f"CI_ENCODER_{signal}_INPUT_DIG_FLTR_{what}")): (kind, ("CI",))
        for signal in "AB"
        for what, kind in (("ENABLE", bool), ("MIN_PULSE_WIDTH", float))
    },
    **{("Chan", number): (float, ANY) for number in LIMITS},
    ("Chan", daqmx.CO_PULSE_TERM): (str, ("CO",)),
    ("Chan", daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE): (bool, ("AI",)),
    ("Trig", daqmx.ARM_START_TRIG_TYPE): (int, ANY),
    ("Trig", daqmx.DIG_EDGE_ARM_START_TRIG_SRC): (str, ANY),
    ("Trig", daqmx.START_TRIG_RETRIGGERABLE): (bool, ANY),
}
"""Type of each property that the virtual device acts on, and the types of tasks that have it."""


def check_value(device: DeviceState, task: SimulatedTask, number: int, value: Any) -> None:
    """Refuse a value that the product does not have, or the virtual device."""
    if number in (*CI_INPUT_TERMS, daqmx.DIG_EDGE_ARM_START_TRIG_SRC, daqmx.CO_PULSE_TERM):
        device.inventory.terminal(value, output=number == daqmx.CO_PULSE_TERM)
    armed_by = number == daqmx.ARM_START_TRIG_TYPE and value not in (daqmx.DIGITAL_EDGE, daqmx.NO_TRIGGER)
    retriggers = number == daqmx.START_TRIG_RETRIGGERABLE and (task.type not in CLOCKED or task.triggers.referenced)
    overwrites = number == READ_OVERWRITE and value != DO_NOT_OVERWRITE
    refuse_any(
        (overwrites, UNSUPPORTED, "only DO_NOT_OVERWRITE_UNREAD_SAMPLES is simulated"),
        (armed_by, Code.INVALID_ATTRIBUTE_VALUE, f"Arm start trigger type {value}"),
        (retriggers, UNSUPPORTED, f"not simulated: retriggering a {task.type} task"),
    )


Getter = Callable[[DeviceState, SimulatedTask], Any]


def _counted(field: str) -> Getter:
    """Samples per channel in the input buffer, after a look that takes its time when there are none."""

    def get(device: DeviceState, task: SimulatedTask) -> int:
        if field != "read":
            await_something(device, task)
        return getattr(task.buffer, field) if task.buffer is not None else 0

    return get


def _default_samples_to_read(device: DeviceState, task: SimulatedTask) -> int:
    clock = task.timing.clock
    return clock.samples if clock is not None and task.timing.finite else int(_counted("available")(device, task))


def _terminal(device: DeviceState, relative: str) -> str:
    return "/" + device.inventory.full_name(relative) if relative else ""


def _start_trigger_terminal(device: DeviceState, task: SimulatedTask) -> str:
    """Where the task's own start trigger can be taken from."""
    if task.type not in CLOCKED:
        raise Unsupported(f"Task: {task.name}: start trigger terminal")
    owner = device.inventory.of(task.channels[0].physical.name) if task.channels else device.inventory
    return _terminal(device, device.inventory.known_as(owner, f"{task.type.lower()}/StartTrigger"))


def most_lines(task: SimulatedTask) -> int:
    """Return the lines of the largest channel of a task."""
    return max((len(channel.settings.get("lines", "1")) for channel in task.channels), default=0)


def _space_available(device: DeviceState, task: SimulatedTask) -> int:
    output = task.output
    running = task.state == "running"
    size = output.size if running else int(task.setting("Buffer", "", daqmx.BUF_OUTPUT_BUF_SIZE, output.written))
    return max(size - max(output.written - output.generated, 0), 0)


def _raw_width(device: DeviceState, task: SimulatedTask) -> int:
    """Bytes of one raw sample of all channels."""
    sizes = [raw_sample_bits(device, task, channel) for channel in task.channels]
    known = [size for size in sizes if size is not None]
    if not known or len(known) < len(sizes):
        raise Unsupported(f"Task: {task.name}: raw samples")
    return sum(known) // 8


def _channel_names(device: DeviceState, task: SimulatedTask) -> str:
    return ", ".join(channel.name for channel in task.channels)


_TASK_GETTERS: dict[tuple[str, str], Getter] = {
    ("Task", "NAME"): lambda device, task: task.name,
    ("Task", "CHANNELS"): _channel_names,
    ("Task", "NUM_CHANS"): lambda device, task: len(task.channels),
    ("Task", "COMPLETE"): lambda device, task: task.done,
    ("Task", "NUM_DEVICES"): lambda device, task: len(device.devices_of(task)),
    ("Task", "DEVICES"): lambda device, task: ", ".join(device.devices_of(task)),
    ("Trig", "START_TRIG_TYPE"): lambda device, task: _trigger_type(task, "start trigger", task.triggers.start),
    ("Trig", "REF_TRIG_TYPE"): lambda device, task: _trigger_type(task, "reference trigger", task.triggers.reference),
    ("Trig", "DIG_EDGE_START_TRIG_SRC"): lambda device, task: _terminal(device, task.triggers.start),
    ("Trig", "START_TRIG_RETRIGGERABLE"): lambda device, task: task.retriggerable,
    ("Trig", "START_TRIG_TERM"): _start_trigger_terminal,
    ("Buffer", "INPUT_BUF_SIZE"): lambda device, task: task.input_buffer_size,
    ("Read", "CHANNELS_TO_READ"): _channel_names,
    ("Read", "NUM_CHANS"): lambda device, task: len(task.channels),
    ("Read", "DIGITAL_LINES_BYTES_PER_CHAN"): lambda device, task: most_lines(task),
    ("Read", "RAW_DATA_WIDTH"): _raw_width,
    ("Read", "AVAIL_SAMP_PER_CHAN"): _counted("available"),
    ("Read", "TOTAL_SAMP_PER_CHAN_ACQUIRED"): _counted("acquired"),
    ("Read", "CURR_READ_POS"): _counted("read"),
    ("Read", "OVERWRITE"): lambda device, task: task.setting("Read", "", READ_OVERWRITE, DO_NOT_OVERWRITE),
    ("Write", "NUM_CHANS"): lambda device, task: len(task.channels),
    ("Write", "DIGITAL_LINES_BYTES_PER_CHAN"): lambda device, task: most_lines(task),
    ("Write", "REGEN_MODE"): lambda device, task: task.setting(
        "Write", "", daqmx.WRITE_REGEN_MODE, daqmx.ALLOW_REGENERATION
    ),
    ("Write", "SPACE_AVAIL"): _space_available,
    ("Write", "CURR_WRITE_POS"): lambda device, task: task.output.generated,
    ("Write", "TOTAL_SAMP_PER_CHAN_GENERATED"): lambda device, task: task.output.generated,
}
_GETTER_OF_NUMBER: dict[Key, Getter] = {
    ("Read", READ_DEFAULT_SAMPLES): _default_samples_to_read,
    **{(category, property_number(category, name)): getter for (category, name), getter in _TASK_GETTERS.items()},
}


def _trigger_type(task: SimulatedTask, which: str, terminal: str) -> int:
    kind = task.unsimulated.get(which, "") or task.triggers.analog_kinds.get(which, "")
    simulated = daqmx.DIGITAL_EDGE if terminal or kind.startswith("digital edge") else daqmx.NO_TRIGGER
    return TRIGGER_KINDS.get(kind, simulated)


def _put_trigger_type(task: SimulatedTask, which: str, value: Any) -> None:
    """Take a kind of trigger that the virtual bench does not have, or take all triggers away."""
    task.refuse_while_running()
    kinds = {number: kind for kind, number in TRIGGER_KINDS.items()}
    has = value in kinds and (which == "start trigger" or task.type == "AI")
    if value != daqmx.NO_TRIGGER and not has:
        raise Unsupported(f"Task: {task.name}: {which} of type {value}")
    task.forget_trigger(which)
    if has:
        (task.triggers.analog_kinds if kinds[value] in BUILT else task.unsimulated)[which] = kinds[value]


def _unsupported(task: SimulatedTask, key: Key) -> Unsupported:
    return Unsupported(f"Property: 0x{key[1]:04X} ({key[0]}) of {task.name}")


def get(device: DeviceState, request: Any, key: Key) -> Any:
    """Return a property of a task or of one of its channels."""
    task, channel, (category, number) = find_task(device, request.task.name), getattr(request, "channel", ""), key
    if key in _GETTER_OF_NUMBER:
        return _GETTER_OF_NUMBER[key](device, task)
    if category == "Timing" and number in NUMBERS:
        return get_clock(device, task, number)
    if category == "Chan":
        found = find_channels(task, channel)[0]
        channel = found.name
        if (value := channel_property(device, task, found, number)) is not None:
            return value
    if (category, channel, number) in task.properties:
        return task.properties[category, channel, number]
    if key in STORED:
        return STORED[key].default
    raise _unsupported(task, key)


def put(device: DeviceState, request: Any, key: Key, value: Any) -> None:
    """Set a property, after checking terminals and trigger types; None puts it back to its default.

    Refused while the task runs.
    """
    task, channel, (category, number) = find_task(device, request.task.name), getattr(request, "channel", ""), key
    if category == "Chan" and SCALES.get(number) == task.type and isinstance(value, str | None):
        task.refuse_while_running()
        for found in find_channels(task, channel):
            set_scale(device, found, value or "")
        return
    if category == "Timing" and number in NUMBERS:
        put_clock(device, task, number, value)
        return
    if key in TRIGGER_TYPES:
        _put_trigger_type(task, TRIGGER_TYPES[key], daqmx.NO_TRIGGER if value is None else value)
        return
    kind, types = (type(STORED[key].default), ANY) if key in STORED else SETTABLE.get(key, (None, ANY))
    fits = number not in LIMITS if value is None else type(value) is kind and task.type in (None, *types)
    if kind is None or not fits:
        raise _unsupported(task, key)
    task.refuse_while_running()
    channels = find_channels(task, channel) if category == "Chan" else []
    if category == "Chan" and number in LIMITS:
        for found in channels:
            set_limit(device, task, found, number, float(value))
        return
    if number == daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE and any(found.physical.kind != "bridge" for found in channels):
        raise _unsupported(task, key)
    if key in SETTABLE and value is not None:
        check_value(device, task, number, value)
    for name in [found.name for found in channels] or [""]:
        task.properties.pop((category, name, number), None)
        if value is not None:
            task.properties[category, name, number] = value
        note_unsimulated(task, key, name, value)
    _settle_arm_start(device, task, number)


def _settle_arm_start(device: DeviceState, task: SimulatedTask, number: int) -> None:
    if number in (daqmx.ARM_START_TRIG_TYPE, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        armed = task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) == daqmx.DIGITAL_EDGE
        source = task.setting("Trig", "", daqmx.DIG_EDGE_ARM_START_TRIG_SRC, "")
        task.triggers.arm_start = device.inventory.terminal(source) if armed and source else ""


TASK_PROPERTIES = Properties(get, put, lambda device, request, key: put(device, request, key, None))
