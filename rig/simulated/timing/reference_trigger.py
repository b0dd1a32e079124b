"""Reference triggers: a finite acquisition that keeps samples from before an edge and ends a set number after it.

The input buffer drops its oldest samples until the edge has come; nothing can be read before the last posttrigger
sample has been acquired, as with the driver.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.pulses import edges_passed


def ticks_to_acquire(
    device: DeviceState, task: SimulatedTask, edge: NDArray[np.int64], values: NDArray[np.float64]
) -> int:
    """Return how many of the next ticks, on these edges of the bench (n,), still belong to the acquisition.

    ``values``, (n, channels), are what the task would acquire. An edge of the trigger counts only after all pretrigger
    samples have been acquired. The first sample behind it is the first posttrigger sample.
    """
    progress, triggers = task.progress, task.triggers
    if task.timing.clock is None or task.buffer is None or not edge.size:
        return 0
    if progress.reference_end is None:
        index = task.buffer.acquired + np.arange(edge.size)
        comparator = progress.comparator
        if comparator is None:
            passed = edges_passed(device, triggers.reference, edge)
        else:
            passed = progress.crossings + comparator.crossings(values[:, 0])
            progress.crossings = int(passed[-1])
        armed = index >= triggers.pretrigger_samples
        if progress.reference_edges is None and armed.any():
            progress.reference_edges = int(passed[armed][0])
        posttrigger = armed & (passed > (progress.reference_edges or 0))
        if not posttrigger.any():
            return edge.size
        first = int(index[posttrigger][0])
        progress.reference_end = first + task.timing.clock.samples - triggers.pretrigger_samples
    return int(min(edge.size, max(progress.reference_end - task.buffer.acquired, 0)))
