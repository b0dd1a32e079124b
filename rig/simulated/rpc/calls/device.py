"""Calls of a DAQmx client about the system and the device: new tasks, versions, names, properties, reset."""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.driver.tasks import create_task, reset_device
from rig.simulated.rpc.handlers import DeviceHandler, Fields
from rig.simulated.rpc.messages import CALLS, attribute_fields, enum, property_number
from rig.simulated.rpc.properties.device import device_property
from rig.simulated.rpc.task_sessions import open_session
from rig.simulated.status import DaqStatusError

DRIVER_VERSION = {"NIDAQ_MAJOR_VERSION": 26, "NIDAQ_MINOR_VERSION": 0, "NIDAQ_UPDATE_VERSION": 0}
"""Version of NI-DAQmx that the virtual device behaves like."""
_SYSTEM_NUMBERS = {property_number("System", name): value for name, value in DRIVER_VERSION.items()}
_DEV_NAMES = property_number("System", "DEV_NAMES")
_SAVED = tuple(property_number("System", name) for name in ("GLOBAL_CHANS", "SCALES", "TASKS"))
"""Global channels, scales and tasks saved on the system: there are none."""


def _system_number(device: DeviceState, request: Any) -> Fields:
    number = enum(request, "attribute")
    if number not in _SYSTEM_NUMBERS:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
    return {"value": _SYSTEM_NUMBERS[number]}


def _system_text(device: DeviceState, request: Any) -> Fields:
    number = enum(request, "attribute")
    if number not in (_DEV_NAMES, *_SAVED):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
    return {"value": ", ".join(device.inventory.devices()) if number == _DEV_NAMES else ""}


def _device_attribute(call: str) -> DeviceHandler:
    return lambda device, request: attribute_fields(
        call, device_property(device, request.device_name, enum(request, "attribute"))
    )


def refuse_other_device(device: DeviceState, name: str) -> None:
    """Refuse the name of a device that is none of those served."""
    if name.lower() != device.inventory.of(name).name.lower():
        raise DaqStatusError(status.INVALID_DEVICE, f"Device: {name}")


def _reset(device: DeviceState, request: Any) -> None:
    refuse_other_device(device, request.device_name)
    reset_device(device, device.inventory.of(request.device_name))


DEVICE_CALLS: dict[str, DeviceHandler] = {
    "CreateTask": lambda device, request: open_session(
        device, request, lambda: create_task(device, request.session_name)
    ),
    "GetErrorString": lambda device, request: {
        "error_string": status.TEXTS.get(request.error_code, "Error code could not be found.")
    },
    "GetSystemInfoAttributeUInt32": _system_number,
    "GetSystemInfoAttributeString": _system_text,
    **{call: _device_attribute(call) for call in CALLS if call.startswith("GetDeviceAttribute")},
    "ResetDevice": _reset,
    "SelfTestDevice": lambda device, request: refuse_other_device(device, request.device_name),
}
