"""The virtual device over TCP, seen by a client that speaks NI's service without our rig.

NI's session utilities, as clients of its gRPC Device Server use them beside the DAQmx service.

A server with many clients: streams, sizes, clients that die, other computers, and what a dead recording left.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import grpc
import nidaqmx
import numpy as np
import pytest
import session_pb2 as sessions
from nidaqmx import GrpcSessionOptions
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as stubs
from nidaqmx.constants import AcquisitionType
from session_pb2_grpc import SessionUtilitiesStub

from pianorig.cli import main
from rig.backend import open_backend
from rig.configuration.rig_file import load_rig
from rig.daq import tasks
from rig.daq.address import reset_server
from rig.daq.safe_bench import leave_running
from rig.errors import HardwareFault, InputError, ResourceBusy
from rig.simulated.bench.bench_time import PacedClock
from rig.simulated.serve import MOST_BYTES, WORKERS, ServeOptions, SessionUtilities, Tls, serve
from rig.simulated.status import SessionRefused
from tests.command_line import run


def channel_to(address: str) -> grpc.Channel:
    options = [("grpc.use_local_subchannel_pool", 1)]
    return grpc.insecure_channel(address.removeprefix("ni-grpc://"), options=options)


@pytest.fixture
def card(make_backend, served) -> Iterator[tuple[Any, Any]]:
    """A PCIe-6363 on the loopback: (stub, virtual device)."""
    backend = make_backend(load_rig("pcie6363").config)
    with channel_to(served(backend)[1]) as channel:
        yield stubs.NiDAQmxStub(channel), backend.device


def new_task(stub: Any, name: str = "") -> Any:
    return stub.CreateTask(messages.CreateTaskRequest(session_name=name)).task


def add_voltage_inputs(stub: Any, task: Any, channels: str, **changes: Any) -> None:
    fields = {"min_val": -10.0, "max_val": 10.0, "units": messages.VOLTAGE_UNITS2_VOLTS, **changes}
    stub.CreateAIVoltageChan(messages.CreateAIVoltageChanRequest(task=task, physical_channel=channels, **fields))


def finite_inputs(stub: Any, channels: str, samples: int, rate: float) -> Any:
    task = new_task(stub)
    add_voltage_inputs(stub, task, channels)
    finite = {"active_edge": messages.EDGE1_RISING, "sample_mode": messages.ACQUISITION_TYPE_FINITE_SAMPS}
    stub.CfgSampClkTiming(messages.CfgSampClkTimingRequest(task=task, rate=rate, samps_per_chan=samples, **finite))
    return task


def test_a_finite_acquisition_of_several_channels(card) -> None:
    stub, _ = card
    task = finite_inputs(stub, "Dev1/ai0:2", 400, 10_000.0)
    assert stub.StartTask(messages.StartTaskRequest(task=task)).status == 0
    number = messages.GetTaskAttributeUInt32Request(task=task, attribute=messages.TASK_ATTRIBUTE_NUM_CHANS)
    assert stub.GetTaskAttributeUInt32(number).value == 3
    request = {"task": task, "num_samps_per_chan": 100, "array_size_in_samps": 300, "timeout": 1.0}
    by_channel = stub.ReadAnalogF64(
        messages.ReadAnalogF64Request(fill_mode=messages.GROUP_BY_GROUP_BY_CHANNEL, **request)
    )
    by_scan = stub.ReadAnalogF64(
        messages.ReadAnalogF64Request(fill_mode=messages.GROUP_BY_GROUP_BY_SCAN_NUMBER, **request)
    )
    cell_v = 0.05 * 10 / 111.2
    for rows in (np.reshape(by_channel.read_array, (3, 100)), np.reshape(by_scan.read_array, (100, 3)).T):
        np.testing.assert_allclose(rows[0], cell_v, atol=20 / 2**16)
        assert not rows[1:].any()
    late = stub.ReadAnalogF64(messages.ReadAnalogF64Request(**{**request, "timeout": 0.0}))
    assert (late.status, late.samps_per_chan_read) == (-200284, 0)
    stub.StopTask(messages.StopTaskRequest(task=task))
    stub.ClearTask(messages.ClearTaskRequest(task=task))


def test_every_n_samples_and_done_events(card) -> None:
    stub, _ = card
    task = finite_inputs(stub, "Dev1/ai0:1", 1000, 100.0)
    request = messages.RegisterEveryNSamplesEventRequest(task=task, n_samples=100, every_n_samples_event_type_raw=1)
    every = stub.RegisterEveryNSamplesEvent(request)
    every.initial_metadata()
    with pytest.raises(grpc.RpcError):
        next(stub.RegisterEveryNSamplesEvent(request))
    done = stub.RegisterDoneEvent(messages.RegisterDoneEventRequest(task=task))
    done.initial_metadata()
    stub.StartTask(messages.StartTaskRequest(task=task))
    read = messages.ReadAnalogF64Request(task=task, num_samps_per_chan=100, array_size_in_samps=200, timeout=10.0)
    got = 0
    for event in every:
        assert (event.status, event.n_samples) == (0, 100)
        got += stub.ReadAnalogF64(read).samps_per_chan_read
        if got == 1000:
            every.cancel()
            break
    assert next(done).status == 0
    stub.ClearTask(messages.ClearTaskRequest(task=task))


def test_one_value_on_an_output(card) -> None:
    stub, device = card
    task = new_task(stub)
    stub.CreateAOVoltageChan(
        messages.CreateAOVoltageChanRequest(
            task=task, physical_channel="Dev1/ao1", min_val=-10, max_val=10, units=messages.VOLTAGE_UNITS2_VOLTS
        )
    )
    stub.StartTask(messages.StartTaskRequest(task=task))
    write = messages.WriteAnalogF64Request(task=task, num_samps_per_chan=1, write_array=[1.5])
    assert stub.WriteAnalogF64(write).samps_per_chan_written == 1
    stub.ClearTask(messages.ClearTaskRequest(task=task))
    assert device.output_v == {"Dev1/ao1": 1.5}


def test_refusals_carry_the_driver_status_and_unknown_calls_are_the_drivers_too(card) -> None:
    stub, _ = card
    task = new_task(stub)
    for code, channels, changes in ((-200170, "Dev1/ai99", {}), (-200077, "Dev1/ai1", {"max_val": 11.0})):
        with pytest.raises(grpc.RpcError) as refusal:
            add_voltage_inputs(stub, task, channels, **changes)
        assert ("ni-error", str(code)) in [tuple(entry) for entry in refusal.value.trailing_metadata()]
    for call, request in (
        (stub.CreateCISemiPeriodChan, messages.CreateCISemiPeriodChanRequest(task=task)),
        (stub.CreateWatchdogTimerTask, messages.CreateWatchdogTimerTaskRequest()),
    ):
        with pytest.raises(grpc.RpcError) as refusal:
            call(request)
        assert refusal.value.code() == grpc.StatusCode.UNKNOWN and dict(refusal.value.trailing_metadata())["ni-error"]
    stream = stub.RegisterSignalEvent(messages.RegisterSignalEventRequest(task=task, signal_id_raw=12494))
    with pytest.raises(grpc.RpcError) as refusal:
        next(stream)
    assert dict(refusal.value.trailing_metadata())["ni-error"] == "-200452"


@pytest.mark.parametrize("call", ["StartTask", "ReadAnalogF64", "WriteAnalogF64", "CfgSampClkTiming", "TaskControl"])
def test_requests_with_nothing_in_them_are_refused_not_crashed_on(call, card) -> None:
    stub, _ = card
    with pytest.raises(grpc.RpcError) as refusal:
        getattr(stub, call)(getattr(messages, f"{call}Request")())
    assert ("ni-error", "-200088") in [tuple(entry) for entry in refusal.value.trailing_metadata()]


def test_a_port_that_is_taken_is_a_clear_fault(make_backend, config, served) -> None:
    backend = make_backend(config)
    port = int(served(backend)[1].rsplit(":", 1)[1])
    with pytest.raises(HardwareFault, match="cannot be bound"):
        serve(backend.service, port=port)


@pytest.fixture
def channel(make_backend, config, served):
    with channel_to(served(make_backend(config))[1]) as channel:
        yield channel


def test_the_chassis_and_its_modules_are_enumerated(channel) -> None:
    found = SessionUtilitiesStub(channel).EnumerateDevices(sessions.EnumerateDevicesRequest()).devices
    assert [(d.name, d.model) for d in found] == [
        ("cDAQ1", "cDAQ-9189"), ("cDAQ1Mod1", "NI 9237"), ("cDAQ1Mod2", "NI 9263"), ("cDAQ1Mod3", "NI 9411"),
        ("cDAQ1Mod4", "NI 9401"),
    ]  # fmt: skip


def test_reservations_are_taken_in_turn_and_a_reset_ends_them_and_all_tasks(channel) -> None:
    stub, names = SessionUtilitiesStub(channel), {"reservation_id": "bench"}
    first, second = ({**names, "client_id": client} for client in ("one", "two"))

    def held(client: dict[str, str]) -> bool:
        return stub.IsReservedByClient(sessions.IsReservedByClientRequest(**client)).is_reserved

    assert not held(first)
    assert stub.Reserve(sessions.ReserveRequest(**first)).is_reserved and held(first) and not held(second)
    for request, code in ((first, "FAILED_PRECONDITION"), (names, "INVALID_ARGUMENT")):
        with pytest.raises(grpc.RpcError) as refusal:
            stub.Reserve(sessions.ReserveRequest(**request))
        assert refusal.value.code().name == code
    with pytest.raises(grpc.RpcError) as refusal:
        stub.Reserve(sessions.ReserveRequest(**second), timeout=0.1)
    assert refusal.value.code().name == "DEADLINE_EXCEEDED"
    waiting = stub.Reserve.future(sessions.ReserveRequest(**second))
    assert not stub.Unreserve(sessions.UnreserveRequest(**second)).is_unreserved
    assert stub.Unreserve(sessions.UnreserveRequest(**first)).is_unreserved
    assert waiting.result(5.0).is_reserved and held(second)
    task = stubs.NiDAQmxStub(channel).CreateTask(messages.CreateTaskRequest(session_name="kept")).task
    assert stub.ResetServer(sessions.ResetServerRequest()).is_server_reset and not held(second)
    with pytest.raises(grpc.RpcError, match="Invalid task"):
        stubs.NiDAQmxStub(channel).StartTask(messages.StartTaskRequest(task=task))


def test_a_call_that_nobody_waits_for_any_more_takes_nothing() -> None:
    """The holder gives up its turn before the server has noticed that the next call in line has ended."""
    utilities = SessionUtilities(MagicMock())
    first, second = (sessions.ReserveRequest(reservation_id="bench", client_id=client) for client in ("one", "two"))
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


@pytest.fixture
def paced_server(make_backend, served):
    """A card over TCP, on the wall clock: its backend, and the address."""
    backend = make_backend(load_rig("pcie6363").config, clock=PacedClock())
    return backend, served(backend)[1]


def task(channel: grpc.Channel, name: str) -> nidaqmx.Task:
    return nidaqmx.Task(name, grpc_options=GrpcSessionOptions(channel, name))


@pytest.mark.parametrize("clients", [pytest.param(n, marks=pytest.mark.slow) for n in (5, 64)])
def test_many_event_streams_leave_the_server_to_all_clients(paced_server, clients) -> None:
    _, address = paced_server
    assert clients * 32 > WORKERS
    channels, streams = [channel_to(address) for _ in range(clients)], []
    for number, channel in enumerate(channels):
        register = stubs.NiDAQmxStub(channel).RegisterDoneEvent
        for k in range(32):
            made = task(channel, f"t{number}_{k}")
            made.do_channels.add_do_chan(f"Dev1/port0/line{k}")
            streams.append(register(messages.RegisterDoneEventRequest(task={"name": made.name})))
            streams[-1].initial_metadata()  # registered
    began = time.monotonic()
    acquired = task(channel_to(address), "another")
    acquired.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    assert len(acquired.read(10)) == 10 and time.monotonic() - began < 5
    for stream in streams:
        stream.cancel()
    for channel in channels:
        channel.close()


def test_events_of_a_running_task_come_while_others_wait(paced_server) -> None:
    backend, address = paced_server
    channel, seen = channel_to(address), []
    made = task(channel, "events")
    made.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    made.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    made.register_every_n_samples_acquired_into_buffer_event(50, lambda *told: seen.append(len(made.read(50))) or 0)
    made.start()
    end = time.monotonic() + 20
    while len(seen) < 5:
        assert time.monotonic() < end
        time.sleep(0.01)
    made.close()
    assert seen[:5] == [50] * 5
    channel.close()


def test_a_message_beyond_the_bound_is_refused(paced_server) -> None:
    _, address = paced_server
    channel = channel_to(address)
    call = channel.unary_unary("/nidaqmx_grpc.NiDAQmx/WriteAnalogF64")
    with pytest.raises(grpc.RpcError) as refused:
        call(bytes(MOST_BYTES + 1000))
    assert refused.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    channel.close()


def test_a_call_of_a_client_that_died_ends(paced_server) -> None:
    backend, address = paced_server
    channel = channel_to(address)
    made = task(channel, "endless")
    made.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    made.timing.cfg_samp_clk_timing(1000.0, source="/Dev1/PFI3", sample_mode=AcquisitionType.CONTINUOUS)
    request = messages.ReadAnalogF64Request(
        task={"name": "endless"}, num_samps_per_chan=1, timeout=-1.0, array_size_in_samps=1
    )
    waiting = stubs.NiDAQmxStub(channel).ReadAnalogF64.future(request)
    time.sleep(0.3)
    channel.close()  # as its death does
    assert waiting.cancelled() or waiting.done()
    begun = time.monotonic()
    while backend.service.waiting:
        assert time.monotonic() - begun < 5
        time.sleep(0.02)


def test_an_address_on_the_network_must_be_allowed(capsys) -> None:
    for host in ("0.0.0.0", "192.168.1.7", "::", "bench.example.org"):
        assert ServeOptions(host=host).on_network
        with pytest.raises(SystemExit) as end:
            main(["serve-sim", "--host", host, "--port", "0"])
        said = capsys.readouterr().err
        assert end.value.code == 2 and "--allow-network" in said and len(said.strip().splitlines()) == 1
    for host in ("127.0.0.1", "127.0.0.7", "::1", "[::1]", "localhost"):
        assert not ServeOptions(host=host).on_network
    with pytest.raises(SystemExit) as end:
        main(["serve-sim", "--tls-client-ca", "ca.pem"])
    assert end.value.code == 2 and "--tls CERT KEY" in capsys.readouterr().err


def test_an_address_on_the_network_warns(start) -> None:
    program = start("serve-sim", "--port", "0", "--host", "0.0.0.0", "--allow-network", stderr=subprocess.PIPE)
    with program.process.stderr as told:
        assert "open to the network; anybody" in told.readline()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make certificates")
def test_tls_of_the_server_and_of_both(make_backend, tmp_path: Path, config) -> None:
    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=tmp_path, check=True, capture_output=True)

    openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "s.key", "-out", "s.pem", "-days", "2",
            "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1")  # fmt: skip
    backend = make_backend(config)
    one = Tls(tmp_path / "s.pem", tmp_path / "s.key")
    for tls, query, refused in (
        (one, f"?ca={tmp_path}/s.pem", ""),
        (Tls(one.certificate, one.key, one.certificate),
         f"?ca={tmp_path}/s.pem&cert={tmp_path}/s.pem&key={tmp_path}/s.key", f"?ca={tmp_path}/s.pem"),
    ):  # fmt: skip
        server, port = serve(backend.service, tls=tls)
        open_backend(f"ni-grpc://localhost:{port}{query}", config)._channel.close()
        with pytest.raises(Exception, match="does not answer"):
            open_backend(f"ni-grpc://localhost:{port}{refused}", config)
        server.stop(None).wait()
    with pytest.raises(InputError, match="allowed are ca=FILE"):
        open_backend("ni-grpc://localhost:1?cert=x", config)
    with pytest.raises(InputError, match="missing.pem"):
        serve(backend.service, tls=Tls(tmp_path / "missing.pem", tmp_path / "s.key"))


@pytest.fixture
def left_by_a_dead_program(make_backend, config, begin, served, on_any_machine) -> tuple[Any, Any, str]:
    """A bench on which a blow began whose program was killed, lock gone, sessions left: (backend, server, address)."""
    backend = make_backend(config)
    server, address = served(backend)
    dead = open_backend(address, config)
    begin(dead)
    for name in (tasks.OPPOSITE, "check_force", "check_voltage"):
        dead._new_task(name)
    os.close(dead._claim._lock)
    leave_running(dead._watchdog)
    dead._channel.close()
    return backend, server, address


def test_the_next_recording_takes_over_what_its_own_rig_left(left_by_a_dead_program, config, command, begin) -> None:
    backend, _, address = left_by_a_dead_program
    assert "force" in backend.device.tasks
    other = config.model_copy(update={"name": "another rig"})
    stranger = open_backend(address, other)
    with pytest.raises(ResourceBusy, match="--reset-server"):
        stranger.configure(other, command)
    stranger._claim.release()
    stranger._channel.close()
    heir = open_backend(address, config)
    begin(heir)
    assert heir.read_block(100, 1.0).first_sample == 0
    assert not {tasks.OPPOSITE, "check_force", "check_voltage"} & set(backend.device.tasks)
    second = open_backend(address, config)
    with pytest.raises(ResourceBusy, match="another program on this computer"):
        second.configure(config, command)  # the first one lives
    second._channel.close()
    heir.close()
    assert backend.device.tasks == {}


def test_recover_resets_a_server(left_by_a_dead_program, capsys) -> None:
    backend, server, address = left_by_a_dead_program
    assert run("recover", "--reset-server", address) == 0
    assert "all sessions ended" in capsys.readouterr().out and backend.device.tasks == {}
    server.stop(None).wait()
    with pytest.raises(Exception, match="does not answer"):
        reset_server(address)
    for arguments in (["recover"], ["recover", "--reset-server", "sim://"]):
        assert run(*arguments) == 2
