"""Calls of a DAQmx client about a task as a whole: start, stop, control, wait, and the names of its channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState, commit, release, verify
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver.tasks import clear_task, start_task, stop_task
from rig.simulated.rpc.handlers import Fields, TaskHandler
from rig.simulated.rpc.messages import enum
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.wait import wait_until_done

START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)


def _control(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    action = enum(request, "action")
    if action == START:
        start_task(device, task)
    elif action in (STOP, ABORT):
        stop_task(device, task)
    elif action in (COMMIT, RESERVE):
        commit(device, task)
        task.committed = True
    elif action == UNRESERVE:
        release(device, task)
        task.output.samples = None  # the buffer goes with the reservation
    elif action == VERIFY:
        verify(device, task)
    else:
        raise DaqStatusError(status.INVALID_VALUE, f"Task action {action}")


def refuse_failed(task: SimulatedTask) -> None:
    """Raise the status that ended a task's generation, if one did."""
    if task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")


def _wait_until_done(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not task.done and not task.progress.error:
        wait_until_done(device, task, request.time_to_wait)
    refuse_failed(task)
    if not task.done:
        raise DaqStatusError(status.OPERATION_TIMED_OUT, f"Task: {task.name}")


def _devices(device: DeviceState, task: SimulatedTask) -> list[str]:
    return list(dict.fromkeys(device.inventory.of(channel.physical.name).name for channel in task.channels))


def _nth(names: Callable[[DeviceState, SimulatedTask], list[str]]) -> TaskHandler:
    def get(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        found = names(device, task)
        if not 1 <= request.index <= len(found):
            raise DaqStatusError(status.INVALID_VALUE, f"Index {request.index} of {len(found)}, counted from 1")
        return {"buffer": found[request.index - 1]}

    return get


_nth_channel = _nth(lambda device, task: [channel.name for channel in task.channels])

TASK_CALLS: dict[str, TaskHandler] = {
    "ClearTask": lambda device, task, request: clear_task(device, task.name),
    "StartTask": lambda device, task, request: start_task(device, task),
    "StopTask": lambda device, task, request: stop_task(device, task),
    "TaskControl": _control,
    "WaitUntilTaskDone": _wait_until_done,
    "GetNthTaskChannel": _nth_channel,
    "GetNthTaskReadChannel": _nth_channel,
    "GetNthTaskDevice": _nth(lambda device, task: _devices(device, task)),
}
