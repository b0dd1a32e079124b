"""Calls of a DAQmx client about watchdog timer tasks; starting, stopping and clearing one are the calls of any task."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState, WatchdogTimer
from rig.simulated.device.watchdog import (
    control_watchdog,
    refuse_bad_timer,
    set_expiration_level,
    set_expiration_volts,
    watchdog_timer,
)
from rig.simulated.driver.tasks import create_watchdog_task
from rig.simulated.product.inventory import channel_names
from rig.simulated.rpc.calls.device import refuse_other_device
from rig.simulated.rpc.handlers import DeviceHandler, Fields
from rig.simulated.rpc.messages import CALLS, attribute_fields, attribute_value, enum, property_number
from rig.simulated.rpc.task_sessions import open_session
from rig.simulated.status import DaqStatusError

DEFAULT_TIMEOUT_S = 10.0
TIMEOUT = property_number("Watchdog", "TIMEOUT")
LINE_STATE = property_number("Watchdog", "DO_EXPIR_STATE")
RISING = 10280
KEPT: dict[int, str | int] = {
    property_number("Watchdog", "DIG_EDGE_WATCHDOG_EXPIR_TRIG_EDGE"): RISING,
    property_number("Watchdog", "DIG_EDGE_WATCHDOG_EXPIR_TRIG_SRC"): "",
}
"""Settings of an expiration by a trigger, with their defaults; a timer with such a trigger is refused when started."""
HAS_EXPIRED = property_number("Watchdog", "HAS_EXPIRED")


def _create(device: DeviceState, request: Any) -> Fields:
    refuse_other_device(device, request.device_name)
    name, timeout_s = request.session_name, request.timeout
    return open_session(device, request, lambda: create_watchdog_task(device, name, timeout_s, request.device_name))


def _states(request: Any, *arrays: Any) -> Any:
    names = channel_names(request.channel_names)
    if any(len(array) != len(names) for array in arrays):
        raise DaqStatusError(status.INVALID_VALUE, f"Expiration states for {len(names)} channels")
    return zip(names, *arrays, strict=True)


def _analog_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for channel, volts, kind in _states(request, request.expir_state_array, request.output_type_array):
        set_expiration_volts(device, timer, channel, volts, kind)


def _digital_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for line, level in _states(request, request.expir_state_array):
        set_expiration_level(device, timer, line, level)


def _control(device: DeviceState, request: Any) -> None:
    control_watchdog(device, watchdog_timer(device, request.task.name), enum(request, "action"))


def _property(call: str) -> DeviceHandler:
    """Return what answers a call for a property of a watchdog task other than whether it has expired."""

    def get(device: DeviceState, request: Any) -> Fields:
        timer = watchdog_timer(device, request.task.name)
        number = enum(request, "attribute")
        if number == TIMEOUT:
            return attribute_fields(call, timer.timeout_s)
        if number == LINE_STATE:
            return attribute_fields(call, _line_state(device, timer, request.lines))
        if number not in KEPT:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (Watchdog)")
        return attribute_fields(call, timer.settings.get(number, KEPT[number]))

    return get


def _line_state(device: DeviceState, timer: WatchdogTimer, line: str) -> int:
    name = device.inventory.channel(line, "line").name
    if name not in timer.levels:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Physical Channel: {line} has no expiration state")
    return timer.levels[name]


def _set(device: DeviceState, request: Any) -> None:
    _put(device, request, enum(request, "attribute"), attribute_value(request))


def _reset(device: DeviceState, request: Any) -> None:
    number = enum(request, "attribute")
    defaults = {**KEPT, TIMEOUT: DEFAULT_TIMEOUT_S, LINE_STATE: daqmx.NO_CHANGE}
    _put(device, request, number, defaults.get(number))


def _put(device: DeviceState, request: Any, number: int, value: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    device.tasks[request.task.name].refuse_while_running()
    if number == TIMEOUT and isinstance(value, int | float):
        refuse_bad_timer(device.inventory.of(timer.device), timer.name, float(value))
        timer.timeout_s = float(value)
    elif number == LINE_STATE and isinstance(value, int):
        set_expiration_level(device, timer, request.lines, value)
    elif number in KEPT and type(value) is type(KEPT[number]):
        timer.settings[number] = value
    else:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (Watchdog)")


def _expired(device: DeviceState, request: Any) -> Fields:
    if enum(request, "attribute") != HAS_EXPIRED:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Watchdog)")
    timer = watchdog_timer(device, request.task.name)
    if device.tasks[request.task.name].state == "unreserved":
        raise DaqStatusError(status.NOT_WHILE_UNRESERVED, f"Task: {request.task.name}")
    return {"value": timer.expired}


WATCHDOG_CALLS: dict[str, DeviceHandler] = {
    "CreateWatchdogTimerTaskEx": _create,
    "CfgWatchdogAOExpirStates": _analog_states,
    "CfgWatchdogDOExpirStates": _digital_states,
    "ControlWatchdogTask": _control,
    "GetWatchdogAttributeBool": _expired,
    **{
        call: _property(call)
        for call in CALLS
        if call.startswith("GetWatchdogAttribute") and call != "GetWatchdogAttributeBool"
    },
    **{call: _set for call in CALLS if call.startswith("SetWatchdogAttribute")},
    "ResetWatchdogAttribute": _reset,
}
