"""NI's DAQmx RPC service, answered by the virtual device: one handler per call, by the call's name.

An in-process channel or a TCP server hands requests in; both get the same answers. A driver status below zero travels
as the real server sends it (``ni-error`` in the trailing metadata, or a status with partial data for reads that time
out). A call that is not in the tables is refused with the driver's code for what a device does not support.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.watchdog import check_watchdogs, refuse_locked
from rig.simulated.driver import find_task
from rig.simulated.rpc.calls.channels import CHANNEL_CALLS
from rig.simulated.rpc.calls.data import DATA_CALLS
from rig.simulated.rpc.calls.device import DEVICE_CALLS, DEVICE_PROPERTIES
from rig.simulated.rpc.calls.scales import SCALE_CALLS, SCALE_PROPERTIES
from rig.simulated.rpc.calls.task import TASK_CALLS, settle_logging
from rig.simulated.rpc.calls.timing import TIMING_CALLS
from rig.simulated.rpc.calls.watchdog import WATCHDOG_CALLS, WATCHDOG_PROPERTIES
from rig.simulated.rpc.event_streams import EVENTS, UNREGISTER, EventStream, EventStreams
from rig.simulated.rpc.messages import (
    CALLS,
    DeviceHandler,
    Fields,
    Properties,
    TaskHandler,
    attribute_fields,
    attribute_value,
    enum,
    refuse_not_finite,
    response,
)
from rig.simulated.rpc.properties.task import TASK_PROPERTIES, settle_triggers
from rig.simulated.status import Code, NotImplementedByDevice, SessionRefused, Unsupported
from rig.simulated.timing import go_on, let_pass, question_asked

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
        self._events = EventStreams(device, self._lock)
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
            self._events.unregister(UNREGISTER[call], request)
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
        """Register an event and return the stream of its responses; raises as :meth:`handle`."""
        with self._lock:
            self.device.faults.before_call(call, self.device)
            self._remember(call)
            if call not in EVENTS:
                raise NotImplementedByDevice(call)
            return self._events.register(call, request)

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
