"""Writing samples to an output task: into its buffer, or to the outputs at once when it has no sample clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.device.state import DeviceState, commit, release
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.watchdog import refuse_expired
from rig.simulated.driver.tasks import start_task
from rig.simulated.signals.output_levels import set_outputs
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.wait import write_as_room_comes


def write_volts(
    device: DeviceState, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool, timeout_s: float
) -> None:
    """Take samples for an analog output, V or in its custom scale, shape (n, channels), within the channels' limits."""
    values = values.copy()
    for column, channel in enumerate(task.channels):
        if (scale := channel.settings.get("scale")) is not None:
            values[:, column] = scale.prescaled(values[:, column])
        low, high = channel.settings["min_val"], channel.settings["max_val"]
        inside = (values[:, column] >= low) & (values[:, column] <= high)  # NaN is not inside
        if not np.all(inside):
            detail = f"Channel: {channel.name}, limits {low:g} to {high:g} V"
            raise DaqStatusError(status.INVALID_AO_DATA, detail)
    write(device, task, values, auto_start, timeout_s)


def write(
    device: DeviceState, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool, timeout_s: float
) -> None:
    """Take samples for an output, shape (n, channels or lines): buffered, or put out at once without a clock."""
    refuse_expired(device, task)
    if task.timing.clock is None:
        _write_on_demand(device, task, values[-1], auto_start)
    elif task.state != "running":
        task.output.samples = values.copy()
        if auto_start:
            start_task(device, task)
    elif task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")
    elif task.regenerates or task.output.samples is None:
        task.output.samples = values.copy()
    else:
        write_as_room_comes(device, task, values, timeout_s)


def _write_on_demand(device: DeviceState, task: SimulatedTask, row: NDArray[np.float64], auto_start: bool) -> None:
    if task.state != "running":
        if not auto_start:
            raise DaqStatusError(status.NOT_STARTED, f"Task: {task.name}")
        commit(device, task)
        if not task.committed:
            release(device, task)
    set_outputs(device, task, row)
