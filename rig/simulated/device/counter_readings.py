"""What a counter measures of the pulses on its terminal: frequency, period, width, or high and low parts.

Place in the data flow: passing time asks at each tick of the counter's clock; a counter output of the bench, or the
camera, drives the terminal. Without pulses there is nothing to measure, and the driver times out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.device.input_readings import FALLING, FREQUENCY, PERIOD, PULSE_FREQUENCY, PULSE_TIME, TICKS, WIDTH
from rig.simulated.device.pulse_trains import driver_of, highs_of
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice


def pulse_reading(
    device: SimulatedDevice, task: SimulatedTask, channel: Channel, terminal: str, edge: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return what a counter gives for the pulse that ends at each edge (n,) of the bench: (n, 1), (n, 2) for pairs."""
    train, bench = driver_of(device, terminal), device.bench
    if train is None or not np.isfinite(train.next_after(bench.edge / bench.rate_hz)):
        raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}: no edges", samples_read=0)
    timebase, settings = device.inventory.product.counter_timebase_hz, channel.settings
    if task.implicit and task.buffer is not None:  # each sample is the pulse after the last one's
        first = int(train.passed(np.array([task.since_s]))[0]) + task.buffer.acquired
        number = first + np.arange(edge.size)
    else:
        number = np.maximum(train.passed(edge / bench.rate_hz) - 2, 0)
    high = highs_of(device, terminal, train, number)
    period = np.full(edge.size, 1 / train.rate_hz)
    measures = settings["measures"]
    if measures == PULSE_FREQUENCY:
        return np.column_stack((1 / period, high / period))
    if measures == PULSE_TIME:
        return np.column_stack((high, period - high))
    if measures in (FREQUENCY, PERIOD, WIDTH):
        part = period if measures != WIDTH else period - high if settings["edge"] == FALLING else high
        if settings["units"] == TICKS:
            return np.rint(part * timebase)[:, None]
        return (1 / part if measures == FREQUENCY else part)[:, None]
    return np.rint(np.column_stack((high, period - high)) * timebase)
