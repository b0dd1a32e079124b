"""Calls of a DAQmx client about the system and the device: versions, names, channels, reset."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import attributes, status
from rig.simulated.device import SimulatedDevice
from rig.simulated.messages import enum, response
from rig.simulated.products import Kind
from rig.simulated.status import DaqStatusError

PRODUCT_TYPE, IS_SIMULATED, DEVICE_NAMES = 0x0631, 0x22CA, 0x193B
CHANNELS: dict[int, tuple[Kind, ...]] = {
    0x231E: ("bridge", "voltage_in"),
    0x231F: ("voltage_out",),
    0x2320: ("line", "static_line"),
    0x2322: ("line", "static_line"),
    0x2324: ("counter",),
    0x2325: ("counter",),
}
PORTS = (0x2321, 0x2323)


def _check(device: SimulatedDevice, name: str) -> None:
    if name.lower() != device.inventory.name.lower():
        raise DaqStatusError(status.INVALID_DEVICE, f"Device: {name}")


def _system_number(device: SimulatedDevice, request: Any) -> Any:
    number = enum(request, "attribute")
    if number not in attributes.DRIVER_VERSION:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
    return response("GetSystemInfoAttributeUInt32", value=attributes.DRIVER_VERSION[number])


def _system_text(device: SimulatedDevice, request: Any) -> Any:
    if enum(request, "attribute") != DEVICE_NAMES:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (System)")
    return response("GetSystemInfoAttributeString", value=device.inventory.name)


def _device_text(device: SimulatedDevice, request: Any) -> Any:
    _check(device, request.device_name)
    number = enum(request, "attribute")
    if number == PRODUCT_TYPE:
        value = device.inventory.product.name
    elif number in CHANNELS:
        value = ", ".join(device.inventory.names(*CHANNELS[number]))
    elif number in PORTS:
        ports = {name.rsplit("/line", 1)[0]: None for name in device.inventory.names("line", "static_line")}
        value = ", ".join(ports)
    else:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Device)")
    return response("GetDeviceAttributeString", value=value)


def _device_bool(device: SimulatedDevice, request: Any) -> Any:
    _check(device, request.device_name)
    if enum(request, "attribute") != IS_SIMULATED:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Device)")
    return response("GetDeviceAttributeBool", value=True)  # it says what it is


def _reset(device: SimulatedDevice, request: Any) -> Any:
    _check(device, request.device_name)
    device.reset()
    return response("ResetDevice")


def _self_test(device: SimulatedDevice, request: Any) -> Any:
    _check(device, request.device_name)
    return response("SelfTestDevice")


DEVICE_CALLS: dict[str, Callable[[SimulatedDevice, Any], Any]] = {
    "GetSystemInfoAttributeUInt32": _system_number,
    "GetSystemInfoAttributeString": _system_text,
    "GetDeviceAttributeString": _device_text,
    "GetDeviceAttributeBool": _device_bool,
    "ResetDevice": _reset,
    "SelfTestDevice": _self_test,
}
