"""The call that creates a thermocouple input; its scale is in :mod:`rig.simulated.device.thermocouples`."""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.thermocouples import PER_CELSIUS, E, J, K, T, ThermocoupleScale
from rig.simulated.driver.configuration import add_channels
from rig.simulated.rpc.messages import enum
from rig.simulated.status import DaqStatusError, NotImplementedByDevice, one_of

BUILT_IN, CONSTANT = 10200, 10116
THERMOCOUPLE = 10303
MOST_V = 0.1
"""No thermocouple gives more."""


def ai_thermocouple(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI temperature of a thermocouple, the cold junction at a constant temperature, deg C."""
    if request.min_val >= request.max_val:
        raise DaqStatusError(status.MIN_NOT_LESS_THAN_MAX, f"{request.min_val:g} to {request.max_val:g}")
    units, kind, source = (enum(request, field) for field in ("units", "thermocouple_type", "cjc_source"))
    one_of(units, tuple(PER_CELSIUS), "Units")
    if source == BUILT_IN:
        raise DaqStatusError(status.BUILT_IN_COLD_JUNCTION, request.physical_channel)
    if source != CONSTANT or kind not in (J, K, T, E):
        raise NotImplementedByDevice(f"thermocouple of type {kind} with cold junction {source}")
    scale = ThermocoupleScale(kind, request.cjc_val, units)
    add_channels(
        device, task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
        min_val=-MOST_V, max_val=MOST_V, type=THERMOCOUPLE, scale=scale, units=units,
        thermocouple_type=kind, cjc_source=source, cjc_val=request.cjc_val,
    )  # fmt: skip
