"""Calls of a DAQmx client about watchdog timer tasks; starting, stopping and clearing one are the calls of any task."""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import (
    control_watchdog,
    set_expiration_level,
    set_expiration_volts,
    watchdog_timer,
)
from rig.simulated.driver.tasks import create_watchdog_task
from rig.simulated.product.inventory import channel_names
from rig.simulated.rpc.calls.device import refuse_other_device
from rig.simulated.rpc.handlers import DeviceHandler, Fields
from rig.simulated.rpc.messages import enum, property_number
from rig.simulated.rpc.task_sessions import open_session
from rig.simulated.status import DaqStatusError

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
}
