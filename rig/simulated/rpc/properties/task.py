"""Properties of tasks that a client may get and set, by the driver's category and number.

What is not in these tables is refused, never answered with an invented value.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rig.simulated import status
from rig.simulated.device import wait as waiting
from rig.simulated.device.input_readings import MEASURED_ON, SHUNT
from rig.simulated.device.reservations import ARM_TYPE, NO_TRIGGER
from rig.simulated.device.task import FINITE, RETRIGGERABLE, SimulatedTask
from rig.simulated.rpc.properties.channel import CHANNEL_GETTABLE, LIMIT_NAMES, find_channels, set_limit
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

DRIVER_VERSION = {0x1272: 26, 0x1923: 0, 0x2F22: 0}
"""Major, minor and update number of NI-DAQmx that the virtual device behaves like."""
DIGITAL_EDGE = 10150
DO_NOT_OVERWRITE = 10159
CO_TERM, RAW_SAMPLE_SIZE = 0x18E1, 0x22DA
ARM_EDGE, ARM_SOURCE = 0x1415, 0x1417
ENCODER_TERMINALS = (0x219D, 0x219E)
EDGE_TERMINALS = tuple(MEASURED_ON.values())
CI_SETTABLE = (*ENCODER_TERMINALS, *EDGE_TERMINALS, 0x21FB, 0x21FC, 0x2200, 0x2201)

SETTABLE: dict[str, frozenset[int]] = {
    "Read": frozenset({0x1211}),
    "Buffer": frozenset({0x186C, 0x186D}),
    "Write": frozenset({0x1453}),
    "Chan": frozenset({*CI_SETTABLE, *LIMIT_NAMES, CO_TERM, SHUNT}),
    "Trig": frozenset({ARM_TYPE, ARM_EDGE, ARM_SOURCE, RETRIGGERABLE}),
}

Getter = Callable[["SimulatedDevice", SimulatedTask], Any]


def _clock(field: str) -> Getter:
    def get(device: SimulatedDevice, task: SimulatedTask) -> Any:
        if task.clock is None or (task.implicit and field in ("rate_hz", "source")):
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name} has no sample clock")
        return getattr(task.clock, field)

    return get


def _samples(field: str) -> Getter:
    def get(device: SimulatedDevice, task: SimulatedTask) -> int:
        if field == "available":
            waiting.catch_up(device, task)
        return getattr(task.buffer, field) if task.buffer is not None else 0

    return get


def _default_samples_to_read(device: SimulatedDevice, task: SimulatedTask) -> int:
    if task.clock is not None and task.clock.mode == FINITE:
        return task.clock.samples
    waiting.catch_up(device, task)
    return task.buffer.available if task.buffer is not None else 0


def _clock_source(device: SimulatedDevice, task: SimulatedTask) -> str:
    source = _clock("source")(device, task)
    return "/" + device.inventory.full_name(source) if source else ""


def _terminal(device: SimulatedDevice, relative: str) -> str:
    return "/" + device.inventory.full_name(relative) if relative else ""


def _start_terminal(device: SimulatedDevice, task: SimulatedTask) -> str:
    """Where the task's own start trigger can be taken from."""
    if task.type not in ("AI", "AO", "DI", "DO"):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: start trigger terminal")
    return _terminal(device, f"{task.type.lower()}/StartTrigger")


def _lines_per_channel(task: SimulatedTask) -> list[int]:
    return [len(channel.settings.get("lines", "1")) for channel in task.channels] or [0]


def _space_available(device: SimulatedDevice, task: SimulatedTask) -> int:
    written = task.output.shape[0] if task.output is not None else 0
    size = task.capacity if task.state == "running" else int(task.setting("Buffer", "", 0x186D, written))
    return max(size - max(written - task.generated, 0), 0)


def _timing_type(device: SimulatedDevice, task: SimulatedTask) -> int:
    if task.type == "CO" or task.implicit:
        return 10451  # implicit
    return 12504 if task.changes else 10388 if task.clock is not None else 10390


def _raw_width(device: SimulatedDevice, task: SimulatedTask) -> int:
    """Bytes of one raw sample of all channels."""
    sizes = [CHANNEL_GETTABLE[RAW_SAMPLE_SIZE](device, task, channel) for channel in task.channels]
    if not sizes or None in sizes:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: raw samples")
    return sum(sizes) // 8


GETTABLE: dict[tuple[str, int], Getter] = {
    ("Task", 0x1276): lambda device, task: task.name,
    ("Task", 0x1273): lambda device, task: ", ".join(channel.name for channel in task.channels),
    ("Task", 0x2181): lambda device, task: len(task.channels),
    ("Task", 0x1274): lambda device, task: task.done,
    ("Task", 0x29BA): lambda device, task: 1 if task.channels else 0,
    ("Task", 0x230E): lambda device, task: device.inventory.name,
    ("Timing", 0x1344): _clock("rate_hz"),
    ("Timing", 0x1852): _clock_source,
    ("Timing", 0x1300): _clock("mode"),
    ("Timing", 0x1310): _clock("samples"),
    ("Read", 0x1823): lambda device, task: ", ".join(channel.name for channel in task.channels),
    ("Write", 0x217F): lambda device, task: max(_lines_per_channel(task)),
    ("Read", 0x217C): lambda device, task: max(_lines_per_channel(task)),
    ("Write", 0x1453): lambda device, task: task.setting("Write", "", 0x1453, 10097),
    ("Write", 0x1460): _space_available,
    ("Write", 0x1458): lambda device, task: task.generated,
    ("Trig", 0x190F): lambda device, task: task.retriggerable,
    ("Trig", 0x2F1E): _start_terminal,
    ("Trig", 0x1407): lambda device, task: _terminal(device, task.start_trigger),
    ("Trig", 0x1393): lambda device, task: DIGITAL_EDGE if task.start_trigger else NO_TRIGGER,
    ("Timing", 0x1347): _timing_type,
    ("Read", 0x217A): _raw_width,
    ("Read", 0x217B): lambda device, task: len(task.channels),
    ("Read", 0x1223): _samples("available"),
    ("Read", 0x192A): _samples("acquired"),
    ("Read", 0x1221): _samples("read"),
    ("Read", 0x31E8): _default_samples_to_read,
    ("Read", 0x1211): lambda device, task: task.setting("Read", "", 0x1211, DO_NOT_OVERWRITE),
    ("Buffer", 0x186C): lambda device, task: task.buffer_size,
    ("Write", 0x217E): lambda device, task: len(task.channels),
    ("Write", 0x192B): lambda device, task: task.generated,
}


def get(device: SimulatedDevice, task: SimulatedTask, category: str, channel: str, attribute: int) -> Any:
    """Return a property of a task or of one of its channels."""
    if (category, attribute) in GETTABLE:
        return GETTABLE[category, attribute](device, task)
    if category == "Chan":
        found = find_channels(task, channel)[0]
        channel = found.name
        if attribute in CHANNEL_GETTABLE and (value := CHANNEL_GETTABLE[attribute](device, task, found)) is not None:
            return value
    if (category, channel, attribute) in task.attributes:
        return task.attributes[category, channel, attribute]
    raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} ({category}) of {task.name}")


def put(device: SimulatedDevice, task: SimulatedTask, category: str, channel: str, attribute: int, value: Any) -> None:
    """Set a property, after checking terminals and trigger types; refused while the task runs."""
    if attribute not in SETTABLE.get(category, frozenset()):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} ({category}) of {task.name}")
    if task.state == "running":
        raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
    names = [""]
    if category == "Chan":
        channels = find_channels(task, channel)
        names = [found.name for found in channels]
        if attribute in LIMIT_NAMES:
            for found in channels:
                set_limit(device, task, found, attribute, value)
            return
        wanted = "CO" if attribute == CO_TERM else "AI" if attribute == SHUNT else "CI"
        bridge = attribute != SHUNT or all(found.physical.kind == "bridge" for found in channels)
        if task.type != wanted or not bridge:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} of {channel}")
    if attribute in (*ENCODER_TERMINALS, *EDGE_TERMINALS, ARM_SOURCE):
        device.inventory.terminal(value)
    if attribute == CO_TERM:
        device.inventory.terminal(value, output=True)
    if attribute == 0x1211 and value != DO_NOT_OVERWRITE:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "only DO_NOT_OVERWRITE_UNREAD_SAMPLES is simulated")
    if attribute == ARM_TYPE and value not in (DIGITAL_EDGE, NO_TRIGGER):
        raise DaqStatusError(status.INVALID_VALUE, f"Arm start trigger type {value}")
    if attribute == RETRIGGERABLE and (task.type not in ("AI", "AO", "DI", "DO") or task.ref_trigger):
        raise NotImplementedByDevice(f"retriggering a {task.type} task")
    for name in names:
        task.attributes[category, name, attribute] = value
    if attribute in (ARM_TYPE, ARM_SOURCE):
        armed = task.setting("Trig", "", ARM_TYPE, NO_TRIGGER) == DIGITAL_EDGE
        source = task.setting("Trig", "", ARM_SOURCE, "")
        task.arm_trigger = device.inventory.terminal(source) if armed and source else ""
