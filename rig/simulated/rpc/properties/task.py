"""Properties of tasks that a client may get and set, by the driver's category and name.

What is not in these tables is refused, never answered with an invented value.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.rpc.messages import property_number
from rig.simulated.rpc.properties import sampling_triggers, stored
from rig.simulated.rpc.properties.channel import (
    LIMITS,
    SCALES,
    channel_property,
    find_channels,
    raw_sample_bits,
    set_limit,
    set_scale,
)
from rig.simulated.rpc.properties.checks import CI_INPUT_TERMS, DO_NOT_OVERWRITE, READ_OVERWRITE, check_value
from rig.simulated.rpc.properties.clock import NUMBERS, get_clock, put_clock, reset_clock
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.wait import await_something

Key = tuple[str, int]
"""Category and the driver's number of a property."""
ANALOG_EDGE, ANALOG_WINDOW, DIGITAL_PATTERN = 10099, 10103, 10398
TRIGGER_KINDS = {"analog edge": ANALOG_EDGE, "analog window": ANALOG_WINDOW, "digital pattern": DIGITAL_PATTERN}
TRIGGER_TYPES = {
    property_number("Trig", "START_TRIG_TYPE"): "start trigger",
    property_number("Trig", "REF_TRIG_TYPE"): "reference trigger",
}
READ_DEFAULT_SAMPLES = 0x31E8
"""A property of newer drivers without a name in the service: samples a read takes when a client gives no number."""
CI_FILTERS = tuple(
    property_number("Chan", f"CI_ENCODER_{signal}_INPUT_DIG_FLTR_{what}")
    for signal in "AB"
    for what in ("ENABLE", "MIN_PULSE_WIDTH")
)
SETTABLE: dict[str, frozenset[int]] = {
    "Read": frozenset({READ_OVERWRITE}),
    "Buffer": frozenset({daqmx.BUF_INPUT_BUF_SIZE, daqmx.BUF_OUTPUT_BUF_SIZE}),
    "Write": frozenset({daqmx.WRITE_REGEN_MODE}),
    "Chan": frozenset({*CI_INPUT_TERMS, *CI_FILTERS, *LIMITS, daqmx.CO_PULSE_TERM, daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE}),
    "Trig": frozenset(
        {
            daqmx.ARM_START_TRIG_TYPE,
            daqmx.DIG_EDGE_ARM_START_TRIG_EDGE,
            daqmx.DIG_EDGE_ARM_START_TRIG_SRC,
            daqmx.START_TRIG_RETRIGGERABLE,
        }
    ),
}
_TEXTS = frozenset({*CI_INPUT_TERMS, daqmx.CO_PULSE_TERM, daqmx.DIG_EDGE_ARM_START_TRIG_SRC})
_NUMBERS = frozenset({*LIMITS, *(number for number in CI_FILTERS if number not in CI_FILTERS[::2])})
_SWITCHES = frozenset({*CI_FILTERS[::2], daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE, daqmx.START_TRIG_RETRIGGERABLE})
Getter = Callable[[DeviceState, SimulatedTask], Any]


def _input_buffer(field: str) -> Getter:
    return lambda device, task: getattr(task.buffer, field) if task.buffer is not None else 0


def _available(device: DeviceState, task: SimulatedTask) -> int:
    await_something(device, task)
    return task.buffer.available if task.buffer is not None else 0


def _acquired(device: DeviceState, task: SimulatedTask) -> int:
    await_something(device, task)
    return task.buffer.acquired if task.buffer is not None else 0


def _default_samples_to_read(device: DeviceState, task: SimulatedTask) -> int:
    clock = task.timing.clock
    return clock.samples if clock is not None and task.timing.finite else _available(device, task)


def _terminal(device: DeviceState, relative: str) -> str:
    return "/" + device.inventory.full_name(relative) if relative else ""


def _start_trigger_terminal(device: DeviceState, task: SimulatedTask) -> str:
    """Where the task's own start trigger can be taken from."""
    if task.type not in ("AI", "AO", "DI", "DO"):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: start trigger terminal")
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
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: raw samples")
    return sum(known) // 8


def _channel_names(device: DeviceState, task: SimulatedTask) -> str:
    return ", ".join(channel.name for channel in task.channels)


def _devices(device: DeviceState, task: SimulatedTask) -> list[str]:
    return list(dict.fromkeys(device.inventory.of(channel.physical.name).name for channel in task.channels))


def _number_of_channels(device: DeviceState, task: SimulatedTask) -> int:
    return len(task.channels)


def _generated(device: DeviceState, task: SimulatedTask) -> int:
    return task.output.generated


_GETTERS: dict[tuple[str, str], Getter] = {
    ("Task", "NAME"): lambda device, task: task.name,
    ("Task", "CHANNELS"): _channel_names,
    ("Task", "NUM_CHANS"): _number_of_channels,
    ("Task", "COMPLETE"): lambda device, task: task.done,
    ("Task", "NUM_DEVICES"): lambda device, task: len(_devices(device, task)),
    ("Task", "DEVICES"): lambda device, task: ", ".join(_devices(device, task)),
    ("Trig", "START_TRIG_TYPE"): lambda device, task: _trigger_type(task, "start trigger", task.triggers.start),
    ("Trig", "REF_TRIG_TYPE"): lambda device, task: _trigger_type(task, "reference trigger", task.triggers.reference),
    ("Trig", "DIG_EDGE_START_TRIG_SRC"): lambda device, task: _terminal(device, task.triggers.start),
    ("Trig", "START_TRIG_RETRIGGERABLE"): lambda device, task: task.retriggerable,
    ("Trig", "START_TRIG_TERM"): _start_trigger_terminal,
    ("Buffer", "INPUT_BUF_SIZE"): lambda device, task: task.input_buffer_size,
    ("Read", "CHANNELS_TO_READ"): _channel_names,
    ("Read", "NUM_CHANS"): _number_of_channels,
    ("Read", "DIGITAL_LINES_BYTES_PER_CHAN"): _most_lines,
    ("Read", "RAW_DATA_WIDTH"): _raw_width,
    ("Read", "AVAIL_SAMP_PER_CHAN"): _available,
    ("Read", "TOTAL_SAMP_PER_CHAN_ACQUIRED"): _acquired,
    ("Read", "CURR_READ_POS"): _input_buffer("read"),
    ("Read", "OVERWRITE"): lambda device, task: task.setting("Read", "", READ_OVERWRITE, DO_NOT_OVERWRITE),
    ("Write", "NUM_CHANS"): _number_of_channels,
    ("Write", "DIGITAL_LINES_BYTES_PER_CHAN"): _most_lines,
    ("Write", "REGEN_MODE"): lambda device, task: task.setting(
        "Write", "", daqmx.WRITE_REGEN_MODE, daqmx.ALLOW_REGENERATION
    ),
    ("Write", "SPACE_AVAIL"): _space_available,
    ("Write", "CURR_WRITE_POS"): _generated,
    ("Write", "TOTAL_SAMP_PER_CHAN_GENERATED"): _generated,
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
        if kinds[value] in sampling_triggers.BUILT:
            task.triggers.analog_kinds[which] = kinds[value]
        else:
            task.unsimulated[which] = kinds[value]
    else:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: {which} of type {value}")


def _unsupported(task: SimulatedTask, key: Key) -> DaqStatusError:
    return DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{key[1]:04X} ({key[0]}) of {task.name}")


def get(device: DeviceState, task: SimulatedTask, channel: str, key: Key) -> Any:
    """Return a property of a task or of one of its channels."""
    if key in _GETTER_OF_NUMBER:
        return _GETTER_OF_NUMBER[key](device, task)
    category, number = key
    if category == "Timing" and number in NUMBERS:
        return get_clock(device, task, number)
    if category == "Chan":
        found = find_channels(task, channel)[0]
        channel = found.name
        if (value := channel_property(device, task, found, number)) is not None:
            return value
    if (category, channel, number) in task.properties:
        return task.properties[category, channel, number]
    if key in stored.STORED:
        return stored.STORED[key].default
    raise _unsupported(task, key)


def put(device: DeviceState, task: SimulatedTask, channel: str, key: Key, value: Any) -> None:
    """Set a property, after checking terminals and trigger types; refused while the task runs."""
    category, number = key
    if category == "Chan" and SCALES.get(number) == task.type and isinstance(value, str):
        task.refuse_while_running()
        for found in find_channels(task, channel):
            set_scale(device, found, value)
        return
    kind = str if number in _TEXTS else float if number in _NUMBERS else bool if number in _SWITCHES else int
    if category == "Timing" and number in NUMBERS:
        put_clock(device, task, number, value)
        return
    if category == "Trig" and number in TRIGGER_TYPES:
        _put_trigger_type(task, TRIGGER_TYPES[number], value)
        return
    ends = {daqmx.BUF_INPUT_BUF_SIZE: "I", daqmx.BUF_OUTPUT_BUF_SIZE: "O"}
    if category == "Buffer" and task.type is not None and task.type[1] != ends.get(number, task.type[1]):
        raise _unsupported(task, key)
    own = stored.accepts(key, value)
    if not own and (number not in SETTABLE.get(category, frozenset()) or type(value) is not kind):
        raise _unsupported(task, key)
    task.refuse_while_running()
    names = [""]
    if category == "Chan":
        channels = find_channels(task, channel)
        names = [found.name for found in channels]
        if number in LIMITS:
            for found in channels:
                set_limit(device, task, found, number, float(value))
            return
        if own:
            _store(task, key, names, value)
            return
        shunt = number == daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE
        wanted = "CO" if number == daqmx.CO_PULSE_TERM else "AI" if shunt else "CI"
        if task.type != wanted or (shunt and any(found.physical.kind != "bridge" for found in channels)):
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} of {channel}")
    if own:
        _store(task, key, names, value)
        return
    check_value(device, task, number, value)
    for name in names:
        task.properties[category, name, number] = value
    if number in (daqmx.ARM_START_TRIG_TYPE, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        armed = task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) == daqmx.DIGITAL_EDGE
        source = task.setting("Trig", "", daqmx.DIG_EDGE_ARM_START_TRIG_SRC, "")
        task.triggers.arm_start = device.inventory.terminal(source) if armed and source else ""


def _store(task: SimulatedTask, key: Key, names: list[str], value: Any) -> None:
    for name in names:
        task.properties[key[0], name, key[1]] = value
        stored.note_unsimulated(task, key, name, value)


def reset(device: DeviceState, task: SimulatedTask, channel: str, key: Key) -> None:
    """Put a property back to its default."""
    category, number = key
    if category == "Chan" and SCALES.get(number) == task.type:
        put(device, task, channel, key, "")
        return
    if category == "Timing" and number in NUMBERS:
        reset_clock(device, task, number)
        return
    if category == "Trig" and number in TRIGGER_TYPES:
        _put_trigger_type(task, TRIGGER_TYPES[number], daqmx.NO_TRIGGER)
        return
    if number not in SETTABLE.get(category, frozenset()) and key not in stored.STORED:
        raise _unsupported(task, key)
    if number in LIMITS:
        raise _unsupported(task, key)
    task.refuse_while_running()
    names = [found.name for found in find_channels(task, channel)] if category == "Chan" else [""]
    for name in names:
        task.properties.pop((category, name, number), None)
        if key in stored.STORED:
            stored.note_unsimulated(task, key, name, stored.STORED[key].default)
    if number in (daqmx.ARM_START_TRIG_TYPE, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        task.triggers.arm_start = ""
