"""NI's DAQmx RPC service, answered by the virtual device: one handler per call, by the call's name."""

from __future__ import annotations

import contextlib
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import grpc

from rig.daq.safe_bench import RememberedCalls
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import check_watchdogs, refuse_locked
from rig.simulated.driver import clear_task, find_task
from rig.simulated.rpc.calls import DEVICE_CALLS, PROPERTIES, TASK_CALLS
from rig.simulated.rpc.messages import (
    CALLS,
    REFUSALS,
    Fields,
    Metadatum,
    attribute_fields,
    attribute_value,
    enum,
    property_name,
    refuse_not_finite,
    request_class,
    response,
    rpc_status,
)
from rig.simulated.status import NotAnswered, SessionRefused, Unsupported
from rig.simulated.timing import let_pass, pass_due_time, question_asked

_ATTRIBUTE_CALL = re.compile(r"(Get|Set)(\w+?)Attribute\w*")
_QUESTION = re.compile(r"IsTaskDone|Get(Read|Write)Attribute\w+")
"""Calls that ask how far a task is."""
TRACE_LENGTH = 100_000
RESET_SERVER = "/nidevice_grpc.SessionUtilities/ResetServer"
_WAS_RESET = b"\x08\x01"
"""The response of that call, ``is_server_reset`` true."""
BEHIND_S = 0.05  # time a client may leave to pass before the bench goes on without it


class Service:
    """Answers the calls of a DAQmx client from one virtual device; calls are handled one at a time."""

    def __init__(self, device: DeviceState) -> None:
        self.device = device
        self.trace: list[str] = []
        """Names of the calls answered, the last 50,000 at least."""
        self._lock = threading.RLock()
        self._caller = threading.local()
        device.let_clients_call = self._let_clients_call

    def exclusive(self) -> AbstractContextManager[bool]:
        """Keep clients waiting while the device is inspected or changed from outside."""
        return self._lock

    def let_time_pass(self) -> None:
        """Let the watchdogs, and a bench that no client asks, go on; a server calls this every 10 ms."""
        with self._lock:
            check_watchdogs(self.device)
            if self.device.bench.clock.due_s > BEHIND_S:
                pass_due_time(self.device)

    def _let_clients_call(self) -> None:
        """Let other clients and the watchdogs have a turn while time passes in one call; end that of a dead client."""
        check_watchdogs(self.device)
        self._lock.release()
        self._lock.acquire()
        waits = getattr(self._caller, "waits", None)
        if waits is not None and not waits():
            raise SessionRefused("CANCELLED", "the client no longer waits")

    def handle(self, call: str, request: Any, is_waiting: Callable[[], bool] | None = None) -> Any:
        """Answer one call, by NI's name: return the response message to the ``request`` message, after due watchdogs,
        delays and planted faults; a refusal is raised. ``is_waiting`` is asked while time passes: False ends the call.
        """
        self._caller.waits = is_waiting
        with self._lock:
            if self.device.call_delay_s > 0:
                let_pass(self.device, self.device.call_delay_s)
            check_watchdogs(self.device)
            refuse_locked(self.device, call)
            self.device.faults.raise_due(call, self.device, getattr(request, "timeout", 0.0))
            self._remember(call)
            pass_due_time(self.device)
            if _QUESTION.fullmatch(call):
                question_asked(self.device, again=bool(_QUESTION.fullmatch((self.trace[-2:-1] or [""])[0])))
            return response(call, **(self._answer(call, request) or {}))

    def answer(self, method: str, request: bytes, is_waiting: Callable[[], bool] | None = None) -> bytes:
        """Answer one call as it comes over a network: ``method`` is its gRPC path, request and response are serialised
        messages; refusals are raised as gRPC errors. The reset of the server is answered too: it clears every task."""
        call = method.rsplit("/", 1)[-1]
        with _as_rpc_errors():
            if method == RESET_SERVER:
                with self._lock:
                    for name in list(self.device.tasks):  # ending the sessions stops their tasks; outputs stay
                        clear_task(self.device, name)
                return _WAS_RESET
            if call not in CALLS:
                raise NotAnswered(method)
            message = self.handle(call, request_class(call).FromString(request), is_waiting)
            return bytes(message.SerializeToString())

    def _answer(self, call: str, request: Any) -> Fields | None:
        """Fields of a call's answer; None where it answers nothing. Refuses calls that are not simulated."""
        device = self.device
        if call.startswith(("Create", "Cfg", "Set")):
            refuse_not_finite(request)
        if call in DEVICE_CALLS:
            return DEVICE_CALLS[call](device, request)
        if call in TASK_CALLS:
            return TASK_CALLS[call](device, find_task(device, request.task.name), request)
        if match := _ATTRIBUTE_CALL.fullmatch(call):
            return self._answer_property(call, match[1], match[2], request)
        raise NotAnswered(call)

    def _answer_property(self, call: str, action: str, category: str, request: Any) -> Fields | None:
        """Get or set, by ``action``, the property whose number the request gives, of NI's ``category`` such as
        ``Read``; return the answer's fields, None after a set. Refuse one that is not simulated, or that the task does
        not have."""
        number = enum(request, "attribute")
        answer = PROPERTIES.get((category, number))
        if answer is None or (action == "Set" and answer.put is None):
            raise NotAnswered(f"{call} of {property_name(category, number)}")
        if action == "Set":
            assert answer.put is not None
            answer.put(self.device, find_task(self.device, request.task.name), request, attribute_value(request))
            return None
        if (value := answer.get(self.device, request)) is None:
            raise Unsupported(f"{call} of {property_name(category, number)}")
        return attribute_fields(call, value)

    def _remember(self, call: str) -> None:
        self.trace.append(sys.intern(call))
        if len(self.trace) > TRACE_LENGTH:
            del self.trace[: TRACE_LENGTH // 2]


class InProcessError(grpc.RpcError):
    """What a failed call raises: status, text and trailing metadata, as over a socket."""

    def __init__(self, code: grpc.StatusCode, details: str, metadata: tuple[Metadatum, ...] = ()) -> None:
        super().__init__(details)
        self._code, self._details, self._metadata = code, details, metadata

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._details

    def trailing_metadata(self) -> tuple[Metadatum, ...]:
        return self._metadata


@contextlib.contextmanager
def _as_rpc_errors() -> Iterator[None]:
    try:
        yield
    except REFUSALS as error:
        raise InProcessError(*rpc_status(error)) from None


def in_process_channel(service: Service) -> RememberedCalls:
    """Return a channel to a service in the same process; closing it leaves the device as it is, to be inspected."""

    def make(kind: str, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        def call(request: Any, timeout: float | None = None, metadata: Any = None, **options: Any) -> Any:
            with _as_rpc_errors():
                return service.handle(method.rsplit("/", 1)[-1], request)

        return call

    return RememberedCalls(make)
