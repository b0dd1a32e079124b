"""Calls of a DAQmx client about watchdog timer tasks; starting, stopping and clearing one are the calls of any task."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import (
    control_watchdog,
    refuse_bad_timer,
    set_expiration_level,
    set_expiration_volts,
    watchdog_timer,
)
from rig.simulated.driver import create_watchdog_task
from rig.simulated.product.inventory import channel_names
from rig.simulated.rpc.calls.device import refuse_other_device
from rig.simulated.rpc.messages import DeviceHandler, Fields, Key, Properties, enum, open_session, property_number
from rig.simulated.status import Code, DaqStatusError, Unsupported

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
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Expiration states for {len(names)} channels")
    return zip(names, *arrays, strict=True)


def _analog_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for channel, volts, kind in _states(request, request.expir_state_array, request.output_type_array):
        set_expiration_volts(device, timer, channel, volts, kind)


def _digital_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for line, level in _states(request, request.expir_state_array):
        set_expiration_level(device, timer, line, level)


def _get(device: DeviceState, request: Any, key: Key) -> Any:
    timer, number = watchdog_timer(device, request.task.name), key[1]
    if number == TIMEOUT:
        return timer.timeout_s
    if number == HAS_EXPIRED:
        if device.tasks[request.task.name].state == "unreserved":
            code = Code.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING
            raise DaqStatusError(code, f"Task: {request.task.name}")
        return timer.expired
    if number == LINE_STATE:
        return timer.levels.get(device.inventory.channel(request.lines, "line").name)
    return timer.settings.get(number, KEPT.get(number))


def _put(device: DeviceState, request: Any, key: Key, value: Any) -> None:
    timer, number = watchdog_timer(device, request.task.name), key[1]
    device.tasks[request.task.name].refuse_while_running()
    if number == TIMEOUT and isinstance(value, int | float):
        refuse_bad_timer(device.inventory.of(timer.device), request.task.name, float(value))
        timer.timeout_s = float(value)
    elif number == LINE_STATE and isinstance(value, int):
        set_expiration_level(device, timer, request.lines, value)
    elif number in KEPT and type(value) is type(KEPT[number]):
        timer.settings[number] = value
    else:
        raise Unsupported(f"Property: 0x{number:04X} (Watchdog)")


def _reset(device: DeviceState, request: Any, key: Key) -> None:
    defaults = {**KEPT, TIMEOUT: DEFAULT_TIMEOUT_S, LINE_STATE: daqmx.NO_CHANGE}
    _put(device, request, key, defaults.get(key[1]))


WATCHDOG_CALLS: dict[str, DeviceHandler] = {
    "CreateWatchdogTimerTaskEx": _create,
    "CfgWatchdogAOExpirStates": _analog_states,
    "CfgWatchdogDOExpirStates": _digital_states,
    "ControlWatchdogTask": lambda device, request: control_watchdog(
        device, watchdog_timer(device, request.task.name), enum(request, "action")
    ),
}
WATCHDOG_PROPERTIES = Properties(_get, _put, _reset)
