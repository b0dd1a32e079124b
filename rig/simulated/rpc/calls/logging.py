"""Calls and settings of a task that logs its samples to a TDMS file on the server's side."""

from __future__ import annotations

from typing import Any

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import LOG, LOG_AND_READ, OFF, OPEN, LogSettings
from rig.simulated.driver.tasks import open_log
from rig.simulated.rpc.handlers import TaskHandler
from rig.simulated.rpc.messages import enum, property_number
from rig.simulated.rpc.properties import stored
from rig.simulated.status import DaqStatusError, one_of

MODE, PATH, GROUP, OPERATION = (
    property_number("Read", f"LOGGING_{what}") for what in ("MODE", "FILE_PATH", "TDMS_GROUP_NAME", "TDMS_OPERATION")
)


def settle(task: SimulatedTask) -> None:
    """Take over what a client has set."""

    def value(number: int) -> Any:
        return task.setting("Read", "", number, stored.STORED["Read", number].default)

    task.logging = LogSettings(value(MODE), value(PATH), value(GROUP), value(OPERATION))


def _configure(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    task.refuse_while_running()
    mode, operation = enum(request, "logging_mode") or LOG_AND_READ, enum(request, "operation") or OPEN
    one_of(mode, (OFF, LOG, LOG_AND_READ), "Logging mode")
    for number, value in ((MODE, mode), (PATH, request.file_path), (GROUP, request.group_name), (OPERATION, operation)):
        task.properties["Read", "", number] = value
    settle(task)


def _start_new_file(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not request.file_path:
        raise DaqStatusError(status.FILE_PATH_INVALID, f"Task: {task.name}: no path")
    task.properties["Read", "", PATH] = request.file_path
    settle(task)
    if task.state == "running":
        open_log(task)


LOGGING_CALLS: dict[str, TaskHandler] = {"ConfigureLogging": _configure, "StartNewFile": _start_new_file}
