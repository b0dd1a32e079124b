"""Reference triggers: a finite acquisition that keeps what came before an edge and ends a set time after it.

Place in the data flow: the device acquires into a buffer that forgets its oldest samples until the edge has come;
nothing can be read before the last sample after it is there, as with the driver.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.pulse_trains import edges_until
from rig.simulated.device.task import SimulatedTask

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice


def ticks_to_take(device: SimulatedDevice, task: SimulatedTask, edge: NDArray[np.int64]) -> int:
    """Return how many of the next ticks, on these edges of the bench (n,), still belong to the acquisition.

    An edge counts only after all the pretrigger samples have come. The first sample behind it is the first of those
    after the trigger.
    """
    if task.clock is None or task.buffer is None or not edge.size:
        return 0
    if task.ref_end is None:
        index = task.buffer.acquired + np.arange(edge.size)
        passed = edges_until(device, task.ref_trigger, edge)
        armed = index >= task.pretrigger
        if task.ref_edges is None and armed.any():
            task.ref_edges = int(passed[armed][0])
        come = armed & (passed > (task.ref_edges or 0))
        if not come.any():
            return edge.size
        task.ref_end = int(index[come][0]) + task.clock.samples - task.pretrigger
    return int(min(edge.size, max(task.ref_end - task.buffer.acquired, 0)))
