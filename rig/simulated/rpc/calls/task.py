"""Calls of a DAQmx client about a task as a whole: start, stop, control, wait, and the names of its channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState, commit, release
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver.tasks import clear_task, start_task, stop_task
from rig.simulated.rpc.messages import enum, response
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.wait import wait_until_done

START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)


def _clear(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    clear_task(device, task.name)
    return response("ClearTask")


def _start(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    start_task(device, task)
    return response("StartTask")


def _stop(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    stop_task(device, task)
    return response("StopTask")


def _control(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
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
    elif action != VERIFY:
        raise DaqStatusError(status.INVALID_VALUE, f"Task action {action}")
    return response("TaskControl")


def refuse_failed(task: SimulatedTask) -> None:
    """Raise the status that ended a task's generation, if one did."""
    if task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")


def _wait_until_done(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    if not task.done and not task.progress.error:
        wait_until_done(device, task, request.time_to_wait)
    refuse_failed(task)
    if not task.done:
        raise DaqStatusError(status.OPERATION_TIMED_OUT, f"Task: {task.name}")
    return response("WaitUntilTaskDone")


def _nth(call: str, names: Callable[[DeviceState, SimulatedTask], list[str]]) -> Any:
    def get(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
        found = names(device, task)
        if not 1 <= request.index <= len(found):
            raise DaqStatusError(status.INVALID_VALUE, f"Index {request.index} of {len(found)}, counted from 1")
        return response(call, buffer=found[request.index - 1])

    return get


def _channel_names(device: DeviceState, task: SimulatedTask) -> list[str]:
    return [channel.name for channel in task.channels]


TASK_CALLS: dict[str, Callable[[DeviceState, SimulatedTask, Any], Any]] = {
    "ClearTask": _clear,
    "StartTask": _start,
    "StopTask": _stop,
    "TaskControl": _control,
    "WaitUntilTaskDone": _wait_until_done,
    **{call: _nth(call, _channel_names) for call in ("GetNthTaskChannel", "GetNthTaskReadChannel")},
    "GetNthTaskDevice": _nth("GetNthTaskDevice", lambda device, task: [device.inventory.name][: len(task.channels)]),
}
