"""Pause triggers: a task with a sample clock of its own takes no sample while a digital terminal is at a level.

A counter output's pulses, a line of a port that shares its pin with the terminal, and nothing at all, which is low, can
be on it. The clock goes on by whole samples: what is left out is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.pulses import level_on


def paused(device: DeviceState, task: SimulatedTask, edge: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether a task pauses at each edge (n,) of the bench."""
    return level_on(device, task.triggers.pause, edge) == task.triggers.pause_high
