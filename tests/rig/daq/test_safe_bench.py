"""Every exit leaves the motor at 0 V and the drive disabled; every fault is typed, with code and phase.

Tasks are made once for all trials, hold nothing between two of them, and are made afresh after a fault.

The client's ways with a watchdog: nothing but resets after its start, a reset of the device at the start and after a
trip, and no false trip over a slow connection.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from rig import (
    DeviceNotFound,
    HardwareFault,
    NotSupported,
    OutputUnderrun,
    ReadTimeout,
    ResourceBusy,
    SamplesLost,
    WatchdogTripped,
    load_rig,
    open_backend,
)
from rig import (
    record as record_session,
)
from rig.daq.safe_bench import leave_running
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import clear_task
from rig.simulated.rpc.messages import request_class
from rig.simulated.status import DaqStatusError, ServerGone


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (-200279, SamplesLost),
        (-200284, ReadTimeout),
        (-200290, OutputUnderrun),
        (-50103, ResourceBusy),
        (-201003, DeviceNotFound),
        (-200170, NotSupported),
        (-299999, HardwareFault),
    ],
)
@pytest.mark.parametrize("phase", ["configure", "arm", "start", "read"])
def test_every_fault_is_typed_with_code_and_phase_and_leaves_the_bench_safe(
    code, kind, phase, make_backend, assert_safe, intercept, config, begin
) -> None:
    backend = make_backend(config)

    def fail(call: str, request: Any) -> None:
        if phase == "configure" and call == "CfgSampClkTiming" or phase == "read" and call.startswith("Read"):
            raise DaqStatusError(code)
        if call == "StartTask" and request.task.name == {"arm": "encoder_hammer", "start": "force"}.get(phase):
            raise DaqStatusError(code)

    with intercept(backend, fail), pytest.raises(kind) as fault:
        begin(backend, 100)
    assert type(fault.value) is kind
    assert (fault.value.code, fault.value.phase, fault.value.exit_code) == (code, phase, 3)
    assert "\n" not in str(fault.value) and str(code) in str(fault.value)
    assert_safe(backend)


def test_when_zero_volts_cannot_be_written_the_drive_is_still_disabled_and_the_fault_reported(
    make_backend, intercept, config, begin
) -> None:
    backend = make_backend(config)
    begin(backend, 250)
    assert backend.device.drive_enabled()

    def refuse(call: str, request: Any) -> None:
        if call.startswith("WriteAnalog"):
            raise DaqStatusError(-201003)

    with intercept(backend, refuse), pytest.raises(DeviceNotFound) as fault:
        backend.safe_stop()
    assert fault.value.phase == "stop"
    device = backend.device
    assert not device.drive_enabled() and list(device.tasks) == ["watchdog"]  # left to make it safe
    assert device.output_v["cDAQ1Mod2/ao0"] != 0.0
    device.bench.clock.advance(0.51)
    check_watchdogs(device)
    assert device.output_v["cDAQ1Mod2/ao0"] == 0.0


@pytest.mark.parametrize("way_out", ["end", "close", "fault", "exception", "limit", "next configure"])
def test_every_way_out_de_energises_in_the_same_order(
    way_out, make_backend, assert_safe, intercept, config, command, begin
) -> None:
    backend = make_backend(config)
    steps = []
    begin(backend, 250)
    assert backend.device.output_v["cDAQ1Mod2/ao0"] > 1.0 and backend.device.drive_enabled()
    names = {"WriteAnalog": "volts", "WriteDigit": "line", "StopTask": "stop", "ClearTask": "stop"}
    error = DaqStatusError(-200279) if way_out == "fault" else ZeroDivisionError("program")

    def note(call: str, request: Any) -> None:
        if step := next((step for name, step in names.items() if call.startswith(name)), None):
            steps.append((step, request.task.name))
        if call.startswith("Read"):
            raise error

    with intercept(backend, note):
        if way_out in ("end", "limit"):  # after a limit the recorder calls safe_stop, as at the end
            backend.safe_stop()
        elif way_out == "close":
            backend.close()
        elif way_out == "next configure":
            backend.configure(config, command)
            steps = steps[: steps.index(("stop", "watchdog")) + 1]
            backend.safe_stop()
        else:
            with pytest.raises(SamplesLost if way_out == "fault" else ZeroDivisionError):
                backend.read_block(100, 1.0)
    wanted = [
        ("stop", "motor"),
        ("volts", "motor_zero"),
        ("stop", "motor_zero"),
        ("line", "drive_enable"),
        ("stop", "drive_enable"),
        ("stop", "force"),
    ]
    assert steps[: len(wanted)] == wanted and steps[-1] == ("stop", "watchdog")
    assert_safe(backend)


@pytest.fixture
def blow(begin) -> Any:
    """Play a blow: force and counts of 1000 samples."""

    def play(backend: Any, command: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        begin(backend) if command is None else begin(backend, command=command)
        blocks = [backend.read_block(100, 1.0) for _ in range(10)]
        backend.safe_stop()
        return np.concatenate([b.force_n for b in blocks]), np.concatenate([b.encoder_count for b in blocks])

    return play


def made(backend: Any) -> int:
    return sum(call in ("CreateTask", "CreateWatchdogTimerTaskEx") for call in backend.service.trace)


def test_further_trials_make_no_task_and_read_what_fresh_tasks_read(
    make_backend, assert_safe, config, command, blow
) -> None:
    backend = make_backend(config)
    longer = np.concatenate((1.3 * command[:-1], np.zeros(77)))
    first, other = blow(backend), blow(backend, longer)
    tasks = made(backend)
    assert tasks == 11  # force, three encoders, motor, camera, watchdog; its zero, drive enable: before and after reset
    again = blow(backend)
    assert made(backend) == tasks
    assert_safe(backend)
    for trial, (seen, volts) in enumerate(((first, command), (other, longer), (again, command))):
        alone = make_backend(config)
        alone.continue_after(trial)
        fresh = blow(alone, volts)
        np.testing.assert_array_equal(seen[0], fresh[0])
        np.testing.assert_array_equal(seen[1], fresh[1])
    assert not np.array_equal(first[1], other[1])


def test_after_a_fault_all_tasks_are_made_afresh(make_backend, intercept, config, begin, blow) -> None:
    backend = make_backend(config)
    blow(backend)
    begin(backend)

    def fail(call: str, request: Any) -> None:
        if call.startswith("Read"):
            raise DaqStatusError(-200279)

    with intercept(backend, fail), pytest.raises(SamplesLost):
        backend.read_block(100, 1.0)
    assert backend.device.tasks == {}
    tasks = made(backend)
    backend.continue_after(0)
    np.testing.assert_array_equal(blow(backend)[1], blow(make_backend(config))[1])
    assert made(backend) == tasks + 9


def test_another_rig_file_gets_tasks_of_its_own(make_backend, config, command, blow) -> None:
    backend = make_backend(config)
    blow(backend)
    camera = config.camera.model_copy(update={"frame_rate_hz": 1234.0})
    timing = backend.configure(config.model_copy(update={"camera": camera}), command)
    assert timing.frame_rate_hz == pytest.approx(1234.0, rel=1e-4) and timing.frame_rate_hz != 2000.0
    backend.safe_stop()
    assert backend.configure(config, command).frame_rate_hz == 2000.0


def test_the_motor_is_put_at_zero_even_when_the_kept_task_is_gone(make_backend, config, begin, blow) -> None:
    """As after a restart of the server: what it was told before, it does not know any more."""
    backend = make_backend(config)
    blow(backend)
    begin(backend, 250)
    for task in ("motor_zero", "drive_enable"):
        clear_task(backend.device, task)
    assert backend.device.output_v["cDAQ1Mod2/ao0"] > 1.0 and backend.device.drive_enabled()
    backend.safe_stop()
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not backend.device.drive_enabled()


def test_after_a_watchdog_that_expired_unseen_the_next_trial_is_sound(make_backend, config, begin, blow) -> None:
    backend = make_backend(config)
    begin(backend, 250)
    backend.device.bench.clock.advance(10 * config.watchdog.timeout_s)
    backend.safe_stop()
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not backend.device.drive_enabled()
    backend.continue_after(0)
    np.testing.assert_array_equal(blow(backend)[1], blow(make_backend(config))[1])


def test_a_task_whose_clearing_the_server_did_not_hear_does_not_stand_in_the_way_of_the_next(
    make_backend, intercept, config, command
) -> None:
    backend = make_backend(config)
    backend.configure(config, command)
    lost: list[str] = []

    def fail(call: str, request: Any) -> None:
        if call == "ClearTask" and not lost:
            lost.append(request.task.name)
            raise ServerGone("planted")

    with intercept(backend, fail):
        backend.safe_stop()
        backend._clear()
    assert lost == ["force"]
    backend.configure(config, command)
    backend.safe_stop()
    backend.close()


BUILT_IN = ("virtual", "pcie6363")


@pytest.mark.parametrize("name", BUILT_IN)
def test_nothing_but_resets_lies_between_the_watchdogs_start_and_its_first_reset(name, make_backend, begin) -> None:
    config = load_rig(name).config
    backend = make_backend(config)
    begin(backend, config=config)
    calls = backend.service.trace
    started = calls[calls.index("StartTask", len(calls) - calls[::-1].index("CreateWatchdogTimerTaskEx")) :]
    assert started[:2] == ["StartTask", "ControlWatchdogTask"]
    resets = [i for i, call in enumerate(started) if call == "ControlWatchdogTask"]
    assert max(b - a for a, b in zip(resets, resets[1:], strict=False)) <= 4
    slow = ("Create", "Cfg", "GetTiming", "SetChan", "GetSystem", "GetWrite")
    assert not [call for call in started if call.startswith(slow)]


@pytest.mark.usefixtures("on_any_machine")
def test_the_watchdog_is_reset_by_the_devices_time_too(make_backend, config, begin, served) -> None:
    """A served bench on a virtual clock runs faster than ours: resets by the wall clock alone would come too late."""
    far = make_backend(config)
    remote = open_backend(served(far)[1], config)
    begin(remote, 100)
    for _ in range(100):  # 2 s of the bench in much less of ours
        remote.read_block(100, 1.0)
    calls = far.service.trace.count("ControlWatchdogTask")
    remote.close()
    assert 25 < calls < 60  # eight in a timeout of 0.5 s, not one a block


@pytest.mark.parametrize("name", BUILT_IN)
def test_after_a_trip_the_device_is_reset_and_the_next_trial_plays(name, make_backend, assert_safe, begin) -> None:
    config = load_rig(name).config
    backend = make_backend(config)
    begin(backend, 100, config)
    backend.device.bench.clock.advance(0.6)  # the program hangs
    with pytest.raises(WatchdogTripped, match="too slow"):
        for _ in range(3):
            backend.read_block(100, 1.0)
    assert backend.service.trace.count("ResetDevice") == 2  # at the start, and now
    assert_safe(backend)
    begin(backend, 100, config)
    assert backend.read_block(400, 1.0).first_sample == 100
    backend.safe_stop()
    assert_safe(backend)


@pytest.mark.parametrize("name", BUILT_IN)
def test_what_a_killed_program_left_tripped_does_not_stop_the_next(name, make_backend, begin, assert_safe) -> None:
    config = load_rig(name).config
    dead = make_backend(config)
    begin(dead, 100, config)
    dead.device.bench.clock.advance(1.0)  # killed: nobody resets, nobody stops
    service = dead.service
    for task in list(dead.device.tasks):  # the driver of this computer ends the tasks of a process with it
        service.handle("ClearTask", request_class("ClearTask")(task={"name": task}))
    dead._tasks._tasks.clear()
    dead._outputs._tasks._tasks.clear()
    leave_running(dead._watchdog)
    dead.__init__(dead.device)  # the next program on the same device
    begin(dead, 100, config)
    dead.safe_stop()
    assert_safe(dead)


@pytest.mark.parametrize("delay_ms", [7, 20, 50, 150])
def test_over_a_slow_connection_a_trial_plays_or_is_refused_before_anything_moves(delay_ms, tmp_path) -> None:
    backend = open_backend(f"sim://?delay_ms={delay_ms}", load_rig("virtual").config)
    moved: list[float] = []
    try:
        session = record_session(
            tmp_path / "s", profile="forte", backend=backend, trials=2,
            progress=lambda at: moved.append(at.raw_peak_force_n),
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
    np.testing.assert_array_equal(trials[0].raw_force_n, trials[1].raw_force_n)
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
    make_backend, intercept, config, begin, caplog
) -> None:
    backend = make_backend(config)
    begin(backend, 100)

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
