"""Event streams of a DAQmx client: every N samples, done, a signal; each a generator of responses.

Place in the data flow: channel or server iterate; waiting for an event lets the bench's time pass in stretches, as
long as the client keeps up: on a virtual clock nothing runs ahead of samples that were announced and not yet read. A
stream ends when its task is cleared, or the client cancels.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from rig.simulated import status
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.timing_engines import engine_of
from rig.simulated.messages import enum, response
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

if TYPE_CHECKING:
    from rig.simulated.rpc.service import Service

ACQUIRED, TRANSFERRED = 1, 2
SAMPLE_CLOCK, CHANGE_DETECTION = 12487, 12511
POLL_S = 0.002
STRETCH_S = 0.01


class EventStream:
    """One registered event; iterating it gives the responses as they come."""

    def __init__(self, service: Service, call: str, request: Any) -> None:
        self._service, self._call, self._request = service, call, request
        self._cancelled = threading.Event()
        self._task = service.device.task(request.task.name)
        self._due = EVENTS[call](self._task, request)
        if self._task.state == "running":
            raise DaqStatusError(status.EVENT_WHILE_RUNNING, f"Task: {self._task.name}")
        if any(stream.is_like(call, request) for stream in service.streams):
            raise DaqStatusError(status.EVENT_REGISTERED[call], f"Task: {self._task.name}")
        service.streams.append(self)

    def is_like(self, call: str, request: Any) -> bool:
        """Whether this is the stream of the same event of the same task."""
        return self._call == call and self._request.task.name == request.task.name and not self._cancelled.is_set()

    def cancel(self) -> None:
        """End the stream."""
        self._cancelled.set()
        if self in self._service.streams:
            self._service.streams.remove(self)

    def __iter__(self) -> Iterator[Any]:
        sent, started = 0, False
        try:
            while not self._cancelled.is_set():
                with self._service.alone():
                    device = self._service.device
                    if device.tasks.get(self._task.name) is not self._task:
                        return
                    running = self._task.state == "running"
                    if started and not running and self._call != "RegisterDoneEvent":
                        sent, started = 0, False  # stopped; it may be started anew
                    started = started or running
                    due = self._due(sent) if started else False
                    if started and not due and self._may_run_ahead(sent):
                        device.advance(max(int(STRETCH_S * device.bench.rate_hz), 1))
                        due = self._due(sent)
                    device.watchdogs.look()
                if due:
                    sent += 1
                    yield self._answer()
                    if self._call == "RegisterDoneEvent":
                        return
                else:
                    self._cancelled.wait(POLL_S)
        finally:
            self.cancel()

    def _may_run_ahead(self, sent: int) -> bool:
        task, device = self._task, self._service.device
        if not task.live or device.bench.clock.paced:
            return task.live
        buffer = task.buffer
        if buffer is not None and self._call != "RegisterEveryNSamplesEvent":
            # somebody else announces the samples; only what has a reader's room may come
            return engine_of(device, task) is not None and buffer.available < buffer.size // 2
        if buffer is not None:
            return buffer.read >= sent * int(self._request.n_samples) or buffer.available < int(self._request.n_samples)
        return True

    def _answer(self) -> Any:
        request = self._request
        if self._call == "RegisterEveryNSamplesEvent":
            return response(
                self._call,
                every_n_samples_event_type_raw=enum(request, "every_n_samples_event_type"),
                every_n_samples_event_type=enum(request, "every_n_samples_event_type"),
                n_samples=request.n_samples,
            )
        if self._call == "RegisterSignalEvent":
            return response(self._call, signal_id=enum(request, "signal_id"))
        return response(self._call, status=self._task.error)


def _every_n(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    kind, n = enum(request, "every_n_samples_event_type"), int(request.n_samples)
    if task.clock is None or n < 1:
        raise DaqStatusError(status.INVALID_VALUE, f"Task: {task.name}: every {n} samples")
    if kind != (ACQUIRED if task.type in ("AI", "CI", "DI") else TRANSFERRED):
        raise DaqStatusError(status.INVALID_VALUE, f"Task: {task.name} is {task.type}, event type {kind}")
    return lambda sent: task.so_far >= (sent + 1) * n


def _done(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    return lambda sent: bool(task.error) or task.done


def _signal(task: SimulatedTask, request: Any) -> Callable[[int], bool]:
    signal = enum(request, "signal_id")
    if signal == CHANGE_DETECTION and task.changes:
        return lambda sent: task.so_far > sent
    if signal == SAMPLE_CLOCK and task.clock is not None and not task.changes:
        return lambda sent: task.so_far > sent
    raise NotImplementedByDevice(f"signal event {signal} of a {task.type} task")


EVENTS: dict[str, Callable[[SimulatedTask, Any], Callable[[int], bool]]] = {
    "RegisterEveryNSamplesEvent": _every_n,
    "RegisterDoneEvent": _done,
    "RegisterSignalEvent": _signal,
}
"""Each returns a function that tells, from the number of events sent, whether the next one is due."""
UNREGISTER = {call.replace("Register", "Unregister"): call for call in EVENTS}
