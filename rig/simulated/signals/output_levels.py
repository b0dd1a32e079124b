"""What the outputs of a task are at: volts of analog outputs, levels of digital lines and their changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.input_samples import latch_now


def set_outputs(device: DeviceState, task: SimulatedTask, row: NDArray[np.float64]) -> None:
    """Set a task's outputs, V per channel or levels per line; tasks with change detection acquire a sample."""
    if task.type == "AO":
        device.output_v.update({c.physical.name: float(row[i]) for i, c in enumerate(task.channels)})
        return
    names = task.lines
    before = dict(device.lines)
    open_ = tristate_lines(task)
    device.lines.update({name: bool(level) and name not in open_ for name, level in zip(names, row, strict=True)})
    changed = {name for name in names if device.lines[name] != before.get(name, False)}
    for other in device.tasks.values():
        if other.progress.live and other.buffer is not None and changed & other.timing.change_lines:
            other.buffer.put(latch_now(device, other))


def tristate_lines(task: SimulatedTask) -> set[str]:
    """Return the lines a task does not drive: the card's resistors pull them low."""
    return {
        line
        for channel in task.channels
        if task.setting("Chan", channel.name, daqmx.DO_TRISTATE, False)
        for line in channel.settings["lines"]
    }


def set_clocked_lines(
    device: DeviceState, task: SimulatedTask, rows: NDArray[np.float64], at: NDArray[np.int64], n: int
) -> None:
    """Set levels, (m, lines), at edges ``at`` (m,) of the n that pass; an input sees the level before its edge."""
    names = task.lines
    last_row = np.searchsorted(at, np.arange(n), side="right") - 1
    open_ = tristate_lines(task)
    for column, name in enumerate(names):
        before = float(device.lines.get(name, False))
        levels = np.zeros(rows.shape[0]) if name in open_ else rows[:, column]
        after = np.where(last_row >= 0, levels[np.maximum(last_row, 0)], before)
        device.line_history[name] = np.concatenate(([before], after))
    detected = any(other.progress.live and other.timing.change_lines & set(names) for other in device.tasks.values())
    for row in rows if detected else rows[-1:]:
        set_outputs(device, task, row)
