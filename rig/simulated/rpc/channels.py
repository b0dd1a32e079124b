"""Calls that create virtual channels, and those that write pulses.

Each checks what the product can do before the channel joins the task. Counter inputs are encoders, counts of edges, and
what can be measured of the pulses on a terminal. Each measurement has a default terminal per counter
(:class:`rig.simulated.product.CounterPins`); where the product has none the client must set the terminal. Frequencies,
times and delays of outputs are coerced to whole ticks of the counter's timebase. Written pulses take over from the next
pulse on; a buffer of them, one sample a pulse, may vary the duty cycle but not the frequency.
"""

from __future__ import annotations

import re
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.scales import PER_CELSIUS, E, J, K, T, ThermocoupleScale, scale_of
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask, TaskType
from rig.simulated.driver import add_channels, add_lines, start_task
from rig.simulated.product import Kind
from rig.simulated.rpc.data import refuse_other_type
from rig.simulated.rpc.messages import Fields, TaskHandler, enum
from rig.simulated.rpc.properties import note_edge
from rig.simulated.signals import NEWTON_IN, pulse_train
from rig.simulated.status import UNSUPPORTED, Code, DaqStatusError, NotImplementedByDevice, one_of, refuse_any

METERS, INCHES = 10219, 10379
COUNT_UP, COUNT_DOWN = 10128, 10124
LOW_FREQUENCY, HIGH_FREQUENCY, LARGE_RANGE, DYNAMIC = 10105, 10157, 10205, 16065
LINEAR_ENCODER = 10361
Z_PHASES = (10040, 10041, 10042, 10043)
TWO_PULSES = 10313
SEMI_PERIOD, TWO_EDGES = 10289, 10267
TWO_COUNTERS = (HIGH_FREQUENCY, LARGE_RANGE)


def _scaling(device: DeviceState, request: Any, units: tuple[int, ...]) -> tuple[int, dict[str, Any]]:
    """Return the units a channel measures in, and the custom scale that takes it from there, if one is asked for."""
    asked = enum(request, "units")
    one_of(asked, (*units, daqmx.FROM_CUSTOM_SCALE), "Units")
    if asked != daqmx.FROM_CUSTOM_SCALE:
        if request.custom_scale_name:
            raise DaqStatusError(Code.UNITS_NOT_FROM_CUSTOM_SCALE, f"Scale: {request.custom_scale_name}")
        return asked, {}
    scale = scale_of(device.scales, request.custom_scale_name, units)
    return scale.prescaled_units, {"scale": scale}


def _limits(request: Any, scaling: dict[str, Any]) -> list[float]:
    """Return the least and the largest value expected, as they are before a custom scale."""
    limits = [request.min_val, request.max_val]
    return sorted(float(v) for v in scaling["scale"].prescaled(limits)) if scaling else limits


def _increasing(request: Any) -> None:
    if request.min_val >= request.max_val:
        raise DaqStatusError(Code.MIN_NOT_LESS_THAN_MAX, f"{request.min_val:g} to {request.max_val:g}")


def _add(device: DeviceState, task: SimulatedTask, request: Any, type_: TaskType, **settings: Any) -> None:
    """Add the channels that a request names, with these settings; ``kind`` is that of an input not of volts."""
    counter = type_ in ("CI", "CO")
    kind: Kind = "counter" if counter else "voltage_out" if type_ == "AO" else settings.pop("kind", "voltage_in")
    physical = request.counter if counter else request.physical_channel
    add_channels(device, task, type_, kind, physical, request.name_to_assign_to_channel, **settings)


def _encoder(units: tuple[int, ...], per: str, initial: str, **settings: Any) -> TaskHandler:
    """Return the creator of a CI channel on a quadrature encoder of an angle or a length, from these fields.

    Nothing is wired to the Z index on the virtual bench, so that it never comes.
    """

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        decoding, phase = enum(request, "decoding_type"), enum(request, "zidx_phase") or Z_PHASES[0]
        one_of(decoding, (daqmx.X1, daqmx.X2, daqmx.X4, TWO_PULSES), "Decoding type")
        unit, scaling = _scaling(device, request, units)
        if not 0 < getattr(request, per) < float("inf"):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{per}: {getattr(request, per):g}")
        one_of(phase, Z_PHASES, "Z index phase")
        index = {"zidx_enable": bool(request.zidx_enable), "zidx_val": float(request.zidx_val), "zidx_phase": phase}
        own = {per: getattr(request, per), initial: getattr(request, initial), **settings, **index, **scaling}
        _add(device, task, request, "CI", decoding_type=decoding, units=unit, **own)
        if decoding == TWO_PULSES:
            task.unsimulated["decoding"] = "two pulses"
        _set_terminal(device, task, daqmx.CI_ENCODER_A_INPUT_TERM, "source")
        _set_terminal(device, task, daqmx.CI_ENCODER_B_INPUT_TERM, "auxiliary")
        _set_terminal(device, task, daqmx.CI_ENCODER_Z_INPUT_TERM, "gate")

    return create


def _set_terminal(
    device: DeviceState, task: SimulatedTask, attribute: int, pin: Literal["source", "gate", "auxiliary"]
) -> None:
    """Give the last channel of a task its default terminal, where it has one."""
    channel = task.channels[-1]
    if terminal := device.inventory.counter_terminal(channel.physical, pin):
        task.properties["Chan", channel.name, attribute] = "/" + device.inventory.full_name(terminal)


def ci_count_edges(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CI counting edges on a terminal, up or down."""
    edge, direction = enum(request, "edge"), enum(request, "count_direction")
    one_of(edge, (daqmx.RISING, daqmx.FALLING), "Edge")
    one_of(direction, (COUNT_UP, COUNT_DOWN), "Count direction")
    settings = {"initial_count": int(request.initial_count), "step": 1 if direction == COUNT_UP else -1}
    _add(device, task, request, "CI", measures=daqmx.EDGES, edge=edge, count_direction=direction, **settings)
    note_edge(task, "counted edge", edge)
    _set_terminal(device, task, daqmx.CI_TERM[daqmx.EDGES], "source")


EDGE_FIELDS = {"edge": "edge", "starting_edge": "edge", "first_edge": "first_edge", "second_edge": "second_edge"}
"""Setting of each field of a request that names an edge."""


def _of_pulses(measures: str | int, *units: int, unsimulated: str = "") -> TaskHandler:
    """Return the creator of a channel that measures the pulses on a terminal in one of these units.

    Of ``unsimulated`` measurements, which the product has and the virtual bench has not, ``measures`` is the driver's
    number: the channel is made, its task is refused.
    """

    def create(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        names = request.DESCRIPTOR.fields_by_name
        unit, scaling = units[0], dict[str, Any]()
        if "custom_scale_name" in names:
            unit, scaling = _scaling(device, request, units)
        elif "units" in names:
            one_of(enum(request, "units"), units, "Units")
        least, most = _limits(request, scaling)
        if not 0 < least < most:
            detail = f"Limits {request.min_val:g} to {request.max_val:g}"
            raise DaqStatusError(Code.MIN_NOT_LESS_THAN_MAX, detail)
        settings: dict[str, Any] = {"units": unit, "min_val": least, "max_val": most, **scaling}
        for edge in EDGE_FIELDS.keys() & set(names):
            one_of(enum(request, edge), (daqmx.RISING, daqmx.FALLING), "Edge")
            settings[EDGE_FIELDS[edge]] = enum(request, edge)
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
        settings["type" if unsimulated else "measures"] = measures
        _add(device, task, request, "CI", **settings)
        if unsimulated:
            task.unsimulated["measurement"] = unsimulated
        else:
            _set_terminal(device, task, daqmx.CI_TERM[str(measures)], pin)

    return create


COUNTER_INPUT_CALLS: dict[str, TaskHandler] = {
    "CreateCIAngEncoderChan": _encoder((daqmx.DEGREES, daqmx.RADIANS, daqmx.TICKS), "pulses_per_rev", "initial_angle"),
    "CreateCILinEncoderChan": _encoder(
        (METERS, INCHES, daqmx.TICKS), "dist_per_pulse", "initial_pos", type=LINEAR_ENCODER
    ),
    "CreateCICountEdgesChan": ci_count_edges,
    "CreateCIFreqChan": _of_pulses(daqmx.FREQUENCY, daqmx.HERTZ, daqmx.TICKS),
    "CreateCIPeriodChan": _of_pulses(daqmx.PERIOD, daqmx.SECONDS, daqmx.TICKS),
    "CreateCIPulseWidthChan": _of_pulses(daqmx.WIDTH, daqmx.SECONDS, daqmx.TICKS),
    "CreateCISemiPeriodChan": _of_pulses(SEMI_PERIOD, daqmx.SECONDS, daqmx.TICKS, unsimulated="semi-period"),
    "CreateCITwoEdgeSepChan": _of_pulses(TWO_EDGES, daqmx.SECONDS, daqmx.TICKS, unsimulated="two-edge separation"),
    "CreateCIPulseChanFreq": _of_pulses(daqmx.PULSE_FREQUENCY, daqmx.HERTZ),
    "CreateCIPulseChanTime": _of_pulses(daqmx.PULSE_TIME, daqmx.SECONDS),
    "CreateCIPulseChanTicks": _of_pulses(daqmx.PULSE_TICKS, daqmx.TICKS),
}


BY_FREQUENCY, BY_TIME, BY_TICKS = 10119, 10269, 10268


def co_pulse_frequency(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulse train by its frequency and duty cycle."""
    one_of(enum(request, "units"), (daqmx.HERTZ,), "Units")
    timebase = device.inventory.of(request.counter).product.counter_timebase_hz
    if not (
        timebase / 2**33 <= request.freq <= timebase / 4 and 0 < request.duty_cycle < 1 and request.initial_delay >= 0
    ):
        raise DaqStatusError(
            Code.INVALID_ATTRIBUTE_VALUE,
            f"Frequency {request.freq:g}, duty cycle {request.duty_cycle:g}, initial delay {request.initial_delay:g}",
        )
    rate_hz = timebase / round(timebase / request.freq)
    _add_output(device, task, request, BY_FREQUENCY, rate_hz, request.duty_cycle, request.initial_delay)


def co_pulse_time(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulses by their high and low times, s."""
    one_of(enum(request, "units"), (daqmx.SECONDS,), "Units")
    if not (request.high_time > 0 and request.low_time > 0 and request.initial_delay >= 0):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"High {request.high_time:g} s, low {request.low_time:g} s")
    _add_parts(device, task, request, BY_TIME, request.high_time, request.low_time, request.initial_delay)


def co_pulse_ticks(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulses by ticks of a timebase of the device."""
    source = device.inventory.terminal(request.source_terminal)
    match = re.fullmatch(r"(\d+)([Mk])HzTimebase", source)
    if match is None:
        raise NotImplementedByDevice(f"ticks of {request.source_terminal}")
    tick_s = 1 / (float(match[1]) * {"M": 1e6, "k": 1e3}[match[2]])
    if request.high_ticks < 2 or request.low_ticks < 2 or request.initial_delay < 0:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"High {request.high_ticks}, low {request.low_ticks} ticks")
    high_s, low_s, delay_s = (n * tick_s for n in (request.high_ticks, request.low_ticks, request.initial_delay))
    _add_parts(device, task, request, BY_TICKS, high_s, low_s, delay_s)
    task.channels[-1].settings["tick_s"] = tick_s


def _add_parts(
    device: DeviceState,
    task: SimulatedTask,
    request: Any,
    output_type: int,
    high_s: float,
    low_s: float,
    delay_s: float,
) -> None:
    timebase = device.inventory.of(request.counter).product.counter_timebase_hz
    if not max(high_s, low_s, delay_s) * timebase < 2**32:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"High {high_s:g} s, low {low_s:g} s, delay {delay_s:g} s")
    high, low = (max(round(part * timebase), 2) / timebase for part in (high_s, low_s))
    _add_output(device, task, request, output_type, 1 / (high + low), high / (high + low), delay_s)


def _add_output(
    device: DeviceState,
    task: SimulatedTask,
    request: Any,
    output_type: int,
    rate_hz: float,
    duty: float,
    delay_s: float,
) -> None:
    idle = enum(request, "idle_state")
    one_of(idle, (daqmx.LOW, daqmx.HIGH), "Idle state")
    timebase = device.inventory.of(request.counter).product.counter_timebase_hz
    if not delay_s * timebase < 2**32:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Initial delay {delay_s:g} s")
    _add(device, task, request, "CO", output_type=output_type, idle_state=idle)
    if idle == daqmx.HIGH:
        task.unsimulated["idle state"] = "high"
    name = task.channels[-1].name
    task.properties["Chan", name, daqmx.CO_PULSE_FREQ] = rate_hz
    task.properties["Chan", name, daqmx.CO_PULSE_DUTY_CYC] = duty
    task.properties["Chan", name, daqmx.CO_PULSE_FREQ_INITIAL_DELAY] = max(round(delay_s * timebase), 2) / timebase


def _write(
    device: DeviceState, task: SimulatedTask, request: Any, high_s: NDArray[np.float64], low_s: NDArray[np.float64]
) -> Fields | None:
    """Take pulses by their high and low times, (n,); the response of a scalar write is empty."""
    refuse_other_type(task, "CO")
    if high_s.size < 1 or high_s.size != low_s.size:
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, f"{high_s.size} high and {low_s.size} low parts")
    timebase = device.inventory.of(task.channels[0].physical.name).product.counter_timebase_hz
    high, low = np.rint(high_s * timebase), np.rint(low_s * timebase)
    parts = np.concatenate((high, low))
    if not (np.isfinite(parts).all() and parts.min() >= 2 and parts.max() < 2**32):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Pulses of {high_s[0]:g} s high, {low_s[0]:g} s low")
    clocked, untimed = task.timing.clock is not None, f"Task: {task.name} has no implicit timing for {high.size} pulses"
    refuse_any(
        (np.ptp(high + low) > 0 and not clocked, UNSUPPORTED, "not simulated: pulses of several frequencies at once"),
        (high.size > 1 and task.pulses.count == 1, Code.WRITE_NUM_CHANS_MISMATCH, untimed),
    )
    if task.progress.live:
        now_s, train = device.bench.now_s, pulse_train(task)
        task.pulses.passed, task.pulses.next_s = train.passed_at(now_s), train.next_after(now_s)
    name = task.channels[0].name
    task.properties["Chan", name, daqmx.CO_PULSE_FREQ] = float(timebase / (high[0] + low[0]))
    task.properties["Chan", name, daqmx.CO_PULSE_DUTY_CYC] = float(high[0] / (high[0] + low[0]))
    task.pulses.high_times_s = None if clocked else high / timebase
    if clocked:
        task.pulses.written = np.column_stack((high, low)) / timebase
    if task.progress.live:
        task.pulses.end_s = pulse_train(task).end_s
    elif request.auto_start:
        start_task(device, task)
    scalar = "num_samps_per_chan" not in request.DESCRIPTOR.fields_by_name
    return None if scalar else {"num_samps_per_chan_written": int(high.size)}


def _as_arrays(request: Any, *fields: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, second = (np.atleast_1d(np.array(getattr(request, field), dtype=np.float64)) for field in fields)
    return first, second


def _write_frequency(device: DeviceState, task: SimulatedTask, request: Any) -> Fields | None:
    frequency, duty = _as_arrays(request, "frequency", "duty_cycle")
    if frequency.size != duty.size or not ((frequency > 0) & (duty > 0) & (duty < 1)).all():
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, "frequencies must be above 0, duty cycles within 0 and 1")
    return _write(device, task, request, duty / frequency, (1 - duty) / frequency)


def _write_time(device: DeviceState, task: SimulatedTask, request: Any) -> Fields | None:
    return _write(device, task, request, *_as_arrays(request, "high_time", "low_time"))


def _write_ticks(device: DeviceState, task: SimulatedTask, request: Any) -> Fields | None:
    refuse_other_type(task, "CO")
    tick_s = task.channels[0].settings.get(
        "tick_s", 1 / device.inventory.of(task.channels[0].physical.name).product.counter_timebase_hz
    )
    high, low = _as_arrays(request, "high_ticks", "low_ticks")
    return _write(device, task, request, high * tick_s, low * tick_s)


COUNTER_OUTPUT_CALLS: dict[str, TaskHandler] = {
    "CreateCOPulseChanFreq": co_pulse_frequency,
    "CreateCOPulseChanTime": co_pulse_time,
    "CreateCOPulseChanTicks": co_pulse_ticks,
    "WriteCtrFreq": _write_frequency,
    "WriteCtrFreqScalar": _write_frequency,
    "WriteCtrTime": _write_time,
    "WriteCtrTimeScalar": _write_time,
    "WriteCtrTicks": _write_ticks,
    "WriteCtrTicksScalar": _write_ticks,
}


BUILT_IN, CONSTANT = 10200, 10116
THERMOCOUPLE = 10303
MOST_V = 0.1
"""No thermocouple gives more."""


def ai_thermocouple(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI temperature of a thermocouple, the cold junction at a constant temperature, deg C."""
    _increasing(request)
    units, kind, source = (enum(request, field) for field in ("units", "thermocouple_type", "cjc_source"))
    one_of(units, tuple(PER_CELSIUS), "Units")
    if source == BUILT_IN:
        raise DaqStatusError(Code.BUILT_IN_CJC_SRC_NOT_SUPPORTED, request.physical_channel)
    if source != CONSTANT or kind not in (J, K, T, E):
        raise NotImplementedByDevice(f"thermocouple of type {kind} with cold junction {source}")
    junction = {"thermocouple_type": kind, "cjc_source": source, "cjc_val": request.cjc_val}
    scale = ThermocoupleScale(kind, request.cjc_val, units)
    own = {"type": THERMOCOUPLE, "scale": scale, "units": units, **junction}
    _add(device, task, request, "AI", min_val=-MOST_V, max_val=MOST_V, **own)


INTERNAL_EXCITATION = 10200
RTD, VOLTAGE_WITH_EXCITATION = 10301, 10323
VOLTS_OF_SENSOR = 10.0
CHAN_FOR_ALL_LINES = 1
DEFAULT, RSE, NRSE, DIFFERENTIAL = -1, 10083, 10078, 10106
BRIDGE_CONFIGURATIONS = (10182, 10187, 10270)
BRIDGE_VALUES = (
    *("min_val", "max_val"),
    *(f"{point}_{side}_val" for point in ("first", "second") for side in ("electrical", "physical")),
)
"""Fields of a bridge's request that are settings of its channel."""


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
    in_units = {"units": units, "physical_units": physical, "electrical_units": electrical}
    points = {name: getattr(request, name) for name in BRIDGE_VALUES}
    _add(device, task, request, "AI", kind="bridge", **in_units, **points)


def ai_voltage(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AI voltage within one of the device's ranges."""
    _increasing(request)
    _, scaling = _scaling(device, request, (daqmx.VOLTS,))
    low_v, high_v = _limits(request, scaling)
    owner = device.inventory.of(request.physical_channel)
    if owner.product.ai_ranges_v:
        owner.voltage_range(low_v, high_v)
    before = len(task.channels)
    _add(device, task, request, "AI", min_val=low_v, max_val=high_v, **scaling)
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
        _add(device, task, request, "AI", min_val=-VOLTS_OF_SENSOR, max_val=VOLTS_OF_SENSOR, type=kind)
        task.unsimulated["measurement"] = what

    return create


def ao_voltage(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """AO voltage within the device's range."""
    _increasing(request)
    _, scaling = _scaling(device, request, (daqmx.VOLTS,))
    low_v, high_v = _limits(request, scaling)
    reach = device.inventory.of(request.physical_channel).product.ao_range_v
    if not -reach <= low_v < high_v <= reach:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Output limits {low_v:g} to {high_v:g} V")
    _add(device, task, request, "AO", min_val=low_v, max_val=high_v, **scaling)


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
