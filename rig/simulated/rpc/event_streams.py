"""Event streams of a DAQmx client: every N samples, done, a signal; each a generator of responses.

A channel iterates them in a thread of its client; a server lets :class:`StreamPump` send all of them from one thread.
Waiting for an event lets the bench's time pass in stretches, as long as the client
keeps up: on a virtual clock nothing runs ahead of samples that were announced and not yet read. A stream ends when its
task is cleared, or the client cancels.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import find_task
from rig.simulated.rpc.messages import enum, response
from rig.simulated.status import EVENT_REGISTERED, Code, DaqStatusError, NotImplementedByDevice
from rig.simulated.timing import advance, edges_in, engine_of, go_on

ACQUIRED, TRANSFERRED = 1, 2
SAMPLE_CLOCK, CHANGE_DETECTION, SAMPLE_COMPLETE = 12487, 12511, 12530
POLL_S = 0.002
STRETCH_S = 0.01


class EventStreams:
    """The events that the clients of one device have registered."""

    def __init__(self, device: DeviceState, lock: AbstractContextManager[bool]) -> None:
        self.device = device
        self.lock = lock
        """Held while the device is touched."""
        self._registered: list[EventStream] = []

    def register(self, call: str, request: Any) -> EventStream:
        """Register an event of a task that does not run yet; one of each kind a task."""
        task = find_task(self.device, request.task.name)
        is_due = EVENTS[call](task, request)
        if task.state == "running":
            raise DaqStatusError(Code.CANNOT_REGISTER_DA_QMX_SOFTWARE_EVENT_WHILE_TASK_IS_RUNNING, f"Task: {task.name}")
        if self._like(call, request):
            output = call == "RegisterEveryNSamplesEvent" and task.type in ("AO", "DO")
            code = (
                Code.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_ALREADY_REGISTERED
                if output
                else EVENT_REGISTERED[call]
            )
            raise DaqStatusError(code, f"Task: {task.name}")
        self._registered.append(EventStream(self, call, request, task, is_due))
        return self._registered[-1]

    def unregister(self, call: str, request: Any) -> None:
        """End the stream of an event, named by its Register… call."""
        for stream in self._like(call, request):
            stream.cancel()

    def remove(self, stream: EventStream) -> None:
        """Forget a stream that has ended."""
        if stream in self._registered:
            self._registered.remove(stream)

    def _like(self, call: str, request: Any) -> list[EventStream]:
        return [stream for stream in self._registered if stream.is_of(call, request.task.name)]


class EventStream:
    """One registered event; iterating it gives the responses as they come."""

    def __init__(
        self, streams: EventStreams, call: str, request: Any, task: SimulatedTask, is_due: Callable[[int], bool]
    ) -> None:
        self._streams, self._call, self._request, self._task = streams, call, request, task
        self._is_due = is_due
        self._cancelled = threading.Event()
        self._sent, self._started, self._run = 0, False, task.progress.runs

    def is_of(self, call: str, task_name: str) -> bool:
        """Whether this is the live stream of an event of a task."""
        return self._call == call and self._request.task.name == task_name and not self._cancelled.is_set()

    def cancel(self) -> None:
        """End the stream."""
        self._cancelled.set()
        self._streams.remove(self)

    @property
    def waits(self) -> bool:
        """Whether nothing can be due now: the task has not been started; known without touching the device."""
        if self._started or self._task.state == "running" or self._cancelled.is_set():
            return False
        return self._call != "RegisterDoneEvent" or not self._is_due(self._sent)

    def poll(self) -> tuple[Any | None, bool]:
        """Return the response that is due, or None, and whether the stream has ended with it."""
        device, done_event = self._streams.device, self._call == "RegisterDoneEvent"
        if self._cancelled.is_set():
            return None, True
        with self._streams.lock:
            if device.tasks.get(self._task.name) is not self._task:
                return None, True
            running = self._task.state == "running"
            if self._run != self._task.progress.runs:  # started anew, perhaps between two looks
                self._run, self._sent = self._task.progress.runs, self._sent if done_event else 0
            self._started = running
            due = (self._started or done_event) and self._is_due(self._sent)
            if self._started and not due and self._may_run_ahead(self._sent):
                if device.bench.clock.paced:
                    go_on(device)
                else:
                    advance(device, edges_in(device, STRETCH_S))
                due = self._is_due(self._sent)
            check_watchdogs(device)
        if not due:
            return None, False
        self._sent += 1
        return self._answer(), False

    def __iter__(self) -> Iterator[Any]:
        try:
            while True:
                answer, ended = self.poll()
                if answer is not None:
                    yield answer
                if ended:
                    return
                if answer is None:
                    self._cancelled.wait(POLL_S)
        finally:
            self.cancel()

    def _may_run_ahead(self, sent: int) -> bool:
        task, device = self._task, self._streams.device
        if not task.progress.live or device.bench.clock.paced:
            return task.progress.live
        buffer = task.buffer
        if buffer is not None and self._call != "RegisterEveryNSamplesEvent":
            # another stream announces the samples; only what a reader has room for may come
            return engine_of(device, task) is not None and buffer.available < buffer.size // 2
        if buffer is not None:
            return buffer.read >= sent * int(self._request.n_samples) or buffer.available < int(self._request.n_samples)
        return True

    def _answer(self) -> Any:
        request = self._request
        if self._call == "RegisterEveryNSamplesEvent":
            kind = enum(request, "every_n_samples_event_type")
            return response(
                self._call,
                every_n_samples_event_type_raw=kind,
                every_n_samples_event_type=kind,
                n_samples=request.n_samples,
            )
        if self._call == "RegisterSignalEvent":
            return response(self._call, signal_id=enum(request, "signal_id"))
        return response(self._call, status=self._task.progress.error)


def _every_n(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    kind, n = enum(request, "every_n_samples_event_type"), int(request.n_samples)
    if n < 1:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Task: {task.name}: every {n} samples")
    if kind != (ACQUIRED if task.type in ("AI", "CI", "DI") else TRANSFERRED):
        code = (
            Code.EVERY_N_SAMPLES_ACQ_INTO_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE
            if kind == ACQUIRED
            else Code.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE
        )
        raise DaqStatusError(code, f"Task: {task.name} is {task.type}, event type {kind}")
    return lambda sent: task.total_samples >= (sent + 1) * n


def _done(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    before = task.progress.completed
    return lambda sent: task.progress.completed + int(task.ended) > before + sent


def _signal(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    signal = enum(request, "signal_id")
    if signal == CHANGE_DETECTION and task.timing.change_lines:
        return lambda sent: task.total_samples > sent
    clocked = task.type in ("AI", "AO", "DI", "DO", "CI")
    if (signal == SAMPLE_CLOCK and clocked) or (signal == SAMPLE_COMPLETE and task.type == "AI"):
        # the clock may be set after the event; without one none comes
        return lambda sent: task.timing.clock is not None and not task.timing.change_lines and task.total_samples > sent
    raise NotImplementedByDevice(f"signal event {signal} of a {task.type} task")


EVENTS: dict[str, Callable[[SimulatedTask, Any], Callable[[int], bool]]] = {
    "RegisterEveryNSamplesEvent": _every_n,
    "RegisterDoneEvent": _done,
    "RegisterSignalEvent": _signal,
}
"""Each returns a function that says, given the number of events sent, whether the next one is due."""
UNREGISTER = {call.replace("Register", "Unregister"): call for call in EVENTS}
