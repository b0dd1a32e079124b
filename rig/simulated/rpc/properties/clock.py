"""Properties of a task's timing: its kind, and rate, source, mode and samples of the sample clock.

A task on demand answers with the driver's defaults and keeps the number of samples that is set for the clock to come.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SampleClock, SimulatedTask, Timing
from rig.simulated.driver import configure_clock
from rig.simulated.rpc.messages import property_number
from rig.simulated.status import Code, DaqStatusError, Unsupported

IMPLICIT, CHANGE_DETECTION, SAMPLE_CLOCK, ON_DEMAND = 10451, 12504, 10388, 10390
"""Sample timing types."""
DEFAULT = SampleClock(1000.0, "", daqmx.CONTINUOUS, 1000)
FEWEST_SAMPLES = 2
"""Of a clocked analog task."""
_KINDS = ("AI", "AO", "DI", "DO")
TIMING_TYPE = property_number("Timing", "SAMP_TIMING_TYPE")
DIVISOR = property_number("Timing", "SAMP_CLK_TIMEBASE_DIV")
FIELDS = {
    property_number("Timing", name): field
    for name, field in (
        ("SAMP_CLK_RATE", "rate_hz"),
        ("SAMP_CLK_SRC", "source"),
        ("SAMP_QUANT_SAMP_MODE", "mode"),
        ("SAMP_QUANT_SAMP_PER_CHAN", "samples"),
    )
}
_BEFORE = ("Timing", "before the divisor", DIVISOR)
NUMBERS = frozenset({*FIELDS, TIMING_TYPE, DIVISOR})
"""Properties of this module."""


def get_clock(device: DeviceState, task: SimulatedTask, number: int) -> Any:
    """Return a property of the timing; refuses what the task's kind of timing does not have."""
    if number == TIMING_TYPE:
        return _timing_type(task)
    field = FIELDS.get(number, "")
    clock = task.timing.clock
    if number == DIVISOR:
        if clock is None or not task.timing.own_clock:
            raise _refused(task, number)
        return round(_timebase_hz(device, task) / clock.rate_hz)
    if clock is None and task.type in _KINDS:
        clock = _planned(task)
    if clock is None or (task.timing.implicit and field in ("rate_hz", "source")):
        raise Unsupported(f"Task: {task.name} has no sample clock")
    if field == "samples" and clock.samples < FEWEST_SAMPLES and task.type in ("AI", "AO"):
        raise DaqStatusError(
            Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {clock.samples}, at least {FEWEST_SAMPLES}"
        )
    if field != "source":
        return getattr(clock, field)
    if clock.source:
        return "/" + device.inventory.full_name(clock.source)
    owner = device.inventory.of(task.channels[0].physical.name)
    if owner.product.chassis or task.type not in _KINDS:
        return ""  # on a chassis the driver chooses an engine only when it reserves one
    return f"/{owner.name}/{str(task.type).lower()}/SampleClockTimebase"


def put_clock(device: DeviceState, task: SimulatedTask, number: int, value: Any) -> None:
    """Set a property of the timing."""
    task.refuse_while_running()
    clock = task.timing.clock
    if number == TIMING_TYPE:
        _change_type(device, task, value)
        return
    if number == DIVISOR:
        if clock is None or not task.timing.own_clock or type(value) is not int or value < 2:
            raise _refused(task, number)
        task.properties.setdefault(_BEFORE, clock.rate_hz)
        rate = _timebase_hz(device, task) / value
        configure_clock(device, task, rate, clock.source, clock.mode, clock.samples)
        return
    name = FIELDS[number]
    if name == "samples" and type(value) is int and not 1 <= value < 2**63:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {value}")
    if clock is None and name == "samples" and task.type in _KINDS and type(value) is int:
        task.properties["Timing", "", number] = value
        return
    if clock is None or task.timing.implicit or type(value) is not type(getattr(clock, name)):
        raise Unsupported(f"Task: {task.name} has no sample clock with {name}")
    changed = replace(clock, **{name: value})
    if changed.mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Sample mode {changed.mode}")
    configure_clock(device, task, changed.rate_hz, changed.source, changed.mode, changed.samples)


def reset_clock(device: DeviceState, task: SimulatedTask, number: int) -> None:
    """Put a property of the timing back to the driver's default."""
    task.refuse_while_running()
    if number == TIMING_TYPE:
        _change_type(device, task, ON_DEMAND)
    elif number == DIVISOR:
        if _BEFORE in task.properties and task.timing.clock is not None:
            clock, rate = task.timing.clock, task.properties.pop(_BEFORE)
            configure_clock(device, task, rate, clock.source, clock.mode, clock.samples)
    elif task.timing.clock is None:
        task.properties.pop(("Timing", "", number), None)
    else:
        put_clock(device, task, number, getattr(DEFAULT, FIELDS[number]))


def _planned(task: SimulatedTask) -> SampleClock:
    samples = task.setting("Timing", "", property_number("Timing", "SAMP_QUANT_SAMP_PER_CHAN"), DEFAULT.samples)
    return replace(DEFAULT, samples=samples)


def _timing_type(task: SimulatedTask) -> int:
    if task.timing.implicit or (task.type == "CO" and task.timing.clock is None):
        return IMPLICIT
    return CHANGE_DETECTION if task.timing.change_lines else SAMPLE_CLOCK if task.timing.clock else ON_DEMAND


def _change_type(device: DeviceState, task: SimulatedTask, value: Any) -> None:
    if task.type not in _KINDS or value not in (ON_DEMAND, SAMPLE_CLOCK):
        raise _refused(task, TIMING_TYPE)
    if value == ON_DEMAND:
        task.timing = Timing()
    elif _timing_type(task) != SAMPLE_CLOCK:
        planned = _planned(task)
        configure_clock(device, task, planned.rate_hz, planned.source, planned.mode, planned.samples)


def _timebase_hz(device: DeviceState, task: SimulatedTask) -> float:
    return device.inventory.of(task.channels[0].physical.name).product.timebase_hz


def _refused(task: SimulatedTask, number: int) -> Unsupported:
    return Unsupported(f"Property: 0x{number:04X} (Timing) of {task.name}")
