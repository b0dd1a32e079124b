"""The virtual device over TCP (``examples/serve_sim.py``): a client without our rig, and what a dead recording left."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as stubs

from rig import InputError, ResourceBusy, load_rig, open_backend, reset_server
from rig.daq import tasks
from rig.daq.safe_bench import leave_running
from rig.simulated.bench.clock import PacedClock
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


def new_task(stub: Any) -> Any:
    return stub.CreateTask(messages.CreateTaskRequest()).task


def add_voltage_inputs(stub: Any, task: Any, channels: str, **changes: Any) -> None:
    fields = {"min_val": -10.0, "max_val": 10.0, "units": messages.VOLTAGE_UNITS2_VOLTS, **changes}
    stub.CreateAIVoltageChan(messages.CreateAIVoltageChanRequest(task=task, physical_channel=channels, **fields))


def test_a_finite_acquisition_of_several_channels(card) -> None:
    stub, _ = card
    task = new_task(stub)
    add_voltage_inputs(stub, task, "Dev1/ai0:2")
    finite = {"active_edge": messages.EDGE1_RISING, "sample_mode": messages.ACQUISITION_TYPE_FINITE_SAMPS}
    stub.CfgSampClkTiming(messages.CfgSampClkTimingRequest(task=task, rate=10_000.0, samps_per_chan=400, **finite))
    assert stub.StartTask(messages.StartTaskRequest(task=task)).status == 0
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


@pytest.mark.parametrize("call", ["CreateAIThrmcplChan", "RegisterDoneEvent"])
def test_what_is_not_answered_is_refused_by_its_name_also_where_events_would_come(card, call: str) -> None:
    stub, _ = card
    with pytest.raises(grpc.RpcError) as refusal:
        next(iter(getattr(stub, call)(getattr(messages, f"{call}Request")(task=new_task(stub)))))
    assert refusal.value.code() == grpc.StatusCode.UNKNOWN and call in refusal.value.details()
    assert dict(refusal.value.trailing_metadata())["ni-error"] == "-200452"


def test_a_port_is_not_shared_by_two_servers(make_backend, config, served) -> None:
    backend = make_backend(config)
    port = int(served(backend)[1].rsplit(":", 1)[1])
    with pytest.raises(RuntimeError, match="Failed to bind"):
        served(backend, port=port)


def test_a_call_of_a_client_that_died_ends(make_backend, served, monkeypatch) -> None:
    backend, ended = make_backend(load_rig("pcie6363").config, clock=PacedClock()), threading.Event()
    handle = backend.service.handle

    def watched(call: str, request: Any, *waiting: Any) -> Any:
        try:
            return handle(call, request, *waiting)
        except SessionRefused:
            ended.set()
            raise

    monkeypatch.setattr(backend.service, "handle", watched)
    channel = channel_to(served(backend)[1])
    stub = stubs.NiDAQmxStub(channel)
    task = new_task(stub)
    add_voltage_inputs(stub, task, "Dev1/ai0")
    continuous = {"active_edge": messages.EDGE1_RISING, "sample_mode": messages.ACQUISITION_TYPE_CONT_SAMPS}
    clock = {"rate": 1000.0, "source": "/Dev1/PFI3", "samps_per_chan": 1000}  # nothing is wired there
    stub.CfgSampClkTiming(messages.CfgSampClkTimingRequest(task=task, **clock, **continuous))
    request = messages.ReadAnalogF64Request(task=task, num_samps_per_chan=1, timeout=-1.0, array_size_in_samps=1)
    waiting = stub.ReadAnalogF64.future(request)
    while "ReadAnalogF64" not in backend.service.trace:
        time.sleep(0.005)
    channel.close()  # as its death does
    assert (waiting.cancelled() or waiting.done()) and ended.wait(20)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make certificates")
def test_a_server_with_tls_is_reached_with_its_certificate_and_with_both(
    make_backend, served, tmp_path: Path, config
) -> None:
    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=tmp_path, check=True, capture_output=True)

    openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "s.key", "-out", "s.pem", "-days", "2",
            "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1")  # fmt: skip
    backend = make_backend(config)
    key, certificate = (tmp_path / "s.key").read_bytes(), (tmp_path / "s.pem").read_bytes()
    both = {"root_certificates": certificate, "require_client_auth": True}
    own = f"?ca={tmp_path}/s.pem"
    for asked, query, refused in ({}, own, ""), (both, f"{own}&cert={tmp_path}/s.pem&key={tmp_path}/s.key", own):
        credentials = grpc.ssl_server_credentials([(key, certificate)], **asked)
        port = int(served(backend, credentials=credentials)[1].rsplit(":", 1)[1])
        open_backend(f"ni-grpc://localhost:{port}{query}", config)._channel.close()
        with pytest.raises(Exception, match="does not answer"):
            open_backend(f"ni-grpc://localhost:{port}{refused}", config)
    with pytest.raises(InputError, match="allowed are ca=FILE"):
        open_backend("ni-grpc://localhost:1?cert=x", config)


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
