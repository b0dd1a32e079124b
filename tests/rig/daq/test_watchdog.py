"""The client's ways with a watchdog: nothing but resets after its start, a reset of the device at the start and after a
trip, and no false trip over a slow connection.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from rig.backend import open_backend
from rig.configuration.rig_file import load_rig
from rig.errors import HardwareFault, NotSupported, WatchdogTripped
from rig.recording.recorder import record_session
from rig.simulated.rpc.tcp_server import serve
from rig.simulated.status import DaqStatusError

BUILT_IN = ("virtual", "pcie6363")


def watchdog_calls(backend: Any) -> list[str]:
    """Calls from the start of the watchdog to the start of the master."""
    trace = backend.service.trace
    begin = max(i for i, call in enumerate(trace) if call == "CreateWatchdogTimerTaskEx")
    return trace[begin:]


@pytest.mark.parametrize("name", BUILT_IN)
def test_nothing_but_resets_lies_between_the_watchdogs_start_and_its_first_reset(name, make_backend, command) -> None:
    backend = make_backend(load_rig(name).config)
    backend.configure(load_rig(name).config, command)
    backend.arm()
    backend.start()
    calls = watchdog_calls(backend)
    started = calls[calls.index("StartTask") :]
    assert started[:2] == ["StartTask", "ControlWatchdogTask"]
    resets = [i for i, call in enumerate(started) if call == "ControlWatchdogTask"]
    assert max(b - a for a, b in zip(resets, resets[1:], strict=False)) <= 4
    slow = ("Create", "Cfg", "GetTiming", "SetChan", "GetSystem", "GetWrite")
    assert not [call for call in started if call.startswith(slow)]


def test_the_watchdog_is_reset_by_the_devices_time_too(make_backend, config, command) -> None:
    """A served bench on a virtual clock runs faster than ours: resets by the wall clock alone would come too late."""
    far = make_backend(config)
    server, port = serve(far.service)
    remote = open_backend(f"ni-grpc://127.0.0.1:{port}", config)
    try:
        energise(remote, config, command)
        for _ in range(100):  # 2 s of the bench in much less of ours
            remote.read_block(100, 1.0)
        calls = far.service.trace.count("ControlWatchdogTask")
        assert 25 < calls < 60  # eight in a timeout of 0.5 s, not one a block
    finally:
        remote.close()
        server.stop(None).wait()


@pytest.mark.parametrize("name", BUILT_IN)
def test_after_a_trip_the_device_is_reset_and_the_next_trial_plays(name, make_backend, assert_safe, command) -> None:
    config = load_rig(name).config
    backend = make_backend(config)
    energise(backend, config, command)
    backend.device.bench.clock.advance(0.6)  # the program hangs
    with pytest.raises(WatchdogTripped, match="too slow"):
        for _ in range(3):
            backend.read_block(100, 1.0)
    assert backend.service.trace.count("ResetDevice") == 2  # at the start, and now
    assert_safe(backend)
    energise(backend, config, command)
    assert backend.read_block(400, 1.0).first_sample == 100
    backend.safe_stop()
    assert_safe(backend)


def energise(backend: Any, config: Any, command: Any) -> None:
    backend.configure(config, command)
    backend.arm()
    backend.start()
    backend.read_block(100, 1.0)


@pytest.mark.parametrize("name", BUILT_IN)
def test_what_a_killed_program_left_tripped_does_not_stop_the_next(name, make_backend, command, assert_safe) -> None:
    config = load_rig(name).config
    dead = make_backend(config)
    energise(dead, config, command)
    dead.device.bench.clock.advance(1.0)  # killed: nobody resets, nobody stops
    service = dead.service
    for task in list(dead.device.tasks):  # the driver of this computer ends the tasks of a process with it
        service.handle("ClearTask", _named(task))
    dead._tasks._tasks.clear()
    dead._outputs._tasks._tasks.clear()
    dead._watchdog.leave_running()
    dead.__init__(dead.device)  # the next program on the same device
    energise(dead, config, command)
    dead.safe_stop()
    assert_safe(dead)


def _named(task: str) -> Any:
    from rig.simulated.rpc.messages import request_class

    request = request_class("ClearTask")()
    request.task.name = task
    return request


@pytest.mark.parametrize(
    "delay_ms", [7, 20, 50, 150, pytest.param(1, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)]
)
def test_over_a_slow_connection_a_trial_plays_or_is_refused_before_anything_moves(delay_ms, tmp_path) -> None:
    backend = open_backend(f"sim://?delay_ms={delay_ms}", load_rig("virtual").config)
    moved: list[float] = []
    try:
        session = record_session(
            tmp_path / "s", profile="forte", backend=backend, trials=2,
            progress=lambda at: moved.append(at.peak_force_n),
        )  # fmt: skip
    except NotSupported as refused:
        assert delay_ms > 8.3 and f"takes {delay_ms} ms" in str(refused) and "allowed 8.33 ms" in str(refused)
        assert ("recording.block_s from" if delay_ms < 60 else "use a faster link") in str(refused) and moved == []
        assert not any(backend.device.output_v.values()) and not backend.device.drive_enabled()
        assert not (tmp_path / "s").exists()
    else:
        assert delay_ms < 8.3 and [trial.read().status for trial in session.trials] == ["complete"] * 2
    finally:
        backend.close()


def test_where_calls_are_dear_the_blocks_are_long_while_nothing_is_commanded_and_the_trial_is_the_same(
    make_backend, config, tmp_path
) -> None:
    read_s: dict[float, list[float]] = {}
    trials = []
    for delay_ms in (0.0, 0.4):
        backend = make_backend(config, noise_n=0.02)
        backend.device.call_delay_s = 1e-3 * delay_ms
        until = read_s[delay_ms] = []
        session = record_session(
            tmp_path / f"s{delay_ms}", profile="forte", backend=backend, trials=1,
            progress=lambda at, until=until: until.append(at.time_s),
        )  # fmt: skip
        backend.close()
        trials.append(session.trial(1).read())
    np.testing.assert_array_equal(trials[0].force_n, trials[1].force_n)
    np.testing.assert_array_equal(trials[0].encoder_count, trials[1].encoder_count)
    moved = np.flatnonzero(trials[0].motor_command_v) / 5000
    blocks = np.diff([0.0, *read_s[0.4]])
    begins = np.array([0.0, *read_s[0.4][:-1]])
    pushing = (begins + blocks > moved[0]) & (begins < moved[-1])
    assert blocks[pushing] == pytest.approx(0.02) and blocks[~pushing].max() == pytest.approx(0.04)
    assert len(read_s[0.4]) < 0.75 * len(read_s[0.0])


@pytest.mark.parametrize(("delay_ms", "block_s", "timeout_s"), [(20, 0.15, 1.0), (50, 0.36, 1.5)])
def test_the_advice_of_a_refusal_is_enough(delay_ms, block_s, timeout_s, edited_rig, tmp_path) -> None:
    rig = edited_rig(("block_s = 0.02", f"block_s = {block_s}"), ("timeout_s = 0.5", f"timeout_s = {timeout_s}"))
    session = record_session(
        tmp_path / "s", profile="forte", rig_config=rig, backend=f"sim://?delay_ms={delay_ms}", trials=1
    )
    assert session.trial(1).read().status == "complete"


def test_every_failure_on_the_way_to_safety_is_logged_and_a_defect_is_not_the_hardwares(
    make_backend, intercept, config, command, caplog
) -> None:
    backend = make_backend(config)
    energise(backend, config, command)

    def refuse(call: str, request: Any) -> None:
        if call.startswith("WriteDigital"):
            raise TypeError("a defect of the program")
        if call.startswith("WriteAnalog"):
            raise DaqStatusError(-201003)

    with intercept(backend, refuse), caplog.at_level(logging.ERROR, logger="rig.daq"), pytest.raises(TypeError):
        backend.safe_stop()
    said = [record.getMessage() for record in caplog.records]
    assert any(text.startswith("motor to 0 V failed: DeviceNotFound") for text in said), said
    assert any(text.startswith("drive disabled failed: TypeError") for text in said), said
    with pytest.raises(HardwareFault):
        backend.read_block(1, 0.1)
