"""The virtual device over TCP, as a client of the NI gRPC Device Server sees it; on the loopback by default."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc

from rig.errors import HardwareFault
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

WORKERS = 32
"""Calls and event streams at once; each stream takes one as long as it lasts."""


class _Handler(grpc.GenericRpcHandler):
    def __init__(self, service: Service) -> None:
        self._service = service
        self._utilities = SessionUtilities(service)

    def service(self, handler_call_details: Any) -> grpc.RpcMethodHandler | None:
        prefix, _, call = handler_call_details.method.lstrip("/").partition("/")
        if prefix == UTILITIES and call in UTILITY_CALLS:
            return self._utility(call)
        if prefix != SERVICE or call not in CALLS:
            return None  # gRPC itself answers UNIMPLEMENTED

        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            with _aborting(context):
                return self._service.handle(call, request)

        def events(request: Any, context: grpc.ServicerContext) -> Iterator[Any]:
            with _aborting(context):
                stream = self._service.stream(call, request)
                context.add_callback(stream.cancel)
                context.send_initial_metadata(())  # the client waits for it before it starts the task
                yield from stream

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


def serve(service: Service, *, host: str = "127.0.0.1", port: int = 0) -> tuple[grpc.Server, int]:
    """Start a server for the virtual device; returns (server, port). Port 0 takes a free one.

    Raises
    ------
    HardwareFault
        When the address cannot be bound.
    """
    # without the second option two servers may share a port on Linux, and a client talk to either
    options = [("grpc.max_receive_message_length", -1), ("grpc.so_reuseport", 0)]
    server = grpc.server(ThreadPoolExecutor(max_workers=WORKERS), options=options)
    server.add_generic_rpc_handlers((_Handler(service),))
    try:
        bound = server.add_insecure_port(f"{host}:{port}")
    except RuntimeError as error:
        raise HardwareFault(f"{host}:{port} cannot be bound; another program may use it", phase="connect") from error
    server.start()
    return server, bound
