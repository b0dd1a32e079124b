"""Calls that create virtual channels."""

from __future__ import annotations

from typing import Any, Literal

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask, TaskType
from rig.simulated.driver import add_channels, add_lines
from rig.simulated.product import Kind
from rig.simulated.rpc.messages import enum, refuse_falling_edge
from rig.simulated.signals import NEWTON_IN
from rig.simulated.status import Code, DaqStatusError, NotAnswered, require_one_of

COUNT_UP, COUNT_DOWN = 10128, 10124
Z_PHASES = (10040, 10041, 10042, 10043)
INTERNAL_EXCITATION = 10200
CHAN_FOR_ALL_LINES = 1
DEFAULT, RSE, NRSE, DIFFERENTIAL = -1, 10083, 10078, 10106
BRIDGE_CONFIGURATIONS = (10182, 10187, 10270)
BRIDGE_VALUES = (
    *("min_val", "max_val"),
    *(f"{point}_{side}_val" for point in ("first", "second") for side in ("electrical", "physical")),
)
"""Fields of a bridge's request that are settings of its channel."""


def _refuse_custom_scale(request: Any) -> None:
    if request.custom_scale_name:
        raise NotAnswered(f"custom scale {request.custom_scale_name!r}")


def _refuse_limits(request: Any) -> None:
    if request.min_val >= request.max_val:
        raise DaqStatusError(Code.MIN_NOT_LESS_THAN_MAX, f"{request.min_val:g} to {request.max_val:g}")


def _add_channels(device: DeviceState, task: SimulatedTask, request: Any, type_: TaskType, **settings: Any) -> None:
    """Add the channels that a request names, with these settings; ``kind`` is that of an input not of volts."""
    counter = type_ in ("CI", "CO")
    kind: Kind = "counter" if counter else "voltage_out" if type_ == "AO" else settings.pop("kind", "voltage_in")
    physical = request.counter if counter else request.physical_channel
    add_channels(device, task, type_, kind, physical, request.name_to_assign_to_channel, **settings)


def _set_terminal(
    device: DeviceState, task: SimulatedTask, attribute: int, pin: Literal["source", "auxiliary"]
) -> None:
    channel = task.channels[-1]
    if terminal := device.inventory.counter_terminal(channel.physical, pin):
        task.properties["Chan", channel.name, attribute] = "/" + device.inventory.full_name(terminal)


def add_encoder(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the counter input channel of a quadrature encoder that the ``request`` of NI's CreateCIAngEncoderChan
    describes; refuse values the driver refuses. Nothing is wired to its Z index, so that this never comes."""
    decoding = enum(request, "decoding_type")
    require_one_of(decoding, (daqmx.X1, daqmx.X2, daqmx.X4), "Decoding type")
    require_one_of(enum(request, "units"), (daqmx.DEGREES, daqmx.RADIANS, daqmx.TICKS), "Units")
    require_one_of(enum(request, "zidx_phase") or Z_PHASES[0], Z_PHASES, "Z index phase")
    _refuse_custom_scale(request)
    if request.pulses_per_rev <= 0:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"pulses_per_rev: {request.pulses_per_rev:g}")
    settings = {"pulses_per_rev": request.pulses_per_rev, "initial_angle": request.initial_angle}
    _add_channels(device, task, request, "CI", decoding_type=decoding, units=enum(request, "units"), **settings)
    _set_terminal(device, task, daqmx.CI_ENCODER_A_INPUT_TERM, "source")
    _set_terminal(device, task, daqmx.CI_ENCODER_B_INPUT_TERM, "auxiliary")


def add_edge_count(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the counter input channel that the ``request`` of NI's CreateCICountEdgesChan describes: rising edges on a
    terminal, counted up or down; falling edges are refused as not simulated."""
    direction = enum(request, "count_direction")
    refuse_falling_edge(request, "edge")
    require_one_of(direction, (COUNT_UP, COUNT_DOWN), "Count direction")
    step = 1 if direction == COUNT_UP else -1
    _add_channels(device, task, request, "CI", initial_count=int(request.initial_count), step=step)
    _set_terminal(device, task, daqmx.CI_COUNT_EDGES_TERM, "source")


def add_pulse_train(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the counter output channel that the ``request`` of NI's CreateCOPulseChanFreq describes; frequency and first
    delay are coerced to whole ticks of the timebase. Refuse values out of range, and a high idle state as not
    simulated."""
    require_one_of(enum(request, "units"), (daqmx.HERTZ,), "Units")
    require_one_of(enum(request, "idle_state"), (daqmx.LOW, daqmx.HIGH), "Idle state")
    if enum(request, "idle_state") == daqmx.HIGH:
        raise NotAnswered("pulses from a high idle state")
    timebase = device.inventory.owner_of(request.counter).product.counter_timebase_hz
    has_duty, has_delay = 0 < request.duty_cycle < 1, 0 <= request.initial_delay * timebase < 2**32
    if not (timebase / 2**33 <= request.freq <= timebase / 4 and has_duty and has_delay):
        raise DaqStatusError(
            Code.INVALID_ATTRIBUTE_VALUE,
            f"Frequency {request.freq:g}, duty cycle {request.duty_cycle:g}, initial delay {request.initial_delay:g}",
        )
    coerced = {
        "pulse_hz": timebase / round(timebase / request.freq),
        "delay_s": max(round(request.initial_delay * timebase), 2) / timebase,
    }
    _add_channels(device, task, request, "CO", duty_cycle=request.duty_cycle, **coerced)


def add_force_bridge(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the analog input channels that the ``request`` of NI's CreateAIForceBridgeTwoPointLinChan describes: force on
    the straight line through two points; refuse units, excitation and limits that the product does not have."""
    units, physical = enum(request, "units"), enum(request, "physical_units")
    electrical = enum(request, "electrical_units")
    require_one_of(units, tuple(NEWTON_IN), "Units")
    require_one_of(physical, tuple(NEWTON_IN), "Physical units")
    require_one_of(electrical, (daqmx.VOLTS_PER_VOLT, daqmx.MILLIVOLTS_PER_VOLT), "Electrical units")
    require_one_of(enum(request, "bridge_config"), BRIDGE_CONFIGURATIONS, "Bridge configuration")
    _refuse_custom_scale(request)
    product = device.inventory.owner_of(request.physical_channel).product
    if enum(request, "voltage_excit_source") == INTERNAL_EXCITATION and product.bridge_excitation_v:
        require_one_of(request.voltage_excit_val, product.bridge_excitation_v, "Excitation voltage")
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
    _refuse_limits(request)
    in_units = {"units": units, "physical_units": physical, "electrical_units": electrical}
    points = {name: getattr(request, name) for name in BRIDGE_VALUES}
    _add_channels(device, task, request, "AI", kind="bridge", **in_units, **points)


def add_voltage_input(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the analog input channels that the ``request`` of NI's CreateAIVoltageChan describes; refuse limits beyond
    every input range, other units than volts, and a differential input without a partner."""
    _refuse_limits(request)
    require_one_of(enum(request, "units"), (daqmx.VOLTS,), "Units")
    _refuse_custom_scale(request)
    owner = device.inventory.owner_of(request.physical_channel)
    if owner.product.ai_ranges_v:
        owner.voltage_range(request.min_val, request.max_val)
    before = len(task.channels)
    _add_channels(device, task, request, "AI", min_val=request.min_val, max_val=request.max_val)
    wanted = enum(request, "terminal_config") or DEFAULT
    require_one_of(wanted, (DEFAULT, RSE, NRSE, DIFFERENTIAL), "Terminal configuration")
    for channel in task.channels[before:]:
        paired = int(channel.physical.resource.removeprefix("ai")) in owner.product.differential
        if wanted == DIFFERENTIAL and not paired:
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{channel.physical.name} has no differential input")


def add_voltage_output(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Add the analog output channels that the ``request`` of NI's CreateAOVoltageChan describes; refuse limits beyond
    the product's range and other units than volts."""
    _refuse_limits(request)
    require_one_of(enum(request, "units"), (daqmx.VOLTS,), "Units")
    _refuse_custom_scale(request)
    low_v, high_v = request.min_val, request.max_val
    reach = device.inventory.owner_of(request.physical_channel).product.ao_range_v
    if not -reach <= low_v < high_v <= reach:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Output limits {low_v:g} to {high_v:g} V")
    _add_channels(device, task, request, "AO", min_val=low_v, max_val=high_v)


def add_digital_output(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    one = enum(request, "line_grouping") == CHAN_FOR_ALL_LINES
    add_lines(device, task, request.lines, request.name_to_assign_to_lines, one_channel=one)
