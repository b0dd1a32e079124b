"""Serve the virtual bench as NI's gRPC Device Server does, for a nidaqmx or LabVIEW program of your own, until Ctrl-C.

``python examples/serve_sim.py --port 31763``, then in your program
``nidaqmx.Task("t", grpc_options=nidaqmx.GrpcSessionOptions(grpc.insecure_channel("localhost:31763"), "t"))``, or
``pianorig record --backend ni-grpc://localhost:31763``. The bench answers what ``pianorig`` asks of NI-DAQmx
(``rig/simulated/rpc/calls.py``) and refuses every other call by its name. Only this computer can connect.
"""

from __future__ import annotations

import argparse
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc

import rig
from rig.simulated import open_backend

WORKERS = 32
TICK_S = 0.01
"""How often the watchdogs are looked at, and a bench that no client reads goes on."""


class BenchHandler(grpc.GenericRpcHandler):
    """Hands every call to the service of a virtual bench, and its refusal to the client."""

    def __init__(self, service: Any) -> None:
        self._service = service

    def service(self, handler_call_details: Any) -> grpc.RpcMethodHandler:
        """Return what answers a call, in bytes."""
        method = handler_call_details.method

        def answer(request: bytes, context: grpc.ServicerContext) -> bytes:
            try:
                return self._service.answer(method, request, context.is_active)
            except grpc.RpcError as refusal:
                context.set_trailing_metadata(refusal.trailing_metadata())
                context.abort(refusal.code(), refusal.details())

        return grpc.unary_unary_rpc_method_handler(answer)


def serve(service: Any, port: int = 0, credentials: grpc.ServerCredentials | None = None) -> tuple[grpc.Server, int]:
    """Serve a bench on the loopback; return the server and its port, a free one for port 0."""
    # a port that another server has is refused, not shared with it
    server = grpc.server(ThreadPoolExecutor(WORKERS), options=[("grpc.so_reuseport", 0)])
    server.add_generic_rpc_handlers((BenchHandler(service),))
    address = f"127.0.0.1:{port}"
    bound = server.add_secure_port(address, credentials) if credentials else server.add_insecure_port(address)
    server.start()
    return server, bound


def main() -> None:
    options = argparse.ArgumentParser(description="Serve the virtual bench until Ctrl-C.")
    options.add_argument("--rig", default="virtual", help="rig file, or the name of a built-in one")
    options.add_argument("--bench", default="sim://?clock=real", help="address of the bench, with its options")
    options.add_argument("--port", type=int, default=31763)
    asked = options.parse_args()
    bench = open_backend(asked.bench, rig.load_rig(asked.rig).config)
    server, port = serve(bench.service, asked.port)
    print(f"{bench.capabilities.name} on localhost:{port}", flush=True)
    try:
        while not threading.Event().wait(TICK_S):
            bench.service.let_time_pass()
    except KeyboardInterrupt:
        server.stop(None).wait()


if __name__ == "__main__":
    main()
