"""Calls that create virtual channels: each checks what the product can do before the channel joins the
task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.attributes import ENCODER_TERMINALS
from rig.simulated.device import CO_DELAY, CO_FREQ, SimulatedDevice
from rig.simulated.messages import enum
from rig.simulated.readings import (
    DEGREES,
    MILLIVOLTS_PER_VOLT,
    NEWTON_IN,
    RADIANS,
    TICKS,
    VOLTS_PER_VOLT,
    X1,
    X2,
    X4,
)
from rig.simulated.status import DaqStatusError, NotImplementedByDevice
from rig.simulated.tasks import SimulatedTask

INTERNAL_EXCITATION = 10200
VOLTS, HERTZ = 10348, 10373
BRIDGE_CONFIGURATIONS = (10182, 10187, 10270)


def _one_of(value: int | float, allowed: tuple[int | float, ...], what: str) -> None:
    if value not in allowed:
        raise DaqStatusError(status.INVALID_VALUE, f"{what}: {value}, allowed {', '.join(map(str, allowed))}")


def force_bridge_two_point(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """AI force, bridge, straight line through two points."""
    units, physical = enum(request, "units"), enum(request, "physical_units")
    electrical = enum(request, "electrical_units")
    _one_of(units, tuple(NEWTON_IN), "Units")
    _one_of(physical, tuple(NEWTON_IN), "Physical units")
    _one_of(electrical, (VOLTS_PER_VOLT, MILLIVOLTS_PER_VOLT), "Electrical units")
    _one_of(enum(request, "bridge_config"), BRIDGE_CONFIGURATIONS, "Bridge configuration")
    product = device.inventory.product
    if enum(request, "voltage_excit_source") == INTERNAL_EXCITATION and product.bridge_excitation_v:
        _one_of(request.voltage_excit_val, product.bridge_excitation_v, "Excitation voltage")
    e0, e1 = request.first_electrical_val, request.second_electrical_val
    p0, p1 = request.first_physical_val, request.second_physical_val
    if e0 == e1 or p0 == p1:
        raise DaqStatusError(status.INVALID_VALUE, "Two-point scaling with equal points")
    scale = NEWTON_IN[units] / NEWTON_IN[physical]
    per_mv = 1e-3 if electrical == VOLTS_PER_VOLT else 1.0
    for limit in (request.min_val, request.max_val):
        reading = (e0 + (limit * scale - p0) * (e1 - e0) / (p1 - p0)) / per_mv
        if product.bridge_range_mv_per_v and abs(reading) > product.bridge_range_mv_per_v * (1 + 1e-9):
            raise DaqStatusError(status.INVALID_VALUE, f"Limit {limit:g} needs {reading:.4g} mV/V of the input")
    if not request.min_val < request.max_val:
        raise DaqStatusError(status.INVALID_VALUE, "Minimum not below maximum")
    device.add_channels(
        task, "AI", "bridge", request.physical_channel, request.name_to_assign_to_channel,
        units=units, physical_units=physical, electrical_units=electrical,
        first_electrical_val=e0, second_electrical_val=e1, first_physical_val=p0, second_physical_val=p1,
    )  # fmt: skip


def ai_voltage(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """AI voltage within one of the device's ranges."""
    _one_of(enum(request, "units"), (VOLTS,), "Units")
    if device.inventory.product.ai_ranges_v:
        device.inventory.voltage_range(request.min_val, request.max_val)
    device.add_channels(
        task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
        min_val=request.min_val, max_val=request.max_val,
    )  # fmt: skip


def ci_angular_encoder(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CI on a quadrature encoder."""
    if request.zidx_enable:
        raise NotImplementedByDevice("Z index of an encoder")
    decoding, units = enum(request, "decoding_type"), enum(request, "units")
    _one_of(decoding, (X1, X2, X4), "Decoding type")
    _one_of(units, (DEGREES, RADIANS, TICKS), "Units")
    if request.pulses_per_rev < 1:
        raise DaqStatusError(status.INVALID_VALUE, f"Pulses per revolution: {request.pulses_per_rev}")
    device.add_channels(
        task, "CI", "counter", request.counter, request.name_to_assign_to_channel,
        decoding_type=decoding, units=units, pulses_per_rev=request.pulses_per_rev,
        initial_angle=request.initial_angle,
    )  # fmt: skip
    if device.inventory.product.encoder_terminals:
        channel = task.channels[-1]
        pair = device.inventory.product.encoder_terminals[int(channel.physical.resource.removeprefix("ctr"))]
        for attribute, terminal in zip(ENCODER_TERMINALS, pair, strict=True):
            task.attributes["Chan", channel.name, attribute] = "/" + device.inventory.full_name(terminal)


def ao_voltage(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """AO voltage within the device's range."""
    _one_of(enum(request, "units"), (VOLTS,), "Units")
    reach = device.inventory.product.ao_range_v
    if not -reach <= request.min_val < request.max_val <= reach:
        raise DaqStatusError(status.INVALID_VALUE, f"Output limits {request.min_val:g} to {request.max_val:g} V")
    device.add_channels(
        task, "AO", "voltage_out", request.physical_channel, request.name_to_assign_to_channel,
        min_val=request.min_val, max_val=request.max_val,
    )  # fmt: skip


def co_pulse_frequency(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CO pulse train: frequency and delay are coerced to whole ticks of the counter's timebase."""
    _one_of(enum(request, "units"), (HERTZ,), "Units")
    timebase = device.inventory.product.counter_timebase_hz
    if not (0 < request.freq <= timebase / 4 and 0 < request.duty_cycle < 1 and request.initial_delay >= 0):
        raise DaqStatusError(
            status.INVALID_VALUE,
            f"Frequency {request.freq:g}, duty cycle {request.duty_cycle:g}, initial delay {request.initial_delay:g}",
        )
    device.add_channels(task, "CO", "counter", request.counter, request.name_to_assign_to_channel)
    name = task.channels[-1].name
    task.attributes["Chan", name, CO_FREQ] = timebase / round(timebase / request.freq)
    task.attributes["Chan", name, CO_DELAY] = max(round(request.initial_delay * timebase), 2) / timebase


def do_lines(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """DO on single lines."""
    device.add_channels(task, "DO", "line", request.lines, request.name_to_assign_to_lines)


CHANNEL_CALLS: dict[str, Callable[[SimulatedDevice, SimulatedTask, Any], None]] = {
    "CreateAIForceBridgeTwoPointLinChan": force_bridge_two_point,
    "CreateAIVoltageChan": ai_voltage,
    "CreateCIAngEncoderChan": ci_angular_encoder,
    "CreateAOVoltageChan": ao_voltage,
    "CreateCOPulseChanFreq": co_pulse_frequency,
    "CreateDOChan": do_lines,
}
