"""NI's DAQmx RPC service, answered by the virtual device: one handler per call, by the call's name.

Place in the data flow: an in-process channel or a TCP server hands requests in; both get the same answers.
A driver status below zero travels as the real server sends it (``ni-error`` in the trailing metadata, or a
status with partial data for reads that time out). A call that is not in the table raises
NotImplementedByDevice, which the client sees as UNIMPLEMENTED.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from rig.simulated import status
from rig.simulated.device import wait as waiting
from rig.simulated.device.device import SimulatedDevice
from rig.simulated.device.task import SimulatedTask
from rig.simulated.messages import CALLS, attribute_response, attribute_value, enum, response, session
from rig.simulated.rpc.calls.channels import CHANNEL_CALLS
from rig.simulated.rpc.calls.data import DATA_CALLS
from rig.simulated.rpc.calls.device import DEVICE_CALLS
from rig.simulated.rpc.calls.timing import TIMING_CALLS
from rig.simulated.rpc.calls.watchdog import WATCHDOG_CALLS
from rig.simulated.rpc.calls.waveforms import WAVEFORM_CALLS
from rig.simulated.rpc.event_streams import EVENTS, UNREGISTER, EventStream
from rig.simulated.rpc.properties import task as attributes
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

_ATTRIBUTE_CALL = re.compile(r"(Get|Set)(Task|Timing|Read|Write|Buffer|Chan|Trig)Attribute(\w+)")
POLL_S = 1e-3
"""Bench time that passes when a client asks whether a task is done."""
TRACE_LENGTH = 100_000
START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)


class Service:
    """Answers the calls of a DAQmx client from one virtual device; calls are handled one at a time."""

    def __init__(self, device: SimulatedDevice) -> None:
        self.device = device
        self.trace: list[str] = []
        """Names of the calls so far, the last 50,000 at least."""
        self.streams: list[EventStream] = []
        """Events that clients have registered."""
        self._lock = threading.RLock()
        device.between = self._give_way
        self._handlers: dict[str, Callable[[Any], Any]] = {
            "CreateTask": self._create_task,
            "ClearTask": self._clear_task,
            "StartTask": self._start_task,
            "StopTask": self._stop_task,
            "TaskControl": self._task_control,
            "IsTaskDone": self._is_task_done,
            "WaitUntilTaskDone": self._wait_until_task_done,
            "GetErrorString": self._error_string,
            "GetNthTaskChannel": self._nth("GetNthTaskChannel", lambda task: [c.name for c in task.channels]),
            "GetNthTaskReadChannel": self._nth("GetNthTaskReadChannel", lambda task: [c.name for c in task.channels]),
            "GetNthTaskDevice": self._nth(
                "GetNthTaskDevice", lambda task: [device.inventory.name][: len(task.channels)]
            ),
        }

    def alone(self) -> AbstractContextManager[bool]:
        """Keep clients waiting while the device is looked at."""
        return self._lock

    def _give_way(self) -> None:
        """Let other clients and the watchdog have a turn while time passes in one call."""
        self.device.watchdogs.look()
        self._lock.release()
        self._lock.acquire()

    def handle(self, call: str, request: Any) -> Any:
        """Answer one call.

        Raises
        ------
        DaqStatusError
            When the device refuses, with the driver's status code.
        NotImplementedByDevice
            When the virtual device does not have the call.
        """
        with self._lock:
            self.device.watchdogs.look()
            self.device.faults.before_call(call, self.device, getattr(request, "timeout", 0.0))
            self.trace.append(sys.intern(call))
            if len(self.trace) > TRACE_LENGTH:
                del self.trace[: TRACE_LENGTH // 2]
            if call in self._handlers:
                return self._handlers[call](request)
            if call in DATA_CALLS:
                return DATA_CALLS[call](self.device, self._task(request), request)
            if call in WAVEFORM_CALLS:
                return WAVEFORM_CALLS[call](self.device, self._task(request), request)
            if call in UNREGISTER:
                return self._unregister(call, request)
            if call in DEVICE_CALLS:
                return DEVICE_CALLS[call](self.device, request)
            if call in TIMING_CALLS:
                TIMING_CALLS[call](self.device, self._task(request), request)
                return response(call)
            if call in CHANNEL_CALLS:
                CHANNEL_CALLS[call](self.device, self._task(request), request)
                return response(call)
            if call in WATCHDOG_CALLS:
                return WATCHDOG_CALLS[call](self.device, request)
            match = _ATTRIBUTE_CALL.fullmatch(call)
            if match and call in CALLS:
                return self._attribute(call, match.group(1), match.group(2), request)
            raise NotImplementedByDevice(call)

    def stream(self, call: str, request: Any) -> EventStream:
        """Register an event and return the stream of its responses.

        Raises
        ------
        DaqStatusError, NotImplementedByDevice
            As :meth:`handle`.
        """
        with self._lock:
            self.device.faults.before_call(call, self.device)
            self.trace.append(sys.intern(call))
            if call not in EVENTS:
                raise NotImplementedByDevice(call)
            return EventStream(self, call, request)

    def _unregister(self, call: str, request: Any) -> Any:
        for stream in list(self.streams):
            if stream.is_like(UNREGISTER[call], request):
                stream.cancel()
        return response(call)

    def _task(self, request: Any) -> SimulatedTask:
        return self.device.task(request.task.name)

    def _create_task(self, request: Any) -> Any:
        found = self.device.attached(request.session_name, request.initialization_behavior)
        task = found or self.device.create_task(request.session_name)
        return response("CreateTask", task=session(task.name), new_session_initialized=found is None)

    def _clear_task(self, request: Any) -> Any:
        self.device.clear_task(request.task.name)
        return response("ClearTask")

    def _start_task(self, request: Any) -> Any:
        self.device.start(self._task(request))
        return response("StartTask")

    def _stop_task(self, request: Any) -> Any:
        self.device.stop(self._task(request))
        return response("StopTask")

    def _task_control(self, request: Any) -> Any:
        task, action = self._task(request), enum(request, "action")
        if action == START:
            self.device.start(task)
        elif action in (STOP, ABORT):
            self.device.stop(task)
        elif action in (COMMIT, RESERVE):
            self.device.commit(task)
            task.committed = True
        elif action == UNRESERVE:
            self.device.release(task)
            task.output = None  # the buffer goes with the reservation
        elif action != VERIFY:
            raise DaqStatusError(status.INVALID_VALUE, f"Task action {action}")
        return response("TaskControl")

    def _is_task_done(self, request: Any) -> Any:
        task = self._task(request)
        if task.error:
            raise DaqStatusError(task.error, f"Task: {task.name}")
        # asking takes its time where nothing else lets it pass
        if not task.done and self.trace[-2:-1] == ["IsTaskDone"]:
            self.device.advance(max(int(POLL_S * self.device.bench.rate_hz), 1))
        return response("IsTaskDone", is_task_done=task.done)

    def _wait_until_task_done(self, request: Any) -> Any:
        task = self._task(request)
        if not task.done and not task.error:
            waiting.until_done(self.device, task, request.time_to_wait)
        if task.error:
            raise DaqStatusError(task.error, f"Task: {task.name}")
        if not task.done:
            raise DaqStatusError(status.OPERATION_TIMED_OUT, f"Task: {task.name}")
        return response("WaitUntilTaskDone")

    def _attribute(self, call: str, action: str, category: str, request: Any) -> Any:
        task = self._task(request)
        channel = getattr(request, "channel", "")
        number = enum(request, "attribute")
        if action == "Set":
            attributes.put(self.device, task, category, channel, number, attribute_value(request))
            return response(call)
        return attribute_response(call, attributes.get(self.device, task, category, channel, number))

    def _nth(self, call: str, names: Callable[[SimulatedTask], list[str]]) -> Callable[[Any], Any]:
        def get(request: Any) -> Any:
            found = names(self._task(request))
            if not 1 <= request.index <= len(found):
                raise DaqStatusError(status.INVALID_VALUE, f"Index {request.index} of {len(found)}, counted from 1")
            return response(call, buffer=found[request.index - 1])

        return get

    def _error_string(self, request: Any) -> Any:
        return response("GetErrorString", error_string=status.TEXTS.get(request.error_code, "Unknown status code."))
