"""Calls of a DAQmx client about watchdog timer tasks; starting, stopping and clearing one are the calls of any task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.device.device import SimulatedDevice
from rig.simulated.messages import enum, response, session
from rig.simulated.product.inventory import channel_names
from rig.simulated.status import DaqStatusError

EXPIRED = 0x21A8


def _create(device: SimulatedDevice, request: Any) -> Any:
    if request.device_name.lower() != device.inventory.name.lower():
        raise DaqStatusError(status.INVALID_DEVICE, f"Device: {request.device_name}")
    found = device.attached(request.session_name, request.initialization_behavior)
    task = found or device.watchdogs.create(request.session_name, request.timeout)
    return response("CreateWatchdogTimerTaskEx", task=session(task.name), new_session_initialized=found is None)


def _states(request: Any, *arrays: Any) -> Any:
    names = channel_names(request.channel_names)
    if any(len(array) != len(names) for array in arrays):
        raise DaqStatusError(status.INVALID_VALUE, f"Expiration states for {len(names)} channels")
    return zip(names, *arrays, strict=True)


def _analog_states(device: SimulatedDevice, request: Any) -> Any:
    timer = device.watchdogs.timer(request.task.name)
    for channel, volts, kind in _states(request, request.expir_state_array, request.output_type_array):
        timer.set_volts(channel, volts, kind)
    return response("CfgWatchdogAOExpirStates")


def _digital_states(device: SimulatedDevice, request: Any) -> Any:
    timer = device.watchdogs.timer(request.task.name)
    for line, level in _states(request, request.expir_state_array):
        timer.set_line(line, level)
    return response("CfgWatchdogDOExpirStates")


def _control(device: SimulatedDevice, request: Any) -> Any:
    device.watchdogs.timer(request.task.name).control(enum(request, "action"))
    return response("ControlWatchdogTask")


def _expired(device: SimulatedDevice, request: Any) -> Any:
    if enum(request, "attribute") != EXPIRED:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Watchdog)")
    return response("GetWatchdogAttributeBool", value=device.watchdogs.timer(request.task.name).expired)


WATCHDOG_CALLS: dict[str, Callable[[SimulatedDevice, Any], Any]] = {
    "CreateWatchdogTimerTaskEx": _create,
    "CfgWatchdogAOExpirStates": _analog_states,
    "CfgWatchdogDOExpirStates": _digital_states,
    "ControlWatchdogTask": _control,
    "GetWatchdogAttributeBool": _expired,
}
