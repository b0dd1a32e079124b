"""Time passing on the virtual device: outputs, plant, inputs, in this order, n edges of the bench at once.

Generations say what the outputs are at by each edge, the bench answers with what stands at the sensors' terminals, and
every input task acquires the samples its clock ticked for. Sample k of AI and CI is latched at edge k; sample k of AO
is generated at edge k and stays until the next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import LOG
from rig.simulated.signals.input_readings import analog_reading
from rig.simulated.signals.input_samples import latch
from rig.simulated.signals.output_levels import set_clocked_lines, set_outputs
from rig.simulated.timing.clocked_pulses import load_pulses
from rig.simulated.timing.engine import Engine, engine_of
from rig.simulated.timing.pause_trigger import paused
from rig.simulated.timing.reference_trigger import ticks_to_acquire
from rig.simulated.timing.triggers import watches


def pass_edges(device: DeviceState, n: int) -> None:
    """Let n edges of the bench pass."""
    bench, edge = device.bench, device.bench.edge
    clocked = [
        (task, engine)
        for task in device.tasks.values()
        if task.progress.live and task.type != "CO" and (engine := engine_of(device, task)) is not None
    ]
    command_v = np.full(n, device.output_v.get(device.motor, 0.0))
    device.line_history.clear()
    for task, engine in clocked:
        if task.type in ("AO", "DO"):
            _generate(device, task, engine, command_v)
    at_s = (edge + np.arange(n)) / bench.rate_hz
    bench.set_motor_volts(command_v)
    cell, quarter = bench.step(command_v if device.drive_enabled() else np.zeros(n))
    cell, quarter = device.faults.change(device.trial, at_s, cell, quarter)
    for task, engine in clocked:
        if task.buffer is None:
            continue
        first, last = _ticks(task, engine, edge, n)
        if not task.triggers.pause:
            last = min(last, first + int(min(task.samples_remaining, last - first)))
        rows = np.clip(engine.edges(first, last) - edge, 0, n - 1)
        if task.triggers.pause:
            rows = rows[~paused(device, task, edge + rows)]
            rows = rows[: int(min(task.samples_remaining, rows.size))]
        if not rows.size:
            continue
        values = latch(device, task, cell[rows], quarter[rows], edge + rows)
        if task.triggers.referenced:
            values = values[: ticks_to_acquire(device, task, edge + rows, values)]
        if values.size:
            task.buffer.put(values)
        if task.log is not None and task.logging.mode == LOG:
            task.log.write(task.buffer.take(task.buffer.available))
    for task in device.tasks.values():
        if watches(task) and (comparator := task.progress.comparator) is not None:
            reading = analog_reading(device, task, task.channels[0], cell, edge + np.arange(n))
            task.progress.triggered = task.progress.triggered or bool(comparator.crossings(reading)[-1])
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and task.pulses.written is not None:
            load_pulses(device, task, edge, n)
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and bench.now_s >= task.pulses.end_s:
            task.pulses.finished = True


def _ticks(task: SimulatedTask, engine: Engine, edge: int, n: int) -> tuple[int, int]:
    first = task.progress.first_tick
    return max(engine.passed(edge), first), max(engine.passed(edge + n), first)


def _generate(device: DeviceState, task: SimulatedTask, engine: Engine, command_v: NDArray[np.float64]) -> None:
    """Generate the samples of the next edges; those of the motor's channel go into ``command_v``, (n,)."""
    edge, n = device.bench.edge, command_v.size
    first, last = _ticks(task, engine, edge, n)
    at = engine.edges(first, last) - edge
    if task.triggers.pause:
        at = at[~paused(device, task, edge + at)]
    rows = task.generate(at.size)
    if not rows.shape[0]:
        return
    at = at[: rows.shape[0]]
    if task.type == "DO":
        set_clocked_lines(device, task, rows, at, n)
        return
    set_outputs(device, task, rows[-1])
    for column, channel in enumerate(task.channels):
        if channel.physical.name == device.motor:
            last_row = np.searchsorted(at, np.arange(n), side="right") - 1
            reached = last_row >= 0
            command_v[reached] = rows[last_row[reached], column]
