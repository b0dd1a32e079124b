"""Calls about a card's own calibration, and about tasks, channels and scales saved on the system.

A simulated device keeps no calibration: the driver answers with zeros and the recommended interval, and takes a
self-calibration without effect. Nothing is saved on the virtual system, so every name is unknown.
"""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.rpc.calls.device import refuse_other_device
from rig.simulated.rpc.handlers import DeviceHandler, Fields
from rig.simulated.rpc.messages import CALLS, attribute_fields, enum, property_number
from rig.simulated.status import DaqStatusError

MONTHS = 24
"""Recommended interval of calibration of an X Series card."""
_INFO: dict[int, float | int] = {
    property_number("CalibrationInfo", "CAL_DEV_TEMP"): 0.0,
    property_number("CalibrationInfo", "EXT_CAL_LAST_TEMP"): 0.0,
    property_number("CalibrationInfo", "SELF_CAL_LAST_TEMP"): 0.0,
    property_number("CalibrationInfo", "EXT_CAL_RECOMMENDED_INTERVAL"): MONTHS,
}


def _info(call: str) -> DeviceHandler:
    def get(device: DeviceState, request: Any) -> Fields:
        refuse_other_device(device, request.device_name)
        number = enum(request, "attribute")
        if number not in _INFO or device.inventory.of(request.device_name).product.chassis:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} of {request.device_name}")
        return attribute_fields(call, _INFO[number])

    return get


def _of_card(device: DeviceState, request: Any) -> None:
    refuse_other_device(device, request.device_name)
    if device.inventory.of(request.device_name).product.chassis:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Device: {request.device_name}: a module is calibrated")


def _unknown(code: int, field: str) -> DeviceHandler:
    def refuse(device: DeviceState, request: Any) -> None:
        raise DaqStatusError(code, f"{getattr(request, field)!r} is not saved on this system")

    return refuse


CALIBRATION_CALLS: dict[str, DeviceHandler] = {
    "SelfCal": _of_card,
    "RestoreLastExtCalConst": _of_card,
    **{call: _info(call) for call in CALLS if call.startswith("GetCalInfoAttribute")},
    **{
        call: _unknown(code, field)
        for kind, code, field in (
            ("Chan", status.NO_SUCH_GLOBAL_CHANNEL, "channel"),
            ("Scale", status.NO_SUCH_SCALE, "scale_name"),
            ("Task", status.NO_SAVED_TASK, "task_name"),
        )
        for call in CALLS
        if call.startswith(f"GetPersisted{kind}Attribute")
    },
}
