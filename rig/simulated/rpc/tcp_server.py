"""The virtual device over TCP, as a client of the NI gRPC Device Server sees it; on the loopback by default."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc

from rig.errors import HardwareFault, RigInputError
from rig.simulated.rpc.event_streams import EVENTS
from rig.simulated.rpc.grpc_status import REFUSALS, rpc_status
from rig.simulated.rpc.messages import (
    CALLS,
    SERVICE,
    UTILITIES,
    UTILITY_CALLS,
    request_class,
    utility_request_class,
)
from rig.simulated.rpc.service import Service
from rig.simulated.rpc.session_utilities import SessionUtilities
from rig.simulated.rpc.stream_pump import StreamPump

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
        if prefix == UTILITIES and call in UTILITY_CALLS:
            return self._utility(call)
        if prefix != SERVICE or call not in CALLS:
            return None  # gRPC itself answers UNIMPLEMENTED

        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            with _aborting(context):
                return self._service.handle(call, request, context.is_active)

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
            response_serializer=_serialised,
        )

    def _utility(self, call: str) -> grpc.RpcMethodHandler:
        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            with _aborting(context):
                return self._utilities.handle(call, request, context.is_active)

        return grpc.unary_unary_rpc_method_handler(
            answer, request_deserializer=utility_request_class(call).FromString, response_serializer=_serialised
        )


def _serialised(message: Any) -> bytes:
    return bytes(message.SerializeToString())


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
