"""Calls about physical channels: what kind of input they can be; others are refused, an unknown channel by its code."""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.product.inventory import PhysicalChannel
from rig.simulated.rpc.handlers import DeviceHandler, Fields
from rig.simulated.rpc.messages import CALLS, attribute_fields, enum, property_number
from rig.simulated.status import DaqStatusError

RSE, NRSE, DIFFERENTIAL = 1, 2, 4
"""Bits of the terminal configurations an input can have."""
TERMINALS = property_number("PhysicalChannel", "PHYSICAL_CHAN_AI_TERM_CFGS")
CHANGE_DETECTION = property_number("PhysicalChannel", "PHYSICAL_CHAN_DI_CHANGE_DETECT_SUPPORTED")


def _find(device: DeviceState, name: str) -> PhysicalChannel:
    for kind in ("voltage_in", "bridge", "voltage_out", "counter", "line", "static_line"):
        try:
            return device.inventory.channel(name, kind)
        except DaqStatusError as refused:
            if refused.code not in (status.WRONG_MEASUREMENT_TYPE, status.WRONG_OUTPUT_TYPE):
                raise DaqStatusError(status.NO_SUCH_CHANNEL, f"Physical Channel: {name}") from None
    raise DaqStatusError(status.NO_SUCH_CHANNEL, f"Physical Channel: {name}")


def _value(device: DeviceState, channel: PhysicalChannel, number: int) -> int | bool | None:
    product = device.inventory.of(channel.name).product
    if number == TERMINALS and channel.kind == "voltage_in":
        paired = int(channel.resource.removeprefix("ai")) in product.differential
        return RSE | NRSE | (DIFFERENTIAL if paired else 0)
    if number == CHANGE_DETECTION and channel.kind in ("line", "static_line"):
        return product.change_detection and channel.kind == "line"
    return None


def _get(call: str) -> DeviceHandler:
    def get(device: DeviceState, request: Any) -> Fields:
        channel, number = _find(device, request.physical_channel), enum(request, "attribute")
        value = _value(device, channel, number)
        if value is None:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} of {channel.name}")
        return attribute_fields(call, value)

    return get


PHYSICAL_CHANNEL_CALLS: dict[str, DeviceHandler] = {
    call: _get(call) for call in CALLS if call.startswith("GetPhysicalChanAttribute")
}
