"""What a counter measures of the pulses on its terminal: frequency, period, width, or high and low parts.

Asked at each tick of the counter's clock. Without pulses there is nothing to measure, and the driver times out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.signals.pulses import high_times, input_terminal, pulses_on
from rig.simulated.status import DaqStatusError


def pulse_reading(
    device: DeviceState, task: SimulatedTask, channel: Channel, edge: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return what a counter gives for the pulse that ends at each edge (n,) of the bench: (n, 1), (n, 2) for pairs."""
    terminal, bench = input_terminal(device, task, channel), device.bench
    train = pulses_on(device, terminal)
    if train is None or not np.isfinite(train.next_after(bench.now_s)):
        raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}: no edges", samples_read=0)
    timebase, settings = device.inventory.of(channel.physical.name).product.counter_timebase_hz, channel.settings
    if task.timing.implicit and task.buffer is not None:  # each sample is the pulse after the last one's
        first = train.passed_at(task.progress.live_since_s) + task.buffer.acquired
        number = first + np.arange(edge.size)
    else:
        number = np.maximum(train.passed(edge / bench.rate_hz) - 2, 0)
    high = high_times(device, terminal, train, number)
    period = np.full(edge.size, 1 / train.rate_hz)
    measures = settings["measures"]
    if measures == daqmx.PULSE_FREQUENCY:
        return np.column_stack((1 / period, high / period))
    if measures == daqmx.PULSE_TIME:
        return np.column_stack((high, period - high))
    if measures in (daqmx.FREQUENCY, daqmx.PERIOD, daqmx.WIDTH):
        part = period if measures != daqmx.WIDTH else period - high if settings["edge"] == daqmx.FALLING else high
        if settings["units"] == daqmx.TICKS:
            return np.rint(part * timebase)[:, None]
        return (1 / part if measures == daqmx.FREQUENCY else part)[:, None]
    return np.rint(np.column_stack((high, period - high)) * timebase)
