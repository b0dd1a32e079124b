"""The samples an input task acquires: what is on its terminals, latched at edges of the bench or on demand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.counter_readings import pulse_reading
from rig.simulated.signals.input_readings import analog_reading, encoder_reading
from rig.simulated.signals.pulses import edges_passed, input_terminal


def latch(
    device: DeviceState,
    task: SimulatedTask,
    cell: NDArray[np.float64],
    quarter: NDArray[np.int64],
    edge: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return what an input task reads, (n, channels or lines), for cell output (n,) and counts (n, 3) at edges (n,)."""
    if task.type == "AI":
        return np.column_stack([analog_reading(device, task, channel, cell, edge) for channel in task.channels])
    if task.type == "DI":
        return np.column_stack([_level_before(device, name, edge) for name in task.lines])
    channel = task.channels[0]
    if task.measures != daqmx.EDGES:
        if task.measures is None:
            reading = encoder_reading(device, task, channel, quarter)[:, None]
        else:
            reading = pulse_reading(device, task, channel, edge)
        scale = channel.settings.get("scale")
        return reading if scale is None else scale.scaled(reading)
    passed = edges_passed(device, input_terminal(device, task, channel), edge) - task.progress.initial_edges
    return (channel.settings["initial_count"] + channel.settings["step"] * passed)[:, None].astype(np.float64)


def latch_now(device: DeviceState, task: SimulatedTask) -> NDArray[np.float64]:
    """Return what an input task reads on demand, shape (1, channels or lines), without letting time pass."""
    cell, quarter = device.bench.present()
    if task.type == "DI":
        return np.array([[float(device.lines.get(name, False)) for name in task.lines]])
    device.bench.settle_motor_volts(device.output_v.get(device.motor, 0.0))
    return latch(device, task, cell, quarter, np.array([device.bench.edge]))


def _level_before(device: DeviceState, line: str, edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the level of a line just before each of the last edges (n,) of the bench."""
    history = device.line_history.get(line)
    if history is None:
        return np.full(edge.size, float(device.lines.get(line, False)))
    first = device.bench.edge - (history.size - 1)
    return history[np.clip(edge - first, 0, history.size - 1)]
