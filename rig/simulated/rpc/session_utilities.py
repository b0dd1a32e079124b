"""NI's session utilities: the devices a server has, reservations by which its clients take turns, and its reset.

Place in the data flow: a TCP client that looks for devices, or shares them with others, calls this service beside the
DAQmx one. A reservation is a name the clients agree on; it holds nothing on the device, as on NI's own server, whose
answers and refusals (``session_repository.cpp`` of ni/grpc-device) these are.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rig.simulated.driver.tasks import clear_task
from rig.simulated.rpc.messages import utility_response
from rig.simulated.rpc.service import Service
from rig.simulated.status import NotImplementedByDevice, SessionRefused

LOOK_EVERY_S = 0.02
VENDOR = "National Instruments"


class SessionUtilities:
    """Answers the calls of ``nidevice_grpc.SessionUtilities`` for one served device."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._queues: dict[str, deque[str]] = {}
        """Clients by reservation; the first holds it, the others wait for their turn."""
        self._changed = threading.Condition()
        self._handlers: dict[str, Callable[[Any, Callable[[], bool]], Any]] = {
            "EnumerateDevices": self._devices,
            "Reserve": self._reserve,
            "IsReservedByClient": self._is_reserved,
            "Unreserve": self._unreserve,
            "ResetServer": self._reset,
        }

    def handle(self, call: str, request: Any, wanted: Callable[[], bool]) -> Any:
        """Answer one call; ``wanted`` tells whether the client still waits.

        Raises
        ------
        SessionRefused
            A reservation without a name, held already, or ended by a reset.
        NotImplementedByDevice
            Any other call.
        """
        if call not in self._handlers:
            raise NotImplementedByDevice(call)
        return self._handlers[call](request, wanted)

    def _devices(self, request: Any, wanted: Callable[[], bool]) -> Any:
        found = [
            {"name": name, "model": model, "vendor": VENDOR}
            for name, model in self._service.device.inventory.devices().items()
        ]
        return utility_response("EnumerateDevices", devices=found)

    def _reserve(self, request: Any, wanted: Callable[[], bool]) -> Any:
        name, client = request.reservation_id, request.client_id
        if not (name and client):
            raise SessionRefused("INVALID_ARGUMENT", "reservation_id and client_id must not be empty")
        with self._changed:
            queue = self._queues.setdefault(name, deque())
            if queue and queue[0] == client:
                raise SessionRefused("FAILED_PRECONDITION", f"client {client!r} holds {name!r} already")
            queue.append(client)
            while self._queues.get(name) is queue and queue[0] != client:
                if not wanted():
                    queue.remove(client)
                    raise SessionRefused("CANCELLED", "the client no longer waits")
                self._changed.wait(LOOK_EVERY_S)
            if self._queues.get(name) is not queue:
                raise SessionRefused("ABORTED", f"reservation {name!r} ended: the server was reset")
        return utility_response("Reserve", is_reserved=True)

    def _holds(self, request: Any) -> bool:
        queue = self._queues.get(request.reservation_id)
        return bool(queue) and queue[0] == request.client_id  # type: ignore[index]

    def _is_reserved(self, request: Any, wanted: Callable[[], bool]) -> Any:
        with self._changed:
            return utility_response("IsReservedByClient", is_reserved=self._holds(request))

    def _unreserve(self, request: Any, wanted: Callable[[], bool]) -> Any:
        with self._changed:
            held = self._holds(request)
            if held:
                queue = self._queues[request.reservation_id]
                queue.popleft()
                if not queue:
                    del self._queues[request.reservation_id]
                self._changed.notify_all()
        return utility_response("Unreserve", is_unreserved=held)

    def _reset(self, request: Any, wanted: Callable[[], bool]) -> Any:
        with self._changed:
            self._queues.clear()
            self._changed.notify_all()
        with self._service.exclusive():
            device = self._service.device
            for name in list(device.tasks):  # closing sessions stops their tasks; outputs keep what they hold
                clear_task(device, name)
        return utility_response("ResetServer", is_server_reset=True)
