"""NI's session utilities, as clients of its gRPC Device Server use them beside the DAQmx service."""

from __future__ import annotations

import threading
from unittest.mock import MagicMock

import grpc
import pytest
import session_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2 as daq
from nidaqmx._stubs import nidaqmx_pb2_grpc as services
from session_pb2_grpc import SessionUtilitiesStub

from rig.configuration.rig_file import load_rig
from rig.simulated.rpc.tcp_server import SessionUtilities, serve
from rig.simulated.status import SessionRefused


@pytest.fixture
def channel(make_backend):
    server, port = serve(make_backend(load_rig("virtual").config).service)
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        yield channel
    server.stop(None).wait()


def test_the_chassis_and_its_modules_are_enumerated(channel) -> None:
    found = SessionUtilitiesStub(channel).EnumerateDevices(messages.EnumerateDevicesRequest()).devices
    assert [(d.name, d.model) for d in found] == [
        ("cDAQ1", "cDAQ-9189"), ("cDAQ1Mod1", "NI 9237"), ("cDAQ1Mod2", "NI 9263"), ("cDAQ1Mod3", "NI 9411"),
        ("cDAQ1Mod4", "NI 9401"),
    ]  # fmt: skip


def test_reservations_are_taken_in_turn_and_a_reset_ends_them_and_all_tasks(channel) -> None:
    stub, names = SessionUtilitiesStub(channel), {"reservation_id": "bench"}
    first, second = ({**names, "client_id": client} for client in ("one", "two"))

    def held(client: dict[str, str]) -> bool:
        return stub.IsReservedByClient(messages.IsReservedByClientRequest(**client)).is_reserved

    assert not held(first)
    assert stub.Reserve(messages.ReserveRequest(**first)).is_reserved and held(first) and not held(second)
    for request, code in ((first, "FAILED_PRECONDITION"), (names, "INVALID_ARGUMENT")):
        with pytest.raises(grpc.RpcError) as refusal:
            stub.Reserve(messages.ReserveRequest(**request))
        assert refusal.value.code().name == code
    with pytest.raises(grpc.RpcError) as refusal:
        stub.Reserve(messages.ReserveRequest(**second), timeout=0.1)
    assert refusal.value.code().name == "DEADLINE_EXCEEDED"
    waiting = stub.Reserve.future(messages.ReserveRequest(**second))
    assert not stub.Unreserve(messages.UnreserveRequest(**second)).is_unreserved
    assert stub.Unreserve(messages.UnreserveRequest(**first)).is_unreserved
    assert waiting.result(5.0).is_reserved and held(second)
    task = services.NiDAQmxStub(channel).CreateTask(daq.CreateTaskRequest(session_name="kept")).task
    assert stub.ResetServer(messages.ResetServerRequest()).is_server_reset and not held(second)
    with pytest.raises(grpc.RpcError, match="invalid"):
        services.NiDAQmxStub(channel).StartTask(daq.StartTaskRequest(task=task))


def test_a_call_that_nobody_waits_for_any_more_takes_nothing() -> None:
    """The holder gives up its turn before the server has noticed that the next call in line has ended."""
    utilities = SessionUtilities(MagicMock())
    first, second = (messages.ReserveRequest(reservation_id="bench", client_id=client) for client in ("one", "two"))
    utilities.handle("Reserve", first, lambda: True)
    asked = threading.Event()
    waits = [True]
    refusals: list[Exception] = []

    def wait_then_go() -> None:
        def is_waiting() -> bool:
            asked.set()
            return waits[0]

        try:
            utilities.handle("Reserve", second, is_waiting)
        except SessionRefused as refusal:
            refusals.append(refusal)

    dead = threading.Thread(target=wait_then_go)
    dead.start()
    assert asked.wait(5.0)
    waits[0] = False
    assert utilities.handle("Unreserve", first, lambda: True).is_unreserved
    assert utilities.handle("Reserve", second, lambda: True).is_reserved
    dead.join(5.0)
    assert "no longer waits" in str(refusals[0])
    assert utilities.handle("IsReservedByClient", second, lambda: True).is_reserved
