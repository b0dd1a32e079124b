"""Calls that create virtual channels: each checks what the product can do before the channel joins the task."""

from __future__ import annotations

from typing import Any, Literal

from rig.simulated import daqmx
from rig.simulated.device.scales import PER_CELSIUS, E, J, K, T, ThermocoupleScale, scale_of
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver import add_channels, add_lines
from rig.simulated.rpc.calls.counters import COUNTER_INPUT_CALLS, COUNTER_OUTPUT_CALLS
from rig.simulated.rpc.messages import TaskHandler, enum
from rig.simulated.signals import NEWTON_IN
from rig.simulated.status import Code, DaqStatusError, NotImplementedByDevice, one_of

BUILT_IN, CONSTANT = 10200, 10116
THERMOCOUPLE = 10303
MOST_V = 0.1
"""No thermocouple gives more."""


def ai_thermocouple(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI temperature of a thermocouple, the cold junction at a constant temperature, deg C."""
    if request.min_val >= request.max_val:
        raise DaqStatusError(Code.MIN_NOT_LESS_THAN_MAX, f"{request.min_val:g} to {request.max_val:g}")
    units, kind, source = (enum(request, field) for field in ("units", "thermocouple_type", "cjc_source"))
    one_of(units, tuple(PER_CELSIUS), "Units")
    if source == BUILT_IN:
        raise DaqStatusError(Code.BUILT_IN_CJC_SRC_NOT_SUPPORTED, request.physical_channel)
    if source != CONSTANT or kind not in (J, K, T, E):
        raise NotImplementedByDevice(f"thermocouple of type {kind} with cold junction {source}")
    scale = ThermocoupleScale(kind, request.cjc_val, units)
    add_channels(
        device, task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
        min_val=-MOST_V, max_val=MOST_V, type=THERMOCOUPLE, scale=scale, units=units,
        thermocouple_type=kind, cjc_source=source, cjc_val=request.cjc_val,
    )  # fmt: skip


INTERNAL_EXCITATION = 10200
RTD, VOLTAGE_WITH_EXCITATION = 10301, 10323
VOLTS_OF_SENSOR = 10.0
CHAN_FOR_ALL_LINES = 1
DEFAULT, RSE, NRSE, DIFFERENTIAL = -1, 10083, 10078, 10106
BRIDGE_CONFIGURATIONS = (10182, 10187, 10270)


def force_bridge_two_point(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI force, bridge, straight line through two points."""
    units, physical = enum(request, "units"), enum(request, "physical_units")
    electrical = enum(request, "electrical_units")
    one_of(units, tuple(NEWTON_IN), "Units")
    one_of(physical, tuple(NEWTON_IN), "Physical units")
    one_of(electrical, (daqmx.VOLTS_PER_VOLT, daqmx.MILLIVOLTS_PER_VOLT), "Electrical units")
    one_of(enum(request, "bridge_config"), BRIDGE_CONFIGURATIONS, "Bridge configuration")
    product = device.inventory.of(request.physical_channel).product
    if enum(request, "voltage_excit_source") == INTERNAL_EXCITATION and product.bridge_excitation_v:
        one_of(request.voltage_excit_val, product.bridge_excitation_v, "Excitation voltage")
    e0, e1 = request.first_electrical_val, request.second_electrical_val
    p0, p1 = request.first_physical_val, request.second_physical_val
    if e0 == e1 or p0 == p1:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, "Two-point scaling with equal points")
    scale = NEWTON_IN[units] / NEWTON_IN[physical]
    per_mv = 1e-3 if electrical == daqmx.VOLTS_PER_VOLT else 1.0
    for limit in (request.min_val, request.max_val):
        reading = (e0 + (limit * scale - p0) * (e1 - e0) / (p1 - p0)) / per_mv
        if product.bridge_range_mv_per_v and abs(reading) > product.bridge_range_mv_per_v * (1 + 1e-9):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Limit {limit:g} needs {reading:.4g} mV/V of the input")
    _increasing(request)
    add_channels(
        device, task, "AI", "bridge", request.physical_channel, request.name_to_assign_to_channel,
        units=units, physical_units=physical, electrical_units=electrical, min_val=request.min_val,
        max_val=request.max_val,
        first_electrical_val=e0, second_electrical_val=e1, first_physical_val=p0, second_physical_val=p1,
    )  # fmt: skip


def _increasing(request: Any) -> None:
    if request.min_val >= request.max_val:
        raise DaqStatusError(Code.MIN_NOT_LESS_THAN_MAX, f"{request.min_val:g} to {request.max_val:g}")


def _scaling(device: DeviceState, request: Any) -> tuple[dict[str, Any], float, float]:
    """Return the settings of a custom scale, if one is asked for, and the limits of the channel, V."""
    units = enum(request, "units")
    one_of(units, (daqmx.VOLTS, daqmx.FROM_CUSTOM_SCALE), "Units")
    if units == daqmx.VOLTS:
        if request.custom_scale_name:
            raise DaqStatusError(Code.UNITS_NOT_FROM_CUSTOM_SCALE, f"Scale: {request.custom_scale_name}")
        return {}, request.min_val, request.max_val
    scale = scale_of(device.scales, request.custom_scale_name, (daqmx.VOLTS,))
    low_v, high_v = sorted(float(v) for v in scale.prescaled([request.min_val, request.max_val]))
    return {"units": units, "scale": scale}, low_v, high_v


def ai_voltage(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI voltage within one of the device's ranges."""
    _increasing(request)
    scaling, low_v, high_v = _scaling(device, request)
    owner = device.inventory.of(request.physical_channel)
    if owner.product.ai_ranges_v:
        owner.voltage_range(low_v, high_v)
    before = len(task.channels)
    add_channels(
        device, task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
        min_val=low_v, max_val=high_v, **scaling,
    )  # fmt: skip
    wanted = enum(request, "terminal_config") or DEFAULT
    one_of(wanted, (DEFAULT, RSE, NRSE, DIFFERENTIAL), "Terminal configuration")
    for channel in task.channels[before:]:
        paired = int(channel.physical.resource.removeprefix("ai")) in owner.product.differential
        if wanted == DIFFERENTIAL and not paired:
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{channel.physical.name} has no differential input")
        channel.settings["terminal_config"] = (DIFFERENTIAL if paired else RSE) if wanted == DEFAULT else wanted


def ai_sensor(kind: int, what: str) -> TaskHandler:
    """A voltage input with a sensor that the virtual bench does not have: the channel is made, its task is refused."""

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        _increasing(request)
        add_channels(
            device, task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
            min_val=-VOLTS_OF_SENSOR, max_val=VOLTS_OF_SENSOR, type=kind,
        )  # fmt: skip
        task.unsimulated["measurement"] = what

    return create


def ao_voltage(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AO voltage within the device's range."""
    _increasing(request)
    scaling, low_v, high_v = _scaling(device, request)
    reach = device.inventory.of(request.physical_channel).product.ao_range_v
    if not -reach <= low_v < high_v <= reach:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Output limits {low_v:g} to {high_v:g} V")
    add_channels(
        device, task, "AO", "voltage_out", request.physical_channel, request.name_to_assign_to_channel,
        min_val=low_v, max_val=high_v, **scaling,
    )  # fmt: skip


def digital_lines(type_: Literal["DI", "DO"]) -> TaskHandler:
    """DI or DO on lines or ports."""

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        one = enum(request, "line_grouping") == CHAN_FOR_ALL_LINES
        add_lines(device, task, type_, request.lines, request.name_to_assign_to_lines, one_channel=one)

    return create


CHANNEL_CALLS: dict[str, TaskHandler] = {
    "CreateAIForceBridgeTwoPointLinChan": force_bridge_two_point,
    "CreateAIVoltageChan": ai_voltage,
    "CreateAIThrmcplChan": ai_thermocouple,
    "CreateAIVoltageChanWithExcit": ai_sensor(VOLTAGE_WITH_EXCITATION, "voltage with excitation"),
    "CreateAIRTDChan": ai_sensor(RTD, "resistance thermometer"),
    "CreateAOVoltageChan": ao_voltage,
    "CreateDOChan": digital_lines("DO"),
    "CreateDIChan": digital_lines("DI"),
    **COUNTER_INPUT_CALLS,
    **COUNTER_OUTPUT_CALLS,
}
