"""Calls that create counter outputs and write pulses to them.

Frequencies, times and delays are coerced to whole ticks of the counter's timebase. Written pulses take over from the
next pulse on; a buffer of them, one sample a pulse, may vary the duty cycle but not the frequency.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver.configuration import add_channels
from rig.simulated.driver.tasks import start_task
from rig.simulated.rpc.calls.data import refuse_other_type
from rig.simulated.rpc.handlers import Fields, TaskHandler
from rig.simulated.rpc.messages import enum
from rig.simulated.signals.pulses import pulse_train
from rig.simulated.status import DaqStatusError, NotImplementedByDevice, one_of

BY_FREQUENCY, BY_TIME, BY_TICKS = 10119, 10269, 10268


def co_pulse_frequency(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulse train by its frequency and duty cycle."""
    one_of(enum(request, "units"), (daqmx.HERTZ,), "Units")
    timebase = device.inventory.of(request.counter).product.counter_timebase_hz
    if not (
        timebase / 2**33 <= request.freq <= timebase / 4 and 0 < request.duty_cycle < 1 and request.initial_delay >= 0
    ):
        raise DaqStatusError(
            status.INVALID_VALUE,
            f"Frequency {request.freq:g}, duty cycle {request.duty_cycle:g}, initial delay {request.initial_delay:g}",
        )
    rate_hz = timebase / round(timebase / request.freq)
    _add_output(device, task, request, BY_FREQUENCY, rate_hz, request.duty_cycle, request.initial_delay)


def co_pulse_time(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulses by their high and low times, s."""
    one_of(enum(request, "units"), (daqmx.SECONDS,), "Units")
    if not (request.high_time > 0 and request.low_time > 0 and request.initial_delay >= 0):
        raise DaqStatusError(status.INVALID_VALUE, f"High {request.high_time:g} s, low {request.low_time:g} s")
    _add_parts(device, task, request, BY_TIME, request.high_time, request.low_time, request.initial_delay)


def co_pulse_ticks(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """CO pulses by ticks of a timebase of the device."""
    source = device.inventory.terminal(request.source_terminal)
    match = re.fullmatch(r"(\d+)([Mk])HzTimebase", source)
    if match is None:
        raise NotImplementedByDevice(f"ticks of {request.source_terminal}")
    tick_s = 1 / (float(match[1]) * {"M": 1e6, "k": 1e3}[match[2]])
    if request.high_ticks < 2 or request.low_ticks < 2 or request.initial_delay < 0:
        raise DaqStatusError(status.INVALID_VALUE, f"High {request.high_ticks}, low {request.low_ticks} ticks")
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
        raise DaqStatusError(status.INVALID_VALUE, f"High {high_s:g} s, low {low_s:g} s, delay {delay_s:g} s")
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
        raise DaqStatusError(status.INVALID_VALUE, f"Initial delay {delay_s:g} s")
    add_channels(
        device, task, "CO", "counter", request.counter, request.name_to_assign_to_channel,
        output_type=output_type, idle_state=idle,
    )  # fmt: skip
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
        raise DaqStatusError(status.WRONG_SIZE, f"{high_s.size} high and {low_s.size} low parts")
    timebase = device.inventory.of(task.channels[0].physical.name).product.counter_timebase_hz
    high, low = np.rint(high_s * timebase), np.rint(low_s * timebase)
    parts = np.concatenate((high, low))
    if not (np.isfinite(parts).all() and parts.min() >= 2 and parts.max() < 2**32):
        raise DaqStatusError(status.INVALID_VALUE, f"Pulses of {high_s[0]:g} s high, {low_s[0]:g} s low")
    clocked = task.timing.clock is not None
    if np.ptp(high + low) > 0 and not clocked:
        raise NotImplementedByDevice("pulses of several frequencies in one buffer")
    if high.size > 1 and task.pulses.count == 1:
        raise DaqStatusError(status.WRONG_SIZE, f"Task: {task.name} has no implicit timing for {high.size} pulses")
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
        raise DaqStatusError(status.INVALID_VALUE, "frequencies must be above 0, duty cycles within 0 and 1")
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
