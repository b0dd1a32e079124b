"""NI's DAQmx RPC service, answered by the virtual device: one handler per call, by the call's name; and its events.

Events are every N samples, done, a signal; each stream is a generator of responses. A channel iterates them in a thread
of its client; a server lets :class:`StreamPump` send all of them from one thread. Waiting for an event lets the bench's
time pass in stretches, as long as the client keeps up: on a virtual clock nothing runs ahead of samples that were
announced and not yet read. A stream ends when its task is cleared, or the client cancels.

An in-process channel or a TCP server hands requests in; both get the same answers. A driver status below zero travels
as the real server sends it (``ni-error`` in the trailing metadata, or a status with partial data for reads that time
out). A call that is not in the tables is refused with the driver's code for what a device does not support.

The in-process ``grpc.Channel`` is the real client on the virtual device without a socket. There are unary calls and
event streams; calls the device does not have are answered with UNIMPLEMENTED.
"""

from __future__ import annotations

import contextlib
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import grpc

from rig.daq.safe_bench import RememberedCalls
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.watchdog import check_watchdogs, refuse_locked
from rig.simulated.driver import find_task
from rig.simulated.rpc.channels import CHANNEL_CALLS
from rig.simulated.rpc.data import DATA_CALLS
from rig.simulated.rpc.device import (
    DEVICE_CALLS,
    DEVICE_PROPERTIES,
    SCALE_CALLS,
    SCALE_PROPERTIES,
    WATCHDOG_CALLS,
    WATCHDOG_PROPERTIES,
)
from rig.simulated.rpc.messages import (
    CALLS,
    REFUSALS,
    DeviceHandler,
    Fields,
    Metadatum,
    Properties,
    TaskHandler,
    attribute_fields,
    attribute_value,
    enum,
    refuse_not_finite,
    response,
    rpc_status,
)
from rig.simulated.rpc.properties import TASK_PROPERTIES, settle_triggers
from rig.simulated.rpc.task import TASK_CALLS, TIMING_CALLS, settle_logging
from rig.simulated.status import (
    EVENT_REGISTERED,
    Code,
    DaqStatusError,
    NotImplementedByDevice,
    SessionRefused,
    Unsupported,
)
from rig.simulated.timing import advance, edges_in, engine_of, go_on, let_pass, question_asked

ACQUIRED, TRANSFERRED = 1, 2
SAMPLE_CLOCK, CHANGE_DETECTION, SAMPLE_COMPLETE = 12487, 12511, 12530
POLL_S = 0.002
STRETCH_S = 0.01


class EventStream:
    """One registered event; iterating it gives the responses as they come."""

    def __init__(
        self, service: Service, call: str, request: Any, task: SimulatedTask, is_due: Callable[[int], bool]
    ) -> None:
        self._service, self._call, self._request, self._task = service, call, request, task
        self._is_due = is_due
        self._cancelled = threading.Event()
        self._sent, self._started, self._run = 0, False, task.progress.runs

    def is_of(self, call: str, task_name: str) -> bool:
        """Whether this is the live stream of an event of a task."""
        return self._call == call and self._request.task.name == task_name and not self._cancelled.is_set()

    def cancel(self) -> None:
        """End the stream."""
        self._cancelled.set()
        with contextlib.suppress(ValueError):  # it has ended already
            self._service.registered.remove(self)

    def initial_metadata(self) -> tuple[Metadatum, ...]:
        """Return the metadata that tells an in-process client that the event is registered."""
        return ()

    def done(self) -> bool:
        """Whether the stream failed while it was registered; it would have raised."""
        return False

    @property
    def waits(self) -> bool:
        """Whether nothing can be due now: the task has not been started; known without touching the device."""
        if self._started or self._task.state == "running" or self._cancelled.is_set():
            return False
        return self._call != "RegisterDoneEvent" or not self._is_due(self._sent)

    def poll(self) -> tuple[Any | None, bool]:
        """Return the response that is due, or None, and whether the stream has ended with it."""
        device, done_event = self._service.device, self._call == "RegisterDoneEvent"
        if self._cancelled.is_set():
            return None, True
        with self._service.exclusive():
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
                with _as_rpc_errors():
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
        task, device = self._task, self._service.device
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


_ATTRIBUTE_CALL = re.compile(r"(Get|Set|Reset)(\w+?)Attribute\w*")
_QUESTION = re.compile(r"IsTaskDone|Get(Read|Write)Attribute\w+|Get(Chan|Task)Attribute(Bool|UInt32)")
"""Calls that ask how far a task is."""
TRACE_LENGTH = 100_000


class Service:
    """Answers the calls of a DAQmx client from one virtual device; calls are handled one at a time."""

    def __init__(self, device: DeviceState) -> None:
        self.device = device
        self.trace: list[str] = []
        """Names of the calls answered, the last 50,000 at least."""
        self.waiting = 0
        """Calls that have not been answered yet."""
        self._lock = threading.RLock()
        self._caller = threading.local()
        self.registered: list[EventStream] = []
        """Events that clients wait for."""
        device.let_clients_call = self._let_clients_call
        device.settle_settings = _settle

    def exclusive(self) -> AbstractContextManager[bool]:
        """Keep clients waiting while the device is inspected or changed from outside."""
        return self._lock

    def _let_clients_call(self) -> None:
        """Let other clients and the watchdogs have a turn while time passes in one call; end that of a dead client."""
        check_watchdogs(self.device)
        self._lock.release()
        self._lock.acquire()
        waits = getattr(self._caller, "waits", None)
        if waits is not None and not waits():
            raise SessionRefused("CANCELLED", "the client no longer waits")

    def handle(self, call: str, request: Any, is_waiting: Callable[[], bool] | None = None) -> Any:
        """Answer one call; ``is_waiting`` tells whether the client still waits for it.

        Raises
        ------
        DaqStatusError
            When the device refuses, with the driver's status code.
        NotImplementedByDevice
            When the virtual device does not have the call.
        """
        self._caller.waits = is_waiting
        with self._waiting(), self._lock:
            if self.device.call_delay_s > 0:
                let_pass(self.device, self.device.call_delay_s)
            check_watchdogs(self.device)
            refuse_locked(self.device, call)
            self.device.faults.before_call(call, self.device, getattr(request, "timeout", 0.0))
            self._remember(call)
            go_on(self.device)
            if _QUESTION.fullmatch(call):
                question_asked(self.device, again=bool(_QUESTION.fullmatch((self.trace[-2:-1] or [""])[0])))
            return response(call, **(self._answer(call, request) or {}))

    @contextmanager
    def _waiting(self) -> Iterator[None]:
        self.waiting += 1
        try:
            yield
        finally:
            self.waiting -= 1

    def _answer(self, call: str, request: Any) -> Fields | None:
        device = self.device
        if call.startswith(("Create", "Cfg", "Set")):
            refuse_not_finite(request)
        if call in _DEVICE_CALLS:
            return _DEVICE_CALLS[call](device, request)
        if call in UNREGISTER:
            for stream in self._like(UNREGISTER[call], request):
                stream.cancel()
            return None
        if call in _TASK_CALLS:
            return _TASK_CALLS[call](device, find_task(device, request.task.name), request)
        match = _ATTRIBUTE_CALL.fullmatch(call)
        if match and call in CALLS and match[2] in _PROPERTIES:
            return self._attribute(call, match[1], match[2], request)
        if call.startswith("CreateAI") and call in CALLS:  # a missing device is refused before the measurement
            named = getattr(request, "physical_channel", "") or getattr(request, "voltage_physical_channel", "")
            device.inventory.channel(named, "voltage_in")
        raise NotImplementedByDevice(call, _refusal_of(call))

    def stream(self, call: str, request: Any) -> EventStream:
        """Register an event of a task that does not run yet, one of each kind a task; return its stream.

        Raises as :meth:`handle`.
        """
        with self._lock:
            self.device.faults.before_call(call, self.device)
            self._remember(call)
            if call not in EVENTS:
                raise NotImplementedByDevice(call)
            task = find_task(self.device, request.task.name)
            is_due, detail = EVENTS[call](task, request), f"Task: {task.name}"
            if task.state == "running":
                raise DaqStatusError(Code.CANNOT_REGISTER_DA_QMX_SOFTWARE_EVENT_WHILE_TASK_IS_RUNNING, detail)
            if self._like(call, request):
                if call == "RegisterEveryNSamplesEvent" and task.type in ("AO", "DO"):
                    raise DaqStatusError(Code.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_ALREADY_REGISTERED, detail)
                raise DaqStatusError(EVENT_REGISTERED[call], detail)
            self.registered.append(EventStream(self, call, request, task, is_due))
            return self.registered[-1]

    def _like(self, call: str, request: Any) -> list[EventStream]:
        return [stream for stream in self.registered if stream.is_of(call, request.task.name)]

    def _remember(self, call: str) -> None:
        self.trace.append(sys.intern(call))
        if len(self.trace) > TRACE_LENGTH:
            del self.trace[: TRACE_LENGTH // 2]

    def _attribute(self, call: str, action: str, category: str, request: Any) -> Fields | None:
        properties, key = _PROPERTIES[category], (category, enum(request, "attribute"))
        if action == "Get":
            if (value := properties.get(self.device, request, key)) is None:
                raise Unsupported(f"Property: 0x{key[1]:04X} ({category})")
            return attribute_fields(call, value)
        if action == "Set" and properties.put is not None:
            properties.put(self.device, request, key, attribute_value(request))
        elif action == "Reset" and properties.reset is not None:
            properties.reset(self.device, request, key)
        else:
            raise NotImplementedByDevice(call)
        return None


def _settle(device: DeviceState, task: SimulatedTask) -> None:
    """Take over what a client has set of triggers and logging, before a task is verified."""
    settle_triggers(device, task)
    settle_logging(task)


def _refusal_of(call: str) -> int:
    """Return the driver's code for a call that the virtual device does not have."""
    if created := re.fullmatch(r"Create(AI|CI|DI|AO|CO|DO)\w+", call):
        return Code.PHYS_CHAN_MEAS_TYPE if created[1] in ("AI", "CI", "DI") else Code.PHYS_CHAN_OUTPUT_TYPE
    return Code.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT


_DEVICE_CALLS: dict[str, DeviceHandler] = {**DEVICE_CALLS, **SCALE_CALLS, **WATCHDOG_CALLS}
_TASK_CALLS: dict[str, TaskHandler] = {**TASK_CALLS, **CHANNEL_CALLS, **TIMING_CALLS, **DATA_CALLS}
_PROPERTIES: dict[str, Properties] = {
    **DEVICE_PROPERTIES,
    "Scale": SCALE_PROPERTIES,
    "Watchdog": WATCHDOG_PROPERTIES,
    **dict.fromkeys(("Task", "Timing", "Read", "Write", "Buffer", "Chan", "Trig", "ExportedSignal"), TASK_PROPERTIES),
}
"""Properties by the category in the names of their calls."""


class InProcessError(grpc.RpcError):
    """What a failed call raises: status, text and trailing metadata, as over a socket."""

    def __init__(self, code: grpc.StatusCode, details: str, metadata: tuple[Metadatum, ...] = ()) -> None:
        super().__init__(details)
        self._code, self._details, self._metadata = code, details, metadata

    def code(self) -> grpc.StatusCode:
        """Return the gRPC status."""
        return self._code

    def details(self) -> str:
        """Return the text."""
        return self._details

    def trailing_metadata(self) -> tuple[Metadatum, ...]:
        """Return the trailing metadata."""
        return self._metadata


@contextlib.contextmanager
def _as_rpc_errors() -> Iterator[None]:
    try:
        yield
    except REFUSALS as error:
        raise InProcessError(*rpc_status(error)) from None


def in_process_channel(service: Service) -> RememberedCalls:
    """Return a channel to a service in the same process; closing it leaves the device as it is, to be inspected."""
    answers = {"unary_unary": "handle", "unary_stream": "stream"}

    def make(kind: str, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        def call(request: Any, timeout: float | None = None, metadata: Any = None, **options: Any) -> Any:
            if kind not in answers:  # NI's service has no streams of requests
                raise InProcessError(grpc.StatusCode.UNIMPLEMENTED, f"not simulated: {method}")
            with _as_rpc_errors():
                return getattr(service, answers[kind])(method.rsplit("/", 1)[-1], request)

        return call

    return RememberedCalls(make)
