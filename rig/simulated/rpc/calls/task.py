"""Calls of a DAQmx client about a task as a whole: start, stop, control, wait, the names of its channels, and logging
of its samples to a TDMS file on the server's side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated.device.state import DeviceState, commit, release, verify
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import LOG, LOG_AND_READ, OFF, OPEN, LogSettings
from rig.simulated.driver import clear_task, open_log, start_task, stop_task
from rig.simulated.rpc.messages import Fields, TaskHandler, enum, property_number
from rig.simulated.rpc.properties.task import STORED
from rig.simulated.status import Code, DaqStatusError, one_of
from rig.simulated.timing import wait_until_done

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
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Task action {action}")


def refuse_failed(task: SimulatedTask) -> None:
    """Raise the status that ended a task's generation, if one did."""
    if task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")


def _wait_until_done(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not task.done and not task.progress.error:
        wait_until_done(device, task, request.time_to_wait)
    refuse_failed(task)
    if not task.done:
        raise DaqStatusError(Code.OPERATION_TIMED_OUT, f"Task: {task.name}")


def _is_task_done(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_failed(task)
    return {"is_task_done": task.done}


def _nth(names: Callable[[DeviceState, SimulatedTask], list[str]]) -> TaskHandler:
    def get(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        found = names(device, task)
        if not 1 <= request.index <= len(found):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Index {request.index} of {len(found)}, counted from 1")
        return {"buffer": found[request.index - 1]}

    return get


_nth_channel = _nth(lambda device, task: [channel.name for channel in task.channels])

MODE, PATH, GROUP, OPERATION = (
    property_number("Read", f"LOGGING_{what}") for what in ("MODE", "FILE_PATH", "TDMS_GROUP_NAME", "TDMS_OPERATION")
)


def settle_logging(task: SimulatedTask) -> None:
    """Take over what a client has set."""

    def value(number: int) -> Any:
        return task.setting("Read", "", number, STORED["Read", number].default)

    task.logging = LogSettings(value(MODE), value(PATH), value(GROUP), value(OPERATION))


def _configure(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    task.refuse_while_running()
    mode, operation = enum(request, "logging_mode") or LOG_AND_READ, enum(request, "operation") or OPEN
    one_of(mode, (OFF, LOG, LOG_AND_READ), "Logging mode")
    for number, value in ((MODE, mode), (PATH, request.file_path), (GROUP, request.group_name), (OPERATION, operation)):
        task.properties["Read", "", number] = value
    settle_logging(task)


def _start_new_file(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not request.file_path:
        raise DaqStatusError(Code.FILE_PATH_INVALID, f"Task: {task.name}: no path")
    task.properties["Read", "", PATH] = request.file_path
    settle_logging(task)
    if task.state == "running":
        open_log(task)


TASK_CALLS: dict[str, TaskHandler] = {
    "ClearTask": lambda device, task, request: clear_task(device, task.name),
    "StartTask": lambda device, task, request: start_task(device, task),
    "StopTask": lambda device, task, request: stop_task(device, task),
    "TaskControl": _control,
    "IsTaskDone": _is_task_done,
    "WaitUntilTaskDone": _wait_until_done,
    "GetNthTaskChannel": _nth_channel,
    "GetNthTaskReadChannel": _nth_channel,
    "GetNthTaskDevice": _nth(lambda device, task: device.devices_of(task)),
    "ConfigureLogging": _configure,
    "StartNewFile": _start_new_file,
}
