"""A server with many clients: streams, sizes, clients that die, other computers, and what a dead recording left."""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import grpc
import nidaqmx
import pytest
from nidaqmx import GrpcSessionOptions
from nidaqmx.constants import AcquisitionType

from pianorig.cli import main
from rig.backend import open_backend
from rig.configuration.rig_file import load_rig
from rig.daq.address import reset_server
from rig.errors import InputError, ResourceBusy
from rig.simulated.bench.clock import PacedClock
from rig.simulated.rpc.tcp_server import MOST_BYTES, WORKERS, Tls, serve
from rig.simulated.serve import ServeOptions
from tests.command_line import run


@pytest.fixture
def served(make_backend):
    """A card over TCP, on the wall clock: its backend, and the port."""
    backend = make_backend(load_rig("pcie6363").config, clock=PacedClock())
    server, port = serve(backend.service)
    yield backend, port
    server.stop(None).wait()


def client(port: int) -> grpc.Channel:
    return grpc.insecure_channel(f"127.0.0.1:{port}", options=[("grpc.use_local_subchannel_pool", 1)])


def task(channel: grpc.Channel, name: str) -> nidaqmx.Task:
    return nidaqmx.Task(name, grpc_options=GrpcSessionOptions(channel, name))


@pytest.mark.parametrize("clients", [5, pytest.param(64, marks=pytest.mark.slow)])
def test_many_event_streams_leave_the_server_to_all_clients(served, clients) -> None:
    from rig.simulated.rpc.messages import SERVICE, request_class

    _, port = served
    assert clients * 32 > WORKERS
    channels, streams = [client(port) for _ in range(clients)], []
    register = request_class("RegisterDoneEvent")
    for number, channel in enumerate(channels):
        call = channel.unary_stream(
            f"/{SERVICE}/RegisterDoneEvent",
            request_serializer=register.SerializeToString,
            response_deserializer=lambda raw: raw,
        )
        for k in range(32):
            made = task(channel, f"t{number}_{k}")
            made.do_channels.add_do_chan(f"Dev1/port0/line{k}")
            request = register()
            request.task.name = made.name
            streams.append(call(request))
            streams[-1].initial_metadata()  # registered
    began = time.monotonic()
    acquired = task(client(port), "another")
    acquired.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    assert len(acquired.read(10)) == 10 and time.monotonic() - began < 5
    for stream in streams:
        stream.cancel()
    for channel in channels:
        channel.close()


def test_events_of_a_running_task_come_while_others_wait(served) -> None:
    backend, port = served
    channel, seen = client(port), []
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


def test_a_message_beyond_the_bound_is_refused(served) -> None:
    _, port = served
    channel = client(port)
    call = channel.unary_unary("/nidaqmx_grpc.NiDAQmx/WriteAnalogF64")
    with pytest.raises(grpc.RpcError) as refused:
        call(bytes(MOST_BYTES + 1000))
    assert refused.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    channel.close()


def test_a_call_of_a_client_that_died_ends(served) -> None:
    backend, port = served
    channel = client(port)
    made = task(channel, "endless")
    made.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    made.timing.cfg_samp_clk_timing(1000.0, source="/Dev1/PFI3", sample_mode=AcquisitionType.CONTINUOUS)
    from rig.simulated.rpc.messages import SERVICE, request_class

    kind = request_class("ReadAnalogF64")
    request = kind(num_samps_per_chan=1, timeout=-1.0, array_size_in_samps=1)
    request.task.name = "endless"
    call = channel.unary_unary(
        f"/{SERVICE}/ReadAnalogF64", request_serializer=kind.SerializeToString, response_deserializer=lambda raw: raw
    )
    waiting = call.future(request)
    time.sleep(0.3)
    channel.close()  # as its death does
    assert waiting.cancelled() or waiting.done()
    other = client(port)
    begun = time.monotonic()
    while backend.service.waiting:
        assert time.monotonic() - begun < 5
        time.sleep(0.02)
    other.close()


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


def test_an_address_on_the_network_warns(serve_lines) -> None:
    assert "open to the network; anybody" in serve_lines("--host", "0.0.0.0", "--allow-network")


@pytest.fixture
def serve_lines():
    """Start the command, and return its first line on standard error."""
    import sys

    started = []

    def start(*arguments: str) -> str:
        code = "from pianorig.cli import main; main()"
        process = subprocess.Popen(
            [sys.executable, "-c", code, "serve-sim", "--port", "0", *arguments],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        started.append(process)
        return process.stderr.readline()

    yield start
    for process in started:
        process.terminate()
        process.wait(60)
        process.stderr.close()


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


def left_by_a_dead_program(backend: Any, port: int, config: Any, command: Any) -> None:
    """Record until the middle of a blow, then vanish as a killed program does: lock gone, sessions left."""
    dead = open_backend(f"ni-grpc://127.0.0.1:{port}", config)
    dead.configure(config, command)
    dead.arm()
    dead.start()
    import os

    os.close(dead._claim._lock)
    dead._watchdog.leave_running()
    dead._channel.close()


def test_the_next_recording_takes_over_what_its_own_rig_left(make_backend, config, command) -> None:
    backend = make_backend(config)
    server, port = serve(backend.service)
    left_by_a_dead_program(backend, port, config, command)
    assert "force" in backend.device.tasks
    other = config.model_copy(update={"name": "another rig"})
    stranger = open_backend(f"ni-grpc://127.0.0.1:{port}", other)
    with pytest.raises(ResourceBusy, match="--reset-server"):
        stranger.configure(other, command)
    stranger._claim.release()
    stranger._channel.close()
    heir = open_backend(f"ni-grpc://127.0.0.1:{port}", config)
    heir.configure(config, command)
    heir.arm()
    heir.start()
    assert heir.read_block(100, 1.0).first_sample == 0
    second = open_backend(f"ni-grpc://127.0.0.1:{port}", config)
    with pytest.raises(ResourceBusy, match="another program on this computer"):
        second.configure(config, command)  # the first one lives
    second._channel.close()
    heir.close()
    assert backend.device.tasks == {}
    server.stop(None).wait()


def test_recover_resets_a_server(make_backend, config, command, capsys) -> None:
    backend = make_backend(config)
    server, port = serve(backend.service)
    left_by_a_dead_program(backend, port, config, command)
    assert run("recover", "--reset-server", f"ni-grpc://127.0.0.1:{port}") == 0
    assert "all sessions ended" in capsys.readouterr().out and backend.device.tasks == {}
    server.stop(None).wait()
    with pytest.raises(Exception, match="does not answer"):
        reset_server(f"ni-grpc://127.0.0.1:{port}")
    for arguments in (["recover"], ["recover", "--reset-server", "sim://"]):
        assert run(*arguments) == 2
