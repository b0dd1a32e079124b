"""Reading samples from a task, letting time pass until they have been acquired."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import LOG
from rig.simulated.driver.tasks import start_task, stop_task
from rig.simulated.signals.input_samples import latch_now
from rig.simulated.status import DaqStatusError, NotImplementedByDevice
from rig.simulated.timing.wait import await_something, settle_on_demand, wait_for_samples, wait_for_timeout

MAX_ON_DEMAND = 100_000
"""Readings on demand in one call."""


def read(device: DeviceState, task: SimulatedTask, n: int, timeout_s: float) -> NDArray[np.float64]:
    """Return up to n samples per channel, shape (m, channels), letting time pass until they have been acquired.

    A negative n reads all available. Fewer come when the timeout ends first. Raises DaqStatusError when samples were
    overwritten or will never come.
    """
    if task.timing.clock is None and task.state != "running":  # started for this read alone
        start_task(device, task)
        try:
            return read(device, task, n, timeout_s)
        finally:
            stop_task(device, task)
    if task.state != "running":
        start_task(device, task)
    if task.timing.clock is None or task.buffer is None:
        return _read_on_demand(device, task, n, timeout_s)
    if task.logging.mode == LOG:
        raise DaqStatusError(status.LOGGING_ONLY, f"Task: {task.name}", samples_read=0)
    if n < 0:
        await_something(device, task)
        n = task.read_all_samples
    missing = n - task.buffer.available
    if task.triggers.referenced and task.samples_remaining > 0:
        missing = max(missing, 1)
    if missing > task.samples_remaining and not task.retriggerable:  # cut to what there will be
        n = task.buffer.available + int(task.samples_remaining)
        missing = n - task.buffer.available
        if n <= 0:
            raise DaqStatusError(status.PAST_THE_END, f"Task: {task.name}", samples_read=0)
    if missing > 0:
        wait_for_samples(device, task, missing, timeout_s)
    if task.progress.error:  # e.g. the watchdog expired while the read waited
        raise DaqStatusError(task.progress.error, f"Task: {task.name}", samples_read=0)
    if task.triggers.referenced and task.samples_remaining > 0:
        return np.empty((0, len(task.channels)))
    values = task.buffer.take(min(n, task.buffer.available))
    if task.log is not None and values.size:
        task.log.write(values)
    device.handed_out = max(device.handed_out, task.buffer.read)
    return values


def all_has_come(task: SimulatedTask) -> bool:
    """Whether a finite acquisition has ended and all its samples have been read: a read gives no more."""
    return task.buffer is not None and task.samples_remaining <= 0 and not task.buffer.available


def _read_on_demand(device: DeviceState, task: SimulatedTask, n: int, timeout_s: float) -> NDArray[np.float64]:
    if n > MAX_ON_DEMAND:
        raise NotImplementedByDevice(f"{n} readings on demand at once")
    if task.type in ("AI", "CI"):
        settle_on_demand(device)
    try:
        return np.concatenate([latch_now(device, task) for _ in range(max(n, 1))])
    except DaqStatusError as error:
        if error.code == status.SAMPLES_NOT_YET_AVAILABLE:
            wait_for_timeout(device, task, timeout_s)
        raise
