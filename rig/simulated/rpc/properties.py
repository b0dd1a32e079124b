"""The properties of tasks and their channels that a client gets or sets: how each is answered.

A getter returns None for a task or channel that does not have the property; the caller refuses then. A setting that the
virtual device does not act on is refused, so that none is taken and then ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.driver import find_task
from rig.simulated.product import channel_names
from rig.simulated.rpc.messages import Property, enum
from rig.simulated.status import Code, DaqStatusError, NotAnswered, Unsupported, require_one_of
from rig.simulated.timing import await_something

CHANNEL_TYPE = {"AI": 10100, "AO": 10102, "DO": 10153, "CI": 10131, "CO": 10132}
FORCE_BRIDGE, ANGULAR_ENCODER, COUNT_EDGES = 15899, 10360, 10125
DO_NOT_OVERWRITE = 10159


def task_property(get: Callable[[DeviceState, SimulatedTask], Any]) -> Property:
    return Property(lambda device, request: get(device, find_task(device, request.task.name)))


def channel_property(type_: str, get: Callable[[DeviceState, SimulatedTask, Channel], Any]) -> Property:
    """Read-only property of a channel: ``get`` gives it for the first channel that the request names, in tasks of type
    ``type_`` ("" for every type); in others it is None, which the caller refuses."""

    def answer(device: DeviceState, request: Any) -> Any:
        task = find_task(device, request.task.name)
        channel = find_channels(task, request.channel)[0]
        return get(device, task, channel) if type_ in ("", task.type) else None

    return Property(answer)


def find_channels(task: SimulatedTask, name: str) -> list[Channel]:
    """Return the channels of a list of names, all of them for an empty one; at least one."""
    wanted = set(channel_names(name)) if name.strip() else {""}
    found = [channel for channel in task.channels if wanted & {"", channel.name}]
    if not found:
        raise DaqStatusError(Code.PHYSICAL_CHAN_DOES_NOT_EXIST, f"Channel: {name!r} in task {task.name}")
    return found


def sample_rate(device: DeviceState, task: SimulatedTask) -> float:
    if task.clock is None:
        raise Unsupported(f"Task: {task.name} has no sample clock")
    return task.clock.rate_hz


def list_channel_names(device: DeviceState, task: SimulatedTask) -> str:
    return ", ".join(channel.name for channel in task.channels)


def sample_count(field: str) -> Property:
    """Read-only property of a task: the samples per channel ``read``, ``acquired`` or ``available`` in its input
    buffer, 0 without one. Asking for the last two lets time pass on a virtual clock where none are available."""

    def get(device: DeviceState, task: SimulatedTask) -> int:
        if field != "read":
            await_something(device, task)
        return getattr(task.buffer, field) if task.buffer is not None else 0

    return task_property(get)


def default_sample_count(device: DeviceState, task: SimulatedTask) -> int:
    """Samples that the client reads when it is asked for all there are."""
    if task.clock is not None and task.is_finite:
        return task.clock.samples
    await_something(device, task)
    return task.buffer.available if task.buffer is not None else 0


def scaling_coefficients(device: DeviceState, task: SimulatedTask, channel: Channel) -> list[float]:
    """Polynomial from codes of the converter to V, or V/V of a bridge."""
    owner = device.inventory.owner_of(channel.physical.name)
    product = owner.product
    if channel.physical.kind == "bridge":
        return [0.0, 2e-3 * product.bridge_range_mv_per_v / 2**product.bridge_bits]
    return [0.0, 2 * owner.half_range(channel.settings) / 2**product.ai_bits]


Check = Callable[[DeviceState, Channel, Any], None]
"""Refuses a value of a setting of a channel."""


def task_setting(category: str, kind: type, check: Callable[[DeviceState, Any], None]) -> Property:
    """Property of a task that a client sets, and gets as it was set, None before; ``category`` is NI's, such as
    ``Read``, ``kind`` the type of the value, which ``check`` may refuse. A running task refuses to be set."""

    def get(device: DeviceState, request: Any) -> Any:
        return find_task(device, request.task.name).setting(category, "", enum(request, "attribute"), None)

    def set_value(device: DeviceState, task: SimulatedTask, request: Any, value: Any) -> None:
        _refuse_other_kind(value, kind)
        task.refuse_while_running()
        check(device, value)
        task.properties[category, "", enum(request, "attribute")] = value
        if category == "Trig":
            _settle_arm_start(device, task)

    return Property(get, set_value)


def channel_setting(type_: str, kind: type, check: Check) -> Property:
    """Property of channels of a task of type ``type_`` that a client sets, and gets as it was set, None before;
    ``kind`` is the type of the value, which ``check`` may refuse for a channel. A running task refuses to be set."""

    def get(device: DeviceState, request: Any) -> Any:
        task = find_task(device, request.task.name)
        return task.setting("Chan", find_channels(task, request.channel)[0].name, enum(request, "attribute"), None)

    def set_value(device: DeviceState, task: SimulatedTask, request: Any, value: Any) -> None:
        _refuse_other_kind(value, kind)
        if task.type != type_:
            raise Unsupported(f"Task: {task.name} is {task.type}")
        task.refuse_while_running()
        channels = find_channels(task, request.channel)
        for channel in channels:
            check(device, channel, value)
        for channel in channels:
            task.properties["Chan", channel.name, enum(request, "attribute")] = value

    return Property(get, set_value)


def _refuse_other_kind(value: Any, kind: type) -> None:
    if type(value) is not kind:
        raise Unsupported(f"value {value!r}, allowed a {kind.__name__}")


def check_terminal(device: DeviceState, channel: Channel, value: str) -> None:
    device.inventory.terminal(value)


def check_output_terminal(device: DeviceState, channel: Channel, value: str) -> None:
    device.inventory.terminal(value, output=True)


def check_bridge(device: DeviceState, channel: Channel, value: object) -> None:
    if channel.physical.kind != "bridge":
        raise Unsupported(f"shunt calibration of {channel.name}")


def accept_any(*anything: object) -> None:
    """Accept every value: a filter of an encoder's inputs passes what the virtual encoder gives."""


def check_arm_type(device: DeviceState, value: int) -> None:
    require_one_of(value, (daqmx.DIGITAL_EDGE, daqmx.NO_TRIGGER), "Arm start trigger type")


def check_arm_source(device: DeviceState, value: str) -> None:
    device.inventory.terminal(value)


def check_rising(device: DeviceState, value: int) -> None:
    if value != daqmx.RISING:
        raise NotAnswered(f"edge {value} of the arm start trigger")


def check_overwrite(device: DeviceState, value: int) -> None:
    if value != DO_NOT_OVERWRITE:
        raise NotAnswered(f"overwrite mode {value}")


def _settle_arm_start(device: DeviceState, task: SimulatedTask) -> None:
    armed = task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) == daqmx.DIGITAL_EDGE
    source = task.setting("Trig", "", daqmx.DIG_EDGE_ARM_START_TRIG_SRC, "")
    task.triggers.arm_start = device.inventory.terminal(source) if armed and source else ""
