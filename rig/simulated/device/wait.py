"""Letting time pass on the virtual device until something has happened: samples, the end of a task, a timeout.

Place in the data flow: reads and waits of a client come here; time moves nowhere else. Where the clock is paced it
moves in stretches of 20 ms, between which other clients and the watchdog get a turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.device import triggers as starting
from rig.simulated.device.sample_clock import let_pass
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.timing_engines import engine_of, own_clock
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

STEP_S = 0.02
LOOK_S = 0.01
FOR_EVER = np.iinfo(np.int64).max


def advance(device: SimulatedDevice, n: int) -> int:
    """Let at most n edges of the bench pass, return how many did; none do when no task has anything left to do."""
    wanted = n
    step = max(int(STEP_S * device.bench.rate_hz), 1) if device.bench.clock.paced else n
    while n > 0:
        now = int(min(n, step, _edges_left(device), starting.edges_to_trigger(device)))
        if now <= 0:
            break
        let_pass(device, now)
        starting.look_for_triggers(device)
        n -= now
        if n > 0:
            device.between()
    return wanted - n


def _edges_left(device: SimulatedDevice) -> float:
    """Edges until the last task with a clock of its own has ended."""
    left = 0.0
    for task in device.tasks.values():
        if not task.live:
            continue
        if task.type == "CO":
            left = max(left, 0.0 if task.finished else _edges_to_pulse_end(device, task))
        elif own_clock(task) and (engine := engine_of(device, task)) is not None:
            ended = float("inf") if np.isinf(engine.limit) else engine.edge_after(int(engine.limit))
            left = max(left, ended - device.bench.edge)
    return left


def _edges_to_pulse_end(device: SimulatedDevice, task: SimulatedTask) -> float:
    return float(np.ceil(task.pulse_end_s * device.bench.rate_hz) - device.bench.edge) + 1


def until_done(device: SimulatedDevice, task: SimulatedTask, duration_s: float) -> None:
    """Let time pass until a task is done, at most ``duration_s``; a negative one waits for ever."""
    allowed = _edges_of(device, duration_s)
    left = 0.0
    if task.type == "CO":
        left = _edges_to_pulse_end(device, task) if task.live else 0.0
    elif task.live and np.isfinite(task.to_do) and (engine := engine_of(device, task)) is not None:
        left = engine.edge_after(task.since_tick + task.ticked + int(task.to_do)) - device.bench.edge
    elif task.live:
        left = float("inf")
    if np.isfinite(left):
        advance(device, int(min(left, allowed)))
    elif duration_s > 0:
        advance(device, int(allowed))


def for_samples(device: SimulatedDevice, task: SimulatedTask, missing: int, timeout_s: float) -> None:
    """Let time pass until a task has ``missing`` more samples, or the timeout has ended."""
    if task.buffer is not None:
        allowed = _edges_of(device, timeout_s)
        wanted = task.buffer.acquired + missing
        while allowed > 0 and task.state == "running" and _incomplete(task, wanted):
            passed = advance(device, int(min(_edges_to_sample(device, task, wanted), allowed)))
            if not passed:
                break
            allowed -= passed
        if not _incomplete(task, wanted):
            return
        timeout_s = allowed / device.bench.rate_hz
    in_vain(device, task, timeout_s)


def in_vain(device: SimulatedDevice, task: SimulatedTask, timeout_s: float) -> None:
    """Let a timeout pass for a task for which nothing ticks; other clients get a turn, and may end it."""
    if timeout_s < 0:
        timeout_s = float(FOR_EVER) / device.bench.rate_hz
    while timeout_s > 0 and task.state == "running":
        now_s = min(timeout_s, STEP_S) if device.bench.clock.paced else timeout_s
        device.bench.clock.advance(now_s)
        timeout_s -= now_s
        device.between()


def _incomplete(task: SimulatedTask, wanted: int) -> bool:
    if task.ref_trigger:
        return task.to_do > 0
    return task.buffer is not None and task.buffer.acquired < wanted


def _edges_to_sample(device: SimulatedDevice, task: SimulatedTask, wanted: int) -> float:
    """Return in how many edges of the bench to look whether a task has acquired ``wanted`` samples."""
    look_again = max(int(LOOK_S * device.bench.rate_hz), 1)
    if not task.live:
        to_trigger = starting.edges_to_trigger(device)
        return to_trigger if np.isfinite(to_trigger) else look_again
    engine = engine_of(device, task)
    if engine is None or task.ref_trigger:
        return look_again
    ticks = wanted - task.before_trigger
    if task.retriggerable and task.clock is not None:
        ticks = min(ticks, task.clock.samples)
    return max(engine.edge_after(task.since_tick + ticks) - device.bench.edge, 1)


def for_room(device: SimulatedDevice, task: SimulatedTask, values: NDArray[np.float64], timeout_s: float) -> None:
    """Give samples, (n, columns), to a running generation that puts each out once, as its buffer has room for them.

    Raises DaqStatusError when the timeout ends first, or the generation has.
    """
    allowed = _edges_of(device, timeout_s)
    written = 0
    while written < values.shape[0] and task.output is not None:
        if task.error:
            raise DaqStatusError(task.error, f"Task: {task.name}", samples_written=written)
        room = task.capacity - (task.output.shape[0] - task.generated)
        if room > 0:
            task.output = np.concatenate((task.output, values[written : written + room]))
            written = min(written + room, values.shape[0])
        elif allowed <= 0 or task.state != "running":
            raise DaqStatusError(status.NOT_YET_WRITTEN, f"Task: {task.name}", samples_written=written)
        else:
            step = min(max(int(LOOK_S * device.bench.rate_hz), 1), allowed)
            if not advance(device, step):
                device.bench.clock.advance(step / device.bench.rate_hz)
                device.between()
            allowed -= step


def _edges_of(device: SimulatedDevice, timeout_s: float) -> int:
    """Return a timeout in edges of the bench; a negative one has no end, one that is no number has ended."""
    if timeout_s < 0 or timeout_s * device.bench.rate_hz > FOR_EVER:
        return int(FOR_EVER)
    return int(timeout_s * device.bench.rate_hz + 1e-9) if timeout_s > 0 else 0


def catch_up(device: SimulatedDevice, task: SimulatedTask) -> None:
    """Let the time pass that should have passed by itself, for a client that asks what is there."""
    clock = device.bench.clock
    if task.live and task.buffer is not None and (clock.paced or not task.buffer.available):
        advance(device, int(clock.due_s * device.bench.rate_hz))
