"""The virtual device over TCP, as a client of the NI gRPC Device Server sees it; on the loopback by default.

Event streams of all clients are sent from one thread, so that no stream occupies a worker. A client that enumerates
devices, or shares them with others, calls NI's session utilities beside the DAQmx service: the devices a server has,
reservations by which its clients take turns, and its reset. A reservation is a name the clients agree on; it reserves
nothing on the device. Answers and refusals are those of NI's own server (``session_repository.cpp`` of ni/grpc-device).

``pianorig serve-sim`` calls :func:`serve_until_interrupted`. Every 10 ms it checks the
watchdogs, whether or not a client calls, so that outputs become safe when the client is dead, and lets the device go
on while no client waits; and it can report to an observer, one line per change, whether the motor's output is live.
"""

from __future__ import annotations

import contextlib
import ipaddress
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import grpc

from rig.configuration.rig_file import load_rig
from rig.errors import HardwareFault, RigInputError
from rig.safety.interrupts import termination_as_interrupt
from rig.simulated.backend import open_backend
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import clear_task
from rig.simulated.rpc.messages import (
    CALLS,
    REFUSALS,
    SERVICE,
    UTILITIES,
    UTILITY_CALLS,
    Fields,
    request_class,
    response,
    rpc_status,
)
from rig.simulated.rpc.service import EVENTS, POLL_S, EventStream, Service
from rig.simulated.status import NotImplementedByDevice, SessionRefused
from rig.simulated.timing import go_on

BUSY = 0.25
"""Part of the time that looking at the streams may take: with many of them each is looked at less often."""


class StreamPump:
    """The streams of a server; its thread begins with the first one."""

    def __init__(self) -> None:
        self._streams: dict[EventStream, Callable[[Any], None]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def add(self, stream: EventStream, send: Callable[[Any], None]) -> None:
        """Send a stream's responses with ``send`` as they come, and None after the last."""
        with self._changed:
            self._streams[stream] = send
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="event streams", daemon=True)
                self._thread.start()
            self._changed.notify()

    def remove(self, stream: EventStream) -> None:
        """End a stream whose client is gone, or that has ended."""
        stream.cancel()
        with self._changed:
            self._streams.pop(stream, None)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._streams:
                    self._changed.wait()
                streams = list(self._streams.items())
            began = time.perf_counter()
            for stream, send in streams:
                if not stream.waits:
                    self._serve(stream, send)
            time.sleep(max(POLL_S, (time.perf_counter() - began) * (1 / BUSY - 1)))

    def _serve(self, stream: EventStream, send: Callable[[Any], None]) -> None:
        answer, ended = stream.poll()
        while answer is not None:
            send(answer)
            if ended:
                break
            answer, ended = stream.poll()
        if ended:
            self.remove(stream)
            send(None)


RESERVED_POLL_S = 0.02
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
        self._handlers: dict[str, Callable[[Any, Callable[[], bool]], Fields]] = {
            "Reserve": self._reserve,
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
        if call not in self._handlers:
            raise NotImplementedByDevice(call)
        return response(call, **self._handlers[call](request, is_waiting))

    def _devices(self, request: Any, is_waiting: Callable[[], bool]) -> Fields:
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
                self._changed.wait(RESERVED_POLL_S)
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

    def _is_reserved(self, request: Any, is_waiting: Callable[[], bool]) -> Fields:
        with self._changed:
            return {"is_reserved": self._holds(request)}

    def _unreserve(self, request: Any, is_waiting: Callable[[], bool]) -> Fields:
        with self._changed:
            reserved = self._holds(request)
            if reserved:
                self._leave(request.reservation_id, self._queues[request.reservation_id][0])
        return {"is_unreserved": reserved}

    def _reset(self, request: Any, is_waiting: Callable[[], bool]) -> Fields:
        with self._changed:
            self._queues.clear()
            self._changed.notify_all()
        with self._service.exclusive():
            device = self._service.device
            for name in list(device.tasks):  # closing sessions stops their tasks; outputs stay at their values
                clear_task(device, name)
        return {"is_server_reset": True}


WORKERS = 128
"""Calls at once, e.g. reads that wait; event streams take none."""
MOST_BYTES = 64 * 2**20
"""Largest message a client may send: 8 million samples."""
KEEPALIVE_S, GONE_S = 10, 5
"""A client is asked for a sign of life after so long, and given up, with its calls and streams, after so long more."""


@dataclass(frozen=True)
class Tls:
    """PEM files of the server's certificate and key; with ``client_ca`` clients must show a certificate of that CA."""

    certificate: Path
    key: Path
    client_ca: Path | None = None

    def credentials(self) -> grpc.ServerCredentials:
        """Read the files; raises RigInputError when one cannot be read."""
        try:
            pair = (self.key.read_bytes(), self.certificate.read_bytes())
            ca = self.client_ca.read_bytes() if self.client_ca is not None else None
        except OSError as error:
            raise RigInputError(f"TLS of the server: {error}") from None
        return grpc.ssl_server_credentials([pair], root_certificates=ca, require_client_auth=ca is not None)


class _Handler(grpc.GenericRpcHandler):
    def __init__(self, service: Service) -> None:
        self._service = service
        self._utilities = SessionUtilities(service)
        self._pump = StreamPump()

    def service(self, handler_call_details: Any) -> grpc.RpcMethodHandler | None:
        prefix, _, call = handler_call_details.method.lstrip("/").partition("/")
        if call not in {SERVICE: CALLS, UTILITIES: UTILITY_CALLS}.get(prefix, ()):
            return None  # gRPC itself answers UNIMPLEMENTED
        handle = self._service.handle if prefix == SERVICE else self._utilities.handle

        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            with _aborting(context):
                return handle(call, request, context.is_active)

        def events(request: Any, context: grpc.ServicerContext, send_response_callback: Callable[[Any], None]) -> None:
            with _aborting(context):
                stream = self._service.stream(call, request)
                context.add_callback(lambda: self._pump.remove(stream))
                context.send_initial_metadata(())  # the client waits for it before it starts the task
                self._pump.add(stream, send_response_callback)

        # as in gRPC's own health service: the call returns, its responses are sent later from another thread
        events.experimental_non_blocking = True  # type: ignore[attr-defined]

        kind = grpc.unary_stream_rpc_method_handler if call in EVENTS else grpc.unary_unary_rpc_method_handler
        return kind(
            events if call in EVENTS else answer,
            request_deserializer=request_class(call).FromString,
            response_serializer=lambda message: bytes(message.SerializeToString()),
        )


@contextlib.contextmanager
def _aborting(context: grpc.ServicerContext) -> Iterator[None]:
    try:
        yield
    except REFUSALS as error:
        code, details, metadata = rpc_status(error)
        context.set_trailing_metadata(metadata)
        context.abort(code, details)


def serve(
    service: Service, *, host: str = "127.0.0.1", port: int = 0, tls: Tls | None = None
) -> tuple[grpc.Server, int]:
    """Start a server for the virtual device; returns (server, port). Port 0 takes a free one.

    Raises
    ------
    RigInputError
        When a file of ``tls`` cannot be read.
    HardwareFault
        When the address cannot be bound.
    """
    # without the second option two servers may share a port on Linux, and a client talk to either
    options = [
        ("grpc.max_receive_message_length", MOST_BYTES),
        ("grpc.max_send_message_length", -1),
        ("grpc.so_reuseport", 0),
        ("grpc.keepalive_time_ms", 1000 * KEEPALIVE_S),
        ("grpc.keepalive_timeout_ms", 1000 * GONE_S),
    ]
    server = grpc.server(ThreadPoolExecutor(max_workers=WORKERS), options=options)
    server.add_generic_rpc_handlers((_Handler(service),))
    try:
        if tls is None:
            bound = server.add_insecure_port(f"{host}:{port}")
        else:
            bound = server.add_secure_port(f"{host}:{port}", tls.credentials())
    except RuntimeError as error:
        raise HardwareFault(f"{host}:{port} cannot be bound; another program may use it", phase="connect") from error
    server.start()
    return server, bound


CHECK_EVERY_S = 0.01
BEHIND_S = 0.05
"""Time a client may leave to pass before the bench goes on without it."""


@dataclass(frozen=True)
class ServeOptions:
    """Which bench is served, and where; the options of a ``sim://`` address beside rig file, host and port."""

    rig: str | Path = "virtual"
    host: str = "127.0.0.1"
    port: int = 31763
    """0 takes a free one."""
    clock: str = "real"
    seed: int | None = None
    bench: Path | None = None
    fault: str | None = None
    hand: bool = False
    """Whether the virtual operator acts in a self-test."""
    allow_network: bool = False
    """Whether others than this computer may be let in."""
    tls: Tls | None = None
    felt: str | None = None
    """What is under the arm in place of the key: the felt of a contact, or ``block``."""

    @property
    def on_network(self) -> bool:
        """Whether the address can be reached from other computers."""
        try:
            return not ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return self.host.lower() != "localhost"

    @property
    def address(self) -> str:
        """The ``sim://`` address of the bench."""
        options = {
            "clock": self.clock, "seed": self.seed, "bench": self.bench, "fault": self.fault,
            "hand": "yes" if self.hand else None, "felt": self.felt,
        }  # fmt: skip
        return "sim://?" + urlencode({key: value for key, value in options.items() if value is not None})


def output_state(device: DeviceState) -> dict[str, object]:
    """Return what decides whether the motor can move: volts (live or not), drive, watchdog; and the trial."""
    return {
        "trial": device.trial,
        "motor": "live" if device.output_v.get(device.motor, 0.0) != 0.0 else "0 V",
        "drive": "enabled" if device.drive_enabled() else "disabled",
        "watchdog": "tripped" if any(timer.expired for timer in device.watchdogs.values()) else "quiet",
    }


def serve_until_interrupted(
    options: ServeOptions,
    announce: Callable[[str, str, str], None],
    report: Callable[[dict[str, object]], None] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the virtual device of a rig file until Ctrl-C, SIGTERM or ``stop``.

    Parameters
    ----------
    options : ServeOptions
        Bench and address.
    announce : callable
        Called once with address, product and device name when clients can connect.
    report : callable, optional
        Called with :func:`output_state`, time, and the samples handed out and acquired, at every change of the outputs.
    stop : threading.Event, optional
        Ends the server when it is set.

    Raises
    ------
    RigInputError
        Bad rig file, bench file, clock or fault; an address on the network that was not allowed.
    HardwareFault
        When the address cannot be bound.

    Examples
    --------
    >>> import threading
    >>> from rig.simulated import ServeOptions, serve_until_interrupted
    >>> stop = threading.Event()
    >>> def announce(address, product, device):
    ...     print(product)
    ...     stop.set()
    >>> serve_until_interrupted(ServeOptions(rig="pcie6363", port=0), announce, stop=stop)
    PCIe-6363
    """
    if options.on_network and not options.allow_network:
        raise RigInputError(
            f"host {options.host}: other computers could drive the bench; allowed is the loopback, e.g. 127.0.0.1, "
            "or  --allow-network  beside it (with --tls, and --tls-client-ca to know who calls)"
        )
    backend = open_backend(options.address, load_rig(options.rig).config)
    server, bound = serve(backend.service, host=options.host, port=options.port, tls=options.tls)
    device, stop = backend.device, stop or threading.Event()
    announce(f"{options.host}:{bound}", device.inventory.product.name, device.inventory.name)
    last: dict[str, object] = {}
    try:
        with contextlib.suppress(KeyboardInterrupt), termination_as_interrupt():
            while not stop.wait(CHECK_EVERY_S):
                with backend.service.exclusive():
                    check_watchdogs(device)
                    if device.bench.clock.due_s > BEHIND_S:
                        go_on(device)
                    state = output_state(device)
                    samples = {"samples": device.handed_out, "acquired": device.bench.edge}
                if report is not None and state != last:
                    report({**state, **samples, "time_s": round(device.bench.clock.elapsed_s, 4)})
                    last = state
    finally:
        server.stop(None).wait()
