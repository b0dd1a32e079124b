"""Properties of tasks that a client may get, set and reset, by the driver's category and name.

What is not in these tables is refused, never answered with an invented value. Some properties can be set that the
virtual device does not act on: those that change nothing a client can see are only kept; with any other, a task that is
not at its default is refused when it is committed or started, so that a setting is never taken and then ignored.

Analog and pause triggers are taken over from the properties when a task is verified. Built are edges (with hysteresis)
and windows of the first analog input of a card as start and reference triggers, and a digital level that pauses a task
with a sample clock of its own. Other kinds are kept and their tasks refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import AnalogShape, SimulatedTask
from rig.simulated.driver import find_task
from rig.simulated.rpc.messages import Key, Properties, property_number
from rig.simulated.rpc.properties.channel import (
    LIMITS,
    SCALES,
    channel_property,
    find_channels,
    raw_sample_bits,
    set_limit,
    set_scale,
)
from rig.simulated.rpc.properties.clock import NUMBERS, get_clock, put_clock, reset_clock
from rig.simulated.status import Code, DaqStatusError, NotImplementedByDevice, Unsupported
from rig.simulated.timing import await_something

CURRENT_READ_POSITION, CURRENT_WRITE_POSITION, LOGGING_OFF, POLL, CREATE = 10425, 10430, 10231, 12524, 15848
PULSE, BITS = 10265, 10109
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


BUILT = ("analog edge", "analog window")
DIGITAL_LEVEL = 10152
PAUSE_TYPE = property_number("Trig", "PAUSE_TRIG_TYPE")


def settle_triggers(device: DeviceState, task: SimulatedTask) -> None:
    """Take over what a client has set; refuses, by the driver's code, what the product cannot do."""
    kinds = task.triggers.analog_kinds
    for what in ("pause trigger", "start trigger on", "reference trigger on"):
        task.unsimulated.pop(what, None)
    task.triggers.analog_start = _shape(device, task, kinds.get("start trigger", ""), "START")
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
    ("Trig", daqmx.DIG_EDGE_ARM_START_TRIG_EDGE): (int, ANY),
    ("Trig", daqmx.DIG_EDGE_ARM_START_TRIG_SRC): (str, ANY),
    ("Trig", daqmx.START_TRIG_RETRIGGERABLE): (bool, ANY),
}
"""Type of each property that the virtual device acts on, and the types of tasks that have it."""


def check_value(device: DeviceState, task: SimulatedTask, number: int, value: Any) -> None:
    """Refuse a value that the product does not have, or the virtual device."""
    if number in (*CI_INPUT_TERMS, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        device.inventory.terminal(value)
    if number == daqmx.CO_PULSE_TERM:
        device.inventory.terminal(value, output=True)
    if number == READ_OVERWRITE and value != DO_NOT_OVERWRITE:
        raise Unsupported("only DO_NOT_OVERWRITE_UNREAD_SAMPLES is simulated")
    if number == daqmx.ARM_START_TRIG_TYPE and value not in (daqmx.DIGITAL_EDGE, daqmx.NO_TRIGGER):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Arm start trigger type {value}")
    if number == daqmx.START_TRIG_RETRIGGERABLE and (task.type not in CLOCKED or task.triggers.referenced):
        raise NotImplementedByDevice(f"retriggering a {task.type} task")


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


def _most_lines(device: DeviceState, task: SimulatedTask) -> int:
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


_GETTERS: dict[tuple[str, str], Getter] = {
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
    ("Read", "DIGITAL_LINES_BYTES_PER_CHAN"): _most_lines,
    ("Read", "RAW_DATA_WIDTH"): _raw_width,
    ("Read", "AVAIL_SAMP_PER_CHAN"): _counted("available"),
    ("Read", "TOTAL_SAMP_PER_CHAN_ACQUIRED"): _counted("acquired"),
    ("Read", "CURR_READ_POS"): _counted("read"),
    ("Read", "OVERWRITE"): lambda device, task: task.setting("Read", "", READ_OVERWRITE, DO_NOT_OVERWRITE),
    ("Write", "NUM_CHANS"): lambda device, task: len(task.channels),
    ("Write", "DIGITAL_LINES_BYTES_PER_CHAN"): _most_lines,
    ("Write", "REGEN_MODE"): lambda device, task: task.setting(
        "Write", "", daqmx.WRITE_REGEN_MODE, daqmx.ALLOW_REGENERATION
    ),
    ("Write", "SPACE_AVAIL"): _space_available,
    ("Write", "CURR_WRITE_POS"): lambda device, task: task.output.generated,
    ("Write", "TOTAL_SAMP_PER_CHAN_GENERATED"): lambda device, task: task.output.generated,
}
_GETTER_OF_NUMBER: dict[Key, Getter] = {
    ("Read", READ_DEFAULT_SAMPLES): _default_samples_to_read,
    **{(category, property_number(category, name)): getter for (category, name), getter in _GETTERS.items()},
}


def _trigger_type(task: SimulatedTask, which: str, terminal: str) -> int:
    kind = task.unsimulated.get(which, "") or task.triggers.analog_kinds.get(which, "")
    simulated = daqmx.DIGITAL_EDGE if terminal or kind.startswith("digital edge") else daqmx.NO_TRIGGER
    return TRIGGER_KINDS.get(kind, simulated)


def _put_trigger_type(task: SimulatedTask, which: str, value: Any) -> None:
    """Take a kind of trigger that the virtual bench does not have, or take all triggers away."""
    task.refuse_while_running()
    kinds = {number: kind for kind, number in TRIGGER_KINDS.items()}
    if value == daqmx.NO_TRIGGER:
        task.triggers.forget(which)
        task.unsimulated.pop(which, None)
    elif value in kinds and (which == "start trigger" or task.type == "AI"):
        task.triggers.forget(which)
        if kinds[value] in BUILT:
            task.triggers.analog_kinds[which] = kinds[value]
        else:
            task.unsimulated[which] = kinds[value]
    else:
        raise Unsupported(f"Task: {task.name}: {which} of type {value}")


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
    """Set a property, after checking terminals and trigger types; refused while the task runs."""
    task, channel, (category, number) = find_task(device, request.task.name), getattr(request, "channel", ""), key
    if category == "Chan" and SCALES.get(number) == task.type and isinstance(value, str):
        task.refuse_while_running()
        for found in find_channels(task, channel):
            set_scale(device, found, value)
        return
    if category == "Timing" and number in NUMBERS:
        put_clock(device, task, number, value)
        return
    if key in TRIGGER_TYPES:
        _put_trigger_type(task, TRIGGER_TYPES[key], value)
        return
    kind, types = (type(STORED[key].default), ANY) if key in STORED else SETTABLE.get(key, (None, ANY))
    if type(value) not in (kind,) or task.type not in (None, *types):
        raise _unsupported(task, key)
    task.refuse_while_running()
    channels = find_channels(task, channel) if category == "Chan" else []
    if category == "Chan" and number in LIMITS:
        for found in channels:
            set_limit(device, task, found, number, float(value))
        return
    if number == daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE and any(found.physical.kind != "bridge" for found in channels):
        raise _unsupported(task, key)
    if key in SETTABLE:
        check_value(device, task, number, value)
    for name in [found.name for found in channels] or [""]:
        task.properties[category, name, number] = value
        note_unsimulated(task, key, name, value)
    _settle_arm_start(device, task, number)


def _settle_arm_start(device: DeviceState, task: SimulatedTask, number: int) -> None:
    if number in (daqmx.ARM_START_TRIG_TYPE, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        armed = task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) == daqmx.DIGITAL_EDGE
        source = task.setting("Trig", "", daqmx.DIG_EDGE_ARM_START_TRIG_SRC, "")
        task.triggers.arm_start = device.inventory.terminal(source) if armed and source else ""


def reset(device: DeviceState, request: Any, key: Key) -> None:
    """Put a property back to its default."""
    task, channel, (category, number) = find_task(device, request.task.name), getattr(request, "channel", ""), key
    if category == "Chan" and SCALES.get(number) == task.type:
        put(device, request, key, "")
    elif category == "Timing" and number in NUMBERS:
        reset_clock(device, task, number)
    elif key in TRIGGER_TYPES:
        put(device, request, key, daqmx.NO_TRIGGER)
    elif key not in {**SETTABLE, **STORED} or number in LIMITS:
        raise _unsupported(task, key)
    else:
        task.refuse_while_running()
        for name in [found.name for found in find_channels(task, channel)] if category == "Chan" else [""]:
            task.properties.pop((category, name, number), None)
            note_unsimulated(task, key, name, None)
        _settle_arm_start(device, task, number)


TASK_PROPERTIES = Properties(get, put, reset)
