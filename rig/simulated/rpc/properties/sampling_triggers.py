"""Analog and pause triggers of a task, from the properties a client has set, as the virtual device acts on them.

Built are edges (with hysteresis) and windows of the first analog input of a card as start and reference triggers, and a
digital level that pauses a task with a sample clock of its own. Other kinds are kept and their tasks refused.
"""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx, status
from rig.simulated.device.comparator import AnalogShape
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.rpc.messages import property_number
from rig.simulated.rpc.properties import stored
from rig.simulated.status import DaqStatusError

BUILT = ("analog edge", "analog window")
DIGITAL_LEVEL = 10152
PAUSE_TYPE = property_number("Trig", "PAUSE_TRIG_TYPE")


def settle(device: DeviceState, task: SimulatedTask) -> None:
    """Take over what a client has set; refuses, by the driver's code, what the product cannot do."""
    kinds = task.triggers.analog_kinds
    for what in ("pause trigger", "start trigger on", "reference trigger on"):
        task.unsimulated.pop(what, None)
    task.triggers.analog_start = _shape(device, task, kinds.get("start trigger", ""), "START")
    task.triggers.analog_reference = _shape(device, task, kinds.get("reference trigger", ""), "REF")
    task.triggers.pause, task.triggers.pause_high = _pause(device, task)


def _set(task: SimulatedTask, name: str) -> Any:
    number = property_number("Trig", name)
    return task.setting("Trig", "", number, stored.STORED["Trig", number].default)


def _shape(device: DeviceState, task: SimulatedTask, kind: str, which: str) -> AnalogShape | None:
    if kind not in BUILT:
        return None
    product = device.inventory.of(task.channels[0].physical.name).product
    if task.type != "AI" or product.chassis:
        task.unsimulated[f"{'start' if which == 'START' else 'reference'} trigger on"] = f"{kind}, {product.name}"
        return None
    if not product.apfi:
        raise DaqStatusError(status.NO_ANALOG_TRIGGER, f"Task: {task.name}: {kind} on {product.name}")
    shape = "ANLG_EDGE" if kind == "analog edge" else "ANLG_WIN"
    source = _set(task, f"{shape}_{which}_TRIG_SRC")
    first = task.channels[0]
    wired = source in (first.name, first.physical.name)
    if not wired and "APFI" not in source:
        others = any(source in (channel.name, channel.physical.name) for channel in task.channels)
        code = status.NOT_FIRST_IN_SCAN_LIST if others else status.INVALID_ANALOG_SOURCE
        raise DaqStatusError(code, f"Task: {task.name}, source: {source!r}")
    name = first.name if wired else ""
    if kind == "analog window":
        entering = _set(task, f"{shape}_{which}_TRIG_WHEN") == stored.ENTERING_WINDOW
        window = (_set(task, f"{shape}_{which}_TRIG_BTM"), _set(task, f"{shape}_{which}_TRIG_TOP"))
        if window[0] >= window[1]:
            raise DaqStatusError(status.INVALID_VALUE, f"Task: {task.name}: window {window[0]:g} to {window[1]:g}")
        return AnalogShape(name, entering, 0.0, 0.0, window)
    level, hysteresis = _set(task, f"{shape}_{which}_TRIG_LVL"), _set(task, f"{shape}_{which}_TRIG_HYST")
    rising = _set(task, f"{shape}_{which}_TRIG_SLOPE") == stored.RISING
    return AnalogShape(name, rising, level, level - hysteresis if rising else level + hysteresis)


def _pause(device: DeviceState, task: SimulatedTask) -> tuple[str, bool]:
    kind = task.setting("Trig", "", PAUSE_TYPE, daqmx.NO_TRIGGER)
    if kind == daqmx.NO_TRIGGER:
        return "", True
    if task.triggers.referenced:
        raise DaqStatusError(status.REFERENCE_AND_PAUSE, f"Task: {task.name}")
    source, when = _set(task, "DIG_LVL_PAUSE_TRIG_SRC"), _set(task, "DIG_LVL_PAUSE_TRIG_WHEN")
    if kind != DIGITAL_LEVEL or not task.timing.own_clock:
        task.unsimulated["pause trigger"] = f"type {kind} of a {task.type} task"
        return "", True
    return device.inventory.terminal(source), when == daqmx.HIGH
