"""``serve-sim`` in another process: a session over TCP, and the server's own watchdog when its client is killed."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianorig.cli import main
from pianorig.prediction import predictor
from rig.config import load_rig
from rig.errors import DeviceNotFound, NotPermitted
from rig.permission import Permission
from rig.profile import load_profile
from rig.recorder import record_session
from rig.recover import recover_session
from rig.selftest_record import Finding, SelftestRecord, read_record
from rig.session import Session
from rig.simulated.watchdog import LOW

DEADLINE_S = 60.0
STEP = Path(__file__).parents[1] / "step.toml"


class Program:
    """A command of this tool in another process, and its lines as they come."""

    def __init__(self, *arguments: str) -> None:
        code = "from pianorig.cli import main; main()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            stdout=subprocess.PIPE,
            text=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._pump = threading.Thread(target=self._take, daemon=True)
        self._pump.start()

    def _take(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first JSON line that is wanted."""
        end = time.monotonic() + DEADLINE_S
        while True:
            found = json.loads(self._lines.get(timeout=max(end - time.monotonic(), 0.0)))
            if wanted(found):
                return found

    def end(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(DEADLINE_S)
        self._pump.join(DEADLINE_S)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code


@pytest.fixture
def serve() -> Iterator[Callable[..., tuple[Program, str]]]:
    """Start ``serve-sim``; returns (program, backend address)."""
    running = []

    def start(*arguments: str) -> tuple[Program, str]:
        program = Program("serve-sim", "--port", "0", "--log", "--json", *arguments)
        running.append(program)
        return program, "ni-grpc://" + program.wait_for(lambda line: "address" in line)["address"]

    yield start
    for program in running:
        program.end()


@pytest.fixture
def permitted(tmp_path) -> list[str]:
    """Options of ``record`` that let the motor of a virtual bench behind TCP move."""
    rig_file = tmp_path / "rig.toml"
    rig_file.write_text(load_rig("virtual").text.replace("allow_yes = false", "allow_yes = true"))
    rig = load_rig(rig_file)
    record = SelftestRecord(
        created_utc=datetime.now(UTC), rig="virtual", rig_sha256=rig.sha256, product="cDAQ-9189", device="cDAQ1",
        backend="test", simulated=True, findings=(Finding(check="all", passed=True, found="", allowed=""),),
    )  # fmt: skip
    return ["--rig", str(rig_file), "--yes", "--selftest", str(record.write(tmp_path))]


def test_a_session_recorded_over_tcp_is_the_one_recorded_in_process(serve, permitted, tmp_path) -> None:
    program, address = serve("--clock", "virtual", "--seed", "5")
    assert address.startswith("ni-grpc://127.0.0.1:")
    rig = load_rig(permitted[1])
    arguments = {"profile": load_profile(STEP), "rig_config": rig, "trials": 2, "predict": predictor(rig)}
    with pytest.raises(NotPermitted):
        record_session(tmp_path / "far", backend=address, **arguments)
    permission = Permission("--yes", rig.sha256, read_record(Path(permitted[4])))
    far = record_session(tmp_path / "far", backend=address, permission=permission, **arguments)
    near = record_session(tmp_path / "near", backend="sim://?seed=5", **arguments)
    assert far.info.simulated and "gRPC Device Server" in far.info.backend["name"]
    for there, here in zip(far.trials, near.trials, strict=True):
        a, b = there.read(), here.read()
        for name in ("time_s", "force_n", "force_raw", "motor_command_v", "encoder_count"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert program.end() == 0


@pytest.mark.skipif(os.name == "nt", reason="kills with SIGKILL")
def test_when_the_recording_program_is_killed_the_watchdog_makes_the_outputs_safe(serve, permitted, tmp_path) -> None:
    server, address = serve("--clock", "real")
    profile = tmp_path / "long.toml"
    profile.write_text(
        'name = "long"\npoints = [{time_s=0,force_n=0},{time_s=0.1,force_n=3},{time_s=20,force_n=3},'
        "{time_s=21,force_n=0}]"
    )
    folder = tmp_path / "s"
    recorder = Program("record", "--profile", str(profile), "--backend", address, "--out", str(folder), *permitted)
    live = server.wait_for(lambda line: line["motor"] == "live")
    assert live["drive"] == "enabled"
    recorder.end(signal.SIGKILL)
    safe = server.wait_for(lambda line: line["motor"] == "0 V")
    assert (safe["drive"], safe["watchdog"]) == ("disabled", "tripped")
    assert safe["time_s"] - live["time_s"] < 0.5 + 1.0  # timeout; and what passed until the kill, on a busy machine
    (entry,) = recover_session(folder)
    data = Session.open(folder).trial(1).read()
    assert data.status == entry.status == "incomplete"
    # counted by the server, which outlives the program: at most 100 ms were acquired and not committed
    assert safe["samples"] - 500 <= data.n_valid <= safe["samples"]
    assert data.n_valid >= 1500  # the blow begins with sample 1751


@pytest.mark.skipif(os.name == "nt", reason="Windows ends a program without asking it")
@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_a_recording_asked_to_end_makes_the_outputs_safe_itself_and_seals_the_trial(
    serve, permitted, tmp_path, number
) -> None:
    server, address = serve("--clock", "real")
    folder = tmp_path / "s"
    recorder = Program("record", "--profile", "forte", "--backend", address, "--out", str(folder), *permitted)
    server.wait_for(lambda line: line["motor"] == "live")
    assert recorder.end(number) == 130
    safe = server.wait_for(lambda line: line["motor"] == "0 V" and line["drive"] == "disabled")
    assert safe["watchdog"] == "quiet"
    (trial,) = Session.open(folder).trials
    assert trial.status == "interrupted" and trial.read().n_valid > 1750
    assert "stopped by" in trial.read().reason and recover_session(folder) == []


@pytest.mark.slow
def test_when_the_server_dies_the_trial_ends_with_what_was_committed(serve, permitted, tmp_path) -> None:
    server, address = serve("--clock", "real")
    rig = load_rig(permitted[1])
    permission = Permission("--yes", rig.sha256, read_record(Path(permitted[4])))
    committed = []

    def progress(state) -> None:
        committed.append(round(state.committed_s * 5000))
        if state.time_s > 0.4:
            server.process.kill()

    with pytest.raises(DeviceNotFound, match="does not answer"):
        record_session(
            tmp_path / "s", profile=load_profile(STEP), rig_config=rig, backend=address, trials=2,
            permission=permission, predict=predictor(rig), progress=progress,
        )  # fmt: skip
    (trial,) = Session.open(tmp_path / "s").trials
    data = trial.read()
    assert trial.status == "fault" and "use the emergency stop" in data.reason
    assert data.n_valid >= committed[-1] >= 2000


def test_what_serve_sim_cannot_do_is_one_line(capsys) -> None:
    for arguments in (
        ["--clock", "never"],
        ["--rig", "none"],
        ["--port", "0", "--bench", "none.toml"],
        ["--fault", "late@1/2"],
    ):
        with pytest.raises(SystemExit) as end:
            main(["serve-sim", *arguments])
        assert end.value.code == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def watchdog_task(bench: Any, device: str, timeout_s: float = 0.5, name: str = "dog") -> Any:
    from nidaqmx import GrpcSessionOptions
    from nidaqmx.system.watchdog import WatchdogTask

    task = WatchdogTask(device, name, timeout_s, grpc_options=GrpcSessionOptions(bench._channel, name))
    bench._tasks.append(task)
    return task


def test_the_watchdog_reaches_what_the_product_lets_it_reach(cdaq, card, refused) -> None:
    from nidaqmx.constants import Level, WatchdogAOExpirState
    from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState

    for bench, device, ao, line in (
        (cdaq, "cDAQ1", "cDAQ1Mod2/ao0", "cDAQ1Mod4/port0/line7"),
        (card, "Dev1", "Dev1/ao0", "Dev1/port0/line0"),
    ):
        task = watchdog_task(bench, device)
        task.cfg_watchdog_do_expir_states([DOExpirationState(line, Level.LOW)])
        assert bench.device.watchdogs.timer("dog").lines == {line: False} and Level.LOW.value == LOW
        states = [AOExpirationState(ao, 0.0, WatchdogAOExpirState.VOLTAGE)]
        if bench is card:
            with refused(-200662):
                task.cfg_watchdog_ao_expir_states(states)
        else:
            task.cfg_watchdog_ao_expir_states(states)
        bench.device.output_v[ao], bench.device.lines[line] = 3.0, True
        task.start()
        bench.device.bench.clock.advance(0.4)
        task.reset_timer()
        bench.device.bench.clock.advance(0.4)
        assert not task.expired and bench.device.output_v[ao] == 3.0
        bench.device.bench.clock.advance(0.11)
        assert task.expired and bench.device.lines[line] is False
        assert bench.device.output_v[ao] == (3.0 if bench is card else 0.0)
        with refused(-200644):
            task.reset_timer()
        task.clear_expiration()
        assert not task.expired
    with refused(-200668):
        watchdog_task(cdaq, "cDAQ1", 100.0, "long")


def test_outputs_cannot_be_written_while_an_expired_watchdog_holds_them(cdaq, refused) -> None:
    from nidaqmx.constants import WatchdogAOExpirState
    from nidaqmx.system.watchdog import AOExpirationState

    other = cdaq.task("other")
    other.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    other.start()
    task = watchdog_task(cdaq, "cDAQ1")
    task.cfg_watchdog_ao_expir_states([AOExpirationState("cDAQ1Mod2/ao0", 0.0, WatchdogAOExpirState.VOLTAGE)])
    with refused(-201477):
        task.start()
    other.stop()
    task.start()
    cdaq.device.bench.clock.advance(0.6)
    with refused(-200678):
        other.write(1.0, auto_start=True)
    task.clear_expiration()
    other.write(1.0, auto_start=True)
    assert cdaq.device.output_v["cDAQ1Mod2/ao0"] == 1.0
