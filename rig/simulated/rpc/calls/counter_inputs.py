"""Calls that create counter inputs: encoders, counts of edges, and what can be measured of the pulses on a terminal.

Each measurement has a default terminal per counter (:class:`rig.simulated.product.capabilities.CounterPins`); where
the product has none the client must set the terminal.
"""

from __future__ import annotations

import re
from typing import Any, Literal

from rig.simulated import daqmx, status
from rig.simulated.device.scales import scale_of
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver.configuration import add_channels
from rig.simulated.rpc.handlers import TaskHandler
from rig.simulated.rpc.messages import enum
from rig.simulated.status import DaqStatusError, one_of

METERS, INCHES = 10219, 10379
COUNT_UP, COUNT_DOWN = 10128, 10124
LOW_FREQUENCY, HIGH_FREQUENCY, LARGE_RANGE, DYNAMIC = 10105, 10157, 10205, 16065
LINEAR_ENCODER = 10361
Z_PHASES = (10040, 10041, 10042, 10043)
TWO_PULSES = 10313
SEMI_PERIOD, TWO_EDGES = 10289, 10267
TWO_COUNTERS = (HIGH_FREQUENCY, LARGE_RANGE)


def _index(request: Any) -> dict[str, Any]:
    """Return the settings of the Z index; nothing is wired to it on the virtual bench, so that it never comes."""
    phase = enum(request, "zidx_phase") or Z_PHASES[0]
    one_of(phase, Z_PHASES, "Z index phase")
    return {"zidx_enable": bool(request.zidx_enable), "zidx_val": float(request.zidx_val), "zidx_phase": phase}


def _decoding(request: Any) -> int:
    decoding = enum(request, "decoding_type")
    one_of(decoding, (daqmx.X1, daqmx.X2, daqmx.X4, TWO_PULSES), "Decoding type")
    return decoding


def _scaling(device: DeviceState, request: Any, units: tuple[int, ...]) -> tuple[int, dict[str, Any]]:
    """Return the units a counter measures in, and the custom scale that takes it from there, if one is asked for."""
    asked = enum(request, "units")
    one_of(asked, (*units, daqmx.FROM_CUSTOM_SCALE), "Units")
    if asked != daqmx.FROM_CUSTOM_SCALE:
        if request.custom_scale_name:
            raise DaqStatusError(status.UNITS_NOT_SCALED, f"Scale: {request.custom_scale_name}")
        return asked, {}
    scale = scale_of(device.scales, request.custom_scale_name, units)
    return scale.prescaled_units, {"scale": scale}


def ci_angular_encoder(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CI on a quadrature encoder."""
    decoding = _decoding(request)
    units, scaling = _scaling(device, request, (daqmx.DEGREES, daqmx.RADIANS, daqmx.TICKS))
    if request.pulses_per_rev < 1:
        raise DaqStatusError(status.INVALID_VALUE, f"Pulses per revolution: {request.pulses_per_rev}")
    add_channels(
        device, task, "CI", "counter", request.counter, request.name_to_assign_to_channel,
        decoding_type=decoding, units=units, pulses_per_rev=request.pulses_per_rev,
        initial_angle=request.initial_angle, **_index(request), **scaling,
    )  # fmt: skip
    _set_encoder_terminals(device, task)


def ci_linear_encoder(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CI on a quadrature encoder of a length."""
    decoding = _decoding(request)
    units, scaling = _scaling(device, request, (METERS, INCHES, daqmx.TICKS))
    if not 0 < request.dist_per_pulse < float("inf"):
        raise DaqStatusError(status.INVALID_VALUE, f"Distance per pulse: {request.dist_per_pulse:g}")
    add_channels(
        device, task, "CI", "counter", request.counter, request.name_to_assign_to_channel,
        decoding_type=decoding, units=units, dist_per_pulse=request.dist_per_pulse, initial_pos=request.initial_pos,
        type=LINEAR_ENCODER, **_index(request), **scaling,
    )  # fmt: skip
    _set_encoder_terminals(device, task)


def _set_encoder_terminals(device: DeviceState, task: SimulatedTask) -> None:
    if task.channels[-1].settings["decoding_type"] == TWO_PULSES:
        task.unsimulated["decoding"] = "two pulses"
    _set_terminal(device, task, daqmx.CI_ENCODER_A_INPUT_TERM, "source")
    _set_terminal(device, task, daqmx.CI_ENCODER_B_INPUT_TERM, "auxiliary")
    _set_terminal(device, task, daqmx.CI_ENCODER_Z_INPUT_TERM, "gate")


def _set_terminal(
    device: DeviceState, task: SimulatedTask, attribute: int, pin: Literal["source", "gate", "auxiliary"]
) -> None:
    """Give the last channel of a task its default terminal, where it has one."""
    channel = task.channels[-1]
    if terminal := device.inventory.counter_terminal(channel.physical, pin):
        task.properties["Chan", channel.name, attribute] = "/" + device.inventory.full_name(terminal)


def ci_count_edges(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CI counting edges on a terminal, up or down."""
    one_of(enum(request, "edge"), (daqmx.RISING, daqmx.FALLING), "Edge")
    one_of(enum(request, "count_direction"), (COUNT_UP, COUNT_DOWN), "Count direction")
    step = 1 if enum(request, "count_direction") == COUNT_UP else -1
    add_channels(
        device, task, "CI", "counter", request.counter, request.name_to_assign_to_channel,
        measures=daqmx.EDGES, initial_count=int(request.initial_count), step=step, edge=enum(request, "edge"),
        count_direction=enum(request, "count_direction"),
    )  # fmt: skip
    _set_terminal(device, task, daqmx.CI_TERM[daqmx.EDGES], "source")


def _of_pulses(measures: str, *units: int) -> TaskHandler:
    """Return the creator of a channel that measures the pulses on a terminal in one of these units."""

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        names = request.DESCRIPTOR.fields_by_name
        scaling: dict[str, Any] = {}
        if "custom_scale_name" in names:
            unit, scaling = _scaling(device, request, units)
        else:
            unit = enum(request, "units") if "units" in names else daqmx.TICKS
            one_of(unit, units, "Units")
        least, most = request.min_val, request.max_val
        if scaling:
            least, most = sorted(float(one) for one in scaling["scale"].prescaled([least, most]))
        if not 0 < least < most:
            detail = f"Limits {request.min_val:g} to {request.max_val:g}"
            raise DaqStatusError(status.MIN_NOT_LESS_THAN_MAX, detail)
        settings: dict[str, Any] = {"units": unit, "min_val": least, "max_val": most, **scaling}
        for edge in ("edge", "starting_edge"):
            if edge in names:
                one_of(enum(request, edge), (daqmx.RISING, daqmx.FALLING), "Edge")
                settings["edge"] = enum(request, edge)
        if "source_terminal" in names and request.source_terminal not in ("", "OnboardClock"):
            terminal = device.inventory.terminal(request.source_terminal)
            settings["timebase_src"] = "/" + device.inventory.full_name(terminal)
            if not re.fullmatch(r"\d+[Mk]HzTimebase", device.inventory.own_name(terminal)):
                task.unsimulated["counter timebase"] = request.source_terminal
        pin: Literal["source", "gate"] = "gate"
        if "meas_method" in names:
            method = enum(request, "meas_method")
            one_of(method, (LOW_FREQUENCY, *TWO_COUNTERS, DYNAMIC), "Measurement method")
            settings |= {"method": method, "meas_time": request.meas_time, "divisor": int(request.divisor)}
            if method in TWO_COUNTERS:
                settings["two_counters"], pin = True, "source"
        add_channels(
            device,
            task,
            "CI",
            "counter",
            request.counter,
            request.name_to_assign_to_channel,
            measures=measures,
            **settings,
        )  # fmt: skip
        _set_terminal(device, task, daqmx.CI_TERM[measures], pin)

    return create


def _unsimulated_measurement(kind: int, what: str) -> TaskHandler:
    """A measurement that the product has and the virtual bench does not: the channel is made, its task is refused."""

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        one_of(enum(request, "units"), (daqmx.SECONDS, daqmx.TICKS), "Units")
        if not 0 < request.min_val < request.max_val:
            raise DaqStatusError(status.MIN_NOT_LESS_THAN_MAX, f"Limits {request.min_val:g} to {request.max_val:g}")
        settings: dict[str, Any] = {"units": enum(request, "units"), "type": kind}
        settings |= {"min_val": request.min_val, "max_val": request.max_val}
        if kind == TWO_EDGES:
            for edge in ("first_edge", "second_edge"):
                one_of(enum(request, edge), (daqmx.RISING, daqmx.FALLING), "Edge")
                settings[edge] = enum(request, edge)
        name = request.name_to_assign_to_channel
        add_channels(device, task, "CI", "counter", request.counter, name, **settings)
        task.unsimulated["measurement"] = what

    return create


COUNTER_INPUT_CALLS: dict[str, TaskHandler] = {
    "CreateCIAngEncoderChan": ci_angular_encoder,
    "CreateCILinEncoderChan": ci_linear_encoder,
    "CreateCICountEdgesChan": ci_count_edges,
    "CreateCIFreqChan": _of_pulses(daqmx.FREQUENCY, daqmx.HERTZ, daqmx.TICKS),
    "CreateCIPeriodChan": _of_pulses(daqmx.PERIOD, daqmx.SECONDS, daqmx.TICKS),
    "CreateCIPulseWidthChan": _of_pulses(daqmx.WIDTH, daqmx.SECONDS, daqmx.TICKS),
    "CreateCISemiPeriodChan": _unsimulated_measurement(SEMI_PERIOD, "semi-period"),
    "CreateCITwoEdgeSepChan": _unsimulated_measurement(TWO_EDGES, "two-edge separation"),
    "CreateCIPulseChanFreq": _of_pulses(daqmx.PULSE_FREQUENCY, daqmx.HERTZ),
    "CreateCIPulseChanTime": _of_pulses(daqmx.PULSE_TIME, daqmx.SECONDS),
    "CreateCIPulseChanTicks": _of_pulses(daqmx.PULSE_TICKS, daqmx.TICKS),
}
