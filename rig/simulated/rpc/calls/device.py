"""Calls of a DAQmx client about the system and the device: versions, names, properties, reset."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.device.device import SimulatedDevice
from rig.simulated.messages import CALLS, attribute_response, enum, response
from rig.simulated.rpc.properties import task as attributes
from rig.simulated.rpc.properties.device import device_property
from rig.simulated.status import DaqStatusError

DEVICE_NAMES = 0x193B
SAVED = (0x1265, 0x1266, 0x1267)
"""Global channels, scales and tasks saved on the system: there are none."""


def _system_number(device: SimulatedDevice, request: Any) -> Any:
    number = enum(request, "attribute")
    if number not in attributes.DRIVER_VERSION:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
    return response("GetSystemInfoAttributeUInt32", value=attributes.DRIVER_VERSION[number])


def _system_text(device: SimulatedDevice, request: Any) -> Any:
    number = enum(request, "attribute")
    if number not in (DEVICE_NAMES, *SAVED):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
    names = ", ".join(device.inventory.devices()) if number == DEVICE_NAMES else ""
    return response("GetSystemInfoAttributeString", value=names)


def _device_attribute(call: str) -> Callable[[SimulatedDevice, Any], Any]:
    def get(device: SimulatedDevice, request: Any) -> Any:
        return attribute_response(call, device_property(device, request.device_name, enum(request, "attribute")))

    return get


def _refuse_other_device(device: SimulatedDevice, name: str) -> None:
    if name.lower() != device.inventory.name.lower():
        raise DaqStatusError(status.INVALID_DEVICE, f"Device: {name}")


def _reset(device: SimulatedDevice, request: Any) -> Any:
    _refuse_other_device(device, request.device_name)
    device.reset()
    return response("ResetDevice")


def _self_test(device: SimulatedDevice, request: Any) -> Any:
    _refuse_other_device(device, request.device_name)
    return response("SelfTestDevice")


DEVICE_CALLS: dict[str, Callable[[SimulatedDevice, Any], Any]] = {
    "GetSystemInfoAttributeUInt32": _system_number,
    "GetSystemInfoAttributeString": _system_text,
    **{call: _device_attribute(call) for call in CALLS if re.match("GetDeviceAttribute", call)},
    "ResetDevice": _reset,
    "SelfTestDevice": _self_test,
}
