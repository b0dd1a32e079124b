"""NI's session utilities: the devices a server has, reservations by which its clients take turns, and its reset.

A TCP client that enumerates devices, or shares them with others, calls this service beside the DAQmx one. A reservation
is a name the clients agree on; it reserves nothing on the device. Answers and refusals are those of NI's own server
(``session_repository.cpp`` of ni/grpc-device).
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.simulated.driver.tasks import clear_task
from rig.simulated.rpc.handlers import Fields
from rig.simulated.rpc.messages import utility_response
from rig.simulated.rpc.service import Service
from rig.simulated.status import NotImplementedByDevice, SessionRefused

POLL_S = 0.02
VENDOR = "National Instruments"


@dataclass(eq=False)
class _Call:
    """A client's call for a reservation; one that has ended must not be taken for a later one of the same client."""

    client: str
    granted: bool = False


class SessionUtilities:
    """Answers the calls of ``nidevice_grpc.SessionUtilities`` for one served device."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._queues: dict[str, deque[_Call]] = {}
        """Calls by reservation; the first has it once it is granted, the others wait for their turn."""
        self._changed = threading.Condition()
        self._handlers: dict[str, Callable[[Any], Fields]] = {
            "EnumerateDevices": self._devices,
            "IsReservedByClient": self._is_reserved,
            "Unreserve": self._unreserve,
            "ResetServer": self._reset,
        }

    def handle(self, call: str, request: Any, is_waiting: Callable[[], bool]) -> Any:
        """Answer one call; ``is_waiting`` tells whether the client still waits.

        Raises
        ------
        SessionRefused
            A reservation without a name, one the client has already, or one ended by a reset.
        NotImplementedByDevice
            Any other call.
        """
        if call == "Reserve":
            return utility_response(call, **self._reserve(request, is_waiting))
        if call not in self._handlers:
            raise NotImplementedByDevice(call)
        return utility_response(call, **self._handlers[call](request))

    def _devices(self, request: Any) -> Fields:
        devices = self._service.device.inventory.devices()
        return {"devices": [{"name": name, "model": model, "vendor": VENDOR} for name, model in devices.items()]}

    def _reserve(self, request: Any, is_waiting: Callable[[], bool]) -> Fields:
        name, client = request.reservation_id, request.client_id
        if not (name and client):
            raise SessionRefused("INVALID_ARGUMENT", "reservation_id and client_id must not be empty")
        with self._changed:
            queue = self._queues.setdefault(name, deque())
            if self._holds(request):
                raise SessionRefused("FAILED_PRECONDITION", f"client {client!r} holds {name!r} already")
            mine = _Call(client)
            queue.append(mine)
            while self._queues.get(name) is queue and queue[0] is not mine and is_waiting():
                self._changed.wait(POLL_S)
            if self._queues.get(name) is not queue:
                raise SessionRefused("ABORTED", f"reservation {name!r} ended: the server was reset")
            if queue[0] is not mine or not is_waiting():  # a call that nobody waits for takes nothing
                self._leave(name, mine)
                raise SessionRefused("CANCELLED", "the client no longer waits")
            mine.granted = True
        return {"is_reserved": True}

    def _leave(self, name: str, call: _Call) -> None:
        queue = self._queues[name]
        queue.remove(call)
        if not queue:
            del self._queues[name]
        self._changed.notify_all()

    def _holds(self, request: Any) -> bool:
        queue = self._queues.get(request.reservation_id)
        return bool(queue) and queue[0].granted and queue[0].client == request.client_id  # type: ignore[index]

    def _is_reserved(self, request: Any) -> Fields:
        with self._changed:
            return {"is_reserved": self._holds(request)}

    def _unreserve(self, request: Any) -> Fields:
        with self._changed:
            reserved = self._holds(request)
            if reserved:
                self._leave(request.reservation_id, self._queues[request.reservation_id][0])
        return {"is_unreserved": reserved}

    def _reset(self, request: Any) -> Fields:
        with self._changed:
            self._queues.clear()
            self._changed.notify_all()
        with self._service.exclusive():
            device = self._service.device
            for name in list(device.tasks):  # closing sessions stops their tasks; outputs stay at their values
                clear_task(device, name)
        return {"is_server_reset": True}
