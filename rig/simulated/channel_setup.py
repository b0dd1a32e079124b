"""Calls that create virtual channels: each checks what the product can do before the channel joins the
task."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.attributes import ENCODER_TERMINALS
from rig.simulated.device import SimulatedDevice
from rig.simulated.messages import enum
from rig.simulated.pulses import CO_DELAY, CO_DUTY, CO_FREQ
from rig.simulated.readings import (
    DEGREES,
    EDGES,
    FREQUENCY,
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
SECONDS = 10364
RISING, FALLING = 10280, 10171
COUNT_UP, COUNT_DOWN = 10128, 10124
CHAN_FOR_ALL_LINES = 1
PULSE_FREQUENCY, PULSE_TIME, PULSE_TICKS = 10119, 10269, 10268
LOW = 10214
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
        units=units, physical_units=physical, electrical_units=electrical, min_val=request.min_val,
        max_val=request.max_val,
        first_electrical_val=e0, second_electrical_val=e1, first_physical_val=p0, second_physical_val=p1,
    )  # fmt: skip


def ai_voltage(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """AI voltage within one of the device's ranges."""
    _one_of(enum(request, "units"), (VOLTS,), "Units")
    if device.inventory.product.ai_ranges_v:
        device.inventory.voltage_range(request.min_val, request.max_val)
    device.add_channels(
        task, "AI", "voltage_in", request.physical_channel, request.name_to_assign_to_channel,
        min_val=request.min_val, max_val=request.max_val, terminal_config=enum(request, "terminal_config"),
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
    _refuse_high_idle(request)
    device.add_channels(
        task, "CO", "counter", request.counter, request.name_to_assign_to_channel,
        output_type=PULSE_FREQUENCY, idle_state=LOW,
    )  # fmt: skip
    name = task.channels[-1].name
    task.attributes["Chan", name, CO_FREQ] = timebase / round(timebase / request.freq)
    task.attributes["Chan", name, CO_DUTY] = request.duty_cycle
    task.attributes["Chan", name, CO_DELAY] = max(round(request.initial_delay * timebase), 2) / timebase


def _refuse_high_idle(request: Any) -> None:
    if enum(request, "idle_state") != LOW:
        raise NotImplementedByDevice("pulses from a high idle state")


def co_pulse_time(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CO pulses by their high and low times, s."""
    _one_of(enum(request, "units"), (SECONDS,), "Units")
    if not (request.high_time > 0 and request.low_time > 0 and request.initial_delay >= 0):
        raise DaqStatusError(status.INVALID_VALUE, f"High {request.high_time:g} s, low {request.low_time:g} s")
    _add_pulses(device, task, request, request.initial_delay, request.high_time, request.low_time, PULSE_TIME)


def co_pulse_ticks(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CO pulses by ticks of a timebase of the device."""
    source = device.inventory.terminal(request.source_terminal)
    match = re.fullmatch(r"(\d+)([Mk])HzTimebase", source)
    if match is None:
        raise NotImplementedByDevice(f"ticks of {request.source_terminal}")
    tick_s = 1 / (float(match[1]) * {"M": 1e6, "k": 1e3}[match[2]])
    if request.high_ticks < 2 or request.low_ticks < 2 or request.initial_delay < 0:
        raise DaqStatusError(status.INVALID_VALUE, f"High {request.high_ticks}, low {request.low_ticks} ticks")
    delay, high, low = request.initial_delay * tick_s, request.high_ticks * tick_s, request.low_ticks * tick_s
    _add_pulses(device, task, request, delay, high, low, PULSE_TICKS)


def _add_pulses(
    device: SimulatedDevice,
    task: SimulatedTask,
    request: Any,
    delay_s: float,
    high_s: float,
    low_s: float,
    output_type: int,
) -> None:
    timebase = device.inventory.product.counter_timebase_hz
    _refuse_high_idle(request)
    device.add_channels(
        task, "CO", "counter", request.counter, request.name_to_assign_to_channel,
        output_type=output_type, idle_state=LOW,
    )  # fmt: skip
    name = task.channels[-1].name
    high, low = (max(round(part * timebase), 2) / timebase for part in (high_s, low_s))
    task.attributes["Chan", name, CO_FREQ] = 1 / (high + low)
    task.attributes["Chan", name, CO_DUTY] = high / (high + low)
    task.attributes["Chan", name, CO_DELAY] = max(round(delay_s * timebase), 2) / timebase


def ci_count_edges(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CI counting edges on a terminal, up or down."""
    _one_of(enum(request, "edge"), (RISING, FALLING), "Edge")
    _one_of(enum(request, "count_direction"), (COUNT_UP, COUNT_DOWN), "Count direction")
    step = 1 if enum(request, "count_direction") == COUNT_UP else -1
    device.add_channels(
        task, "CI", "counter", request.counter, request.name_to_assign_to_channel,
        measures=EDGES, initial_count=int(request.initial_count), step=step, edge=enum(request, "edge"),
        count_direction=enum(request, "count_direction"),
    )  # fmt: skip


def ci_frequency(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """CI measuring a frequency on a terminal."""
    _one_of(enum(request, "units"), (HERTZ,), "Units")
    if not 0 < request.min_val < request.max_val:
        raise DaqStatusError(status.INVALID_VALUE, f"Limits {request.min_val:g} to {request.max_val:g} Hz")
    device.add_channels(task, "CI", "counter", request.counter, request.name_to_assign_to_channel, measures=FREQUENCY)


def do_lines(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """DO on lines or ports."""
    one = enum(request, "line_grouping") == CHAN_FOR_ALL_LINES
    device.add_lines(task, "DO", request.lines, request.name_to_assign_to_lines, one_channel=one)


def di_lines(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    """DI on lines or ports."""
    one = enum(request, "line_grouping") == CHAN_FOR_ALL_LINES
    device.add_lines(task, "DI", request.lines, request.name_to_assign_to_lines, one_channel=one)


CHANNEL_CALLS: dict[str, Callable[[SimulatedDevice, SimulatedTask, Any], None]] = {
    "CreateAIForceBridgeTwoPointLinChan": force_bridge_two_point,
    "CreateAIVoltageChan": ai_voltage,
    "CreateCIAngEncoderChan": ci_angular_encoder,
    "CreateAOVoltageChan": ao_voltage,
    "CreateCOPulseChanFreq": co_pulse_frequency,
    "CreateCOPulseChanTime": co_pulse_time,
    "CreateCOPulseChanTicks": co_pulse_ticks,
    "CreateCICountEdgesChan": ci_count_edges,
    "CreateCIFreqChan": ci_frequency,
    "CreateDOChan": do_lines,
    "CreateDIChan": di_lines,
}
