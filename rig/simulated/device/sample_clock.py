"""Time passing on the virtual device: outputs, plant, inputs, in this order, n edges of the bench at once.

Place in the data flow: the device decides how many edges pass; generations say what stands at the outputs at each, the
bench answers with what stands at the sensors' terminals, and every task takes the samples its clock ticked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.counter_readings import pulse_reading
from rig.simulated.device.input_readings import EDGES, analog_reading, edge_terminal, encoder_reading
from rig.simulated.device.pulse_trains import edges_until
from rig.simulated.device.reference_trigger import ticks_to_take
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.timing_engines import Engine, engine_of

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice


def let_pass(device: SimulatedDevice, n: int) -> None:
    """Let n edges of the bench pass."""
    bench = device.bench
    edge = bench.edge
    clocked = [(task, engine_of(device, task)) for task in device.tasks.values() if task.live and task.type != "CO"]
    motor = device.inventory.full_name(device.wiring.motor)
    command = np.full(n, device.output_v.get(motor, 0.0))
    device.line_history.clear()
    for task, engine in clocked:
        if engine is not None and task.type in ("AO", "DO"):
            _put_out(device, task, engine, motor, command)
    at_s = (edge + np.arange(n)) / bench.rate_hz
    bench.remember(command)
    cell, quarter = bench.step(command if device.drive_enabled() else np.zeros(n))
    cell, quarter = device.faults.change(device.trial, at_s, cell, quarter)
    for task, engine in clocked:
        if engine is None or task.buffer is None:
            continue
        first, last = _ticks(task, engine, edge, n)
        last = min(last, first + int(min(task.remaining(), last - first)))
        rows = engine.edges(first, last) - edge
        rows = np.clip(rows, 0, n - 1)
        if task.ref_trigger:
            rows = rows[: ticks_to_take(device, task, edge + rows)]
        if rows.size:
            task.buffer.put(latch(device, task, cell[rows], quarter[rows], edge + rows))
    now_s = bench.edge / bench.rate_hz
    for task in device.tasks.values():
        if task.type == "CO" and task.live and now_s >= task.pulse_end_s:
            task.finished = True


def _ticks(task: SimulatedTask, engine: Engine, edge: int, n: int) -> tuple[int, int]:
    return max(engine.passed(edge), task.since_tick), max(engine.passed(edge + n), task.since_tick)


def _put_out(
    device: SimulatedDevice, task: SimulatedTask, engine: Engine, motor: str, command: NDArray[np.float64]
) -> None:
    edge, n = device.bench.edge, command.size
    first, last = _ticks(task, engine, edge, n)
    rows = task.next_output(last - first)
    if not rows.shape[0]:
        return
    at = engine.edges(first, first + rows.shape[0]) - edge
    if task.type == "DO":
        _remember_lines(device, task, rows, at, n)
        return
    put_out(device, task, rows[-1])
    if task.type == "AO":
        for column, channel in enumerate(task.channels):
            if channel.physical.name == motor:
                held = np.searchsorted(at, np.arange(n), side="right") - 1
                reached = held >= 0
                command[reached] = rows[held[reached], column]


def _remember_lines(
    device: SimulatedDevice, task: SimulatedTask, rows: NDArray[np.float64], at: NDArray[np.int64], n: int
) -> None:
    """Put out levels, (m, lines), at edges ``at`` (m,) of the n that pass; an input sees what stood before its edge."""
    names = [line for channel in task.channels for line in channel.settings["lines"]]
    held = np.searchsorted(at, np.arange(n), side="right") - 1
    for column, name in enumerate(names):
        before = float(device.lines.get(name, False))
        after = np.where(held >= 0, rows[np.maximum(held, 0), column], before)
        device.line_history[name] = np.concatenate(([before], after))
    watched = any(other.live and other.changes & set(names) for other in device.tasks.values())
    for row in rows if watched else rows[-1:]:
        put_out(device, task, row)


def put_out(device: SimulatedDevice, task: SimulatedTask, row: NDArray[np.float64]) -> None:
    """Let the outputs of a task stand at these values, V per channel or levels per line; lines may be watched."""
    if task.type == "AO":
        device.output_v.update({c.physical.name: float(row[i]) for i, c in enumerate(task.channels)})
        return
    names = [line for channel in task.channels for line in channel.settings["lines"]]
    before = dict(device.lines)
    device.lines.update({name: bool(level) for name, level in zip(names, row, strict=True)})
    changed = {name for name in names if device.lines[name] != before.get(name, False)}
    for other in device.tasks.values():
        if other.live and other.buffer is not None and changed & other.changes:
            other.buffer.put(latch(device, other, *device.bench.present()))


def latch(
    device: SimulatedDevice,
    task: SimulatedTask,
    cell: NDArray[np.float64],
    quarter: NDArray[np.int64],
    edge: NDArray[np.int64] | None = None,
) -> NDArray[np.float64]:
    """Return what an input task reads, (n, channels or lines), for cell output (n,) and counts (n, 3) at edges (n,)."""
    on_demand = edge is None
    if edge is None:
        edge = np.full(cell.size, device.bench.edge)
    if task.type == "AI":
        return np.column_stack([analog_reading(device, task, channel, cell, edge) for channel in task.channels])
    if task.type == "DI":
        names = [line for channel in task.channels for line in channel.settings["lines"]]
        if on_demand:
            return np.tile([float(device.lines.get(name, False)) for name in names], (cell.size, 1))
        return np.column_stack([_level_before(device, name, edge) for name in names])
    channel = task.channels[0]
    if "decoding_type" in channel.settings:
        return encoder_reading(device, task, channel, quarter)[:, None]
    terminal = edge_terminal(device, task, channel)
    if channel.settings["measures"] != EDGES:
        return pulse_reading(device, task, channel, terminal, edge)
    passed = edges_until(device, terminal, edge) - task.counted
    return (channel.settings["initial_count"] + channel.settings["step"] * passed)[:, None].astype(np.float64)


def _level_before(device: SimulatedDevice, line: str, edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the level of a line just before each of the last edges (n,) of the bench."""
    history = device.line_history.get(line)
    if history is None:
        return np.full(edge.size, float(device.lines.get(line, False)))
    first = device.bench.edge - (history.size - 1)
    return history[np.clip(edge - first, 0, history.size - 1)]
