"""Tasks are made once for all trials, hold nothing between two of them, and are made afresh after a fault."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from rig.errors import SamplesLost
from rig.simulated.driver import clear_task
from rig.simulated.status import DaqStatusError, ServerGone


def energise(backend: Any, config: Any, command: np.ndarray) -> None:
    backend.configure(config, command)
    backend.arm()
    backend.start()


def blow(backend: Any, config: Any, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    energise(backend, config, command)
    blocks = [backend.read_block(100, 1.0) for _ in range(10)]
    backend.safe_stop()
    return np.concatenate([b.force_n for b in blocks]), np.concatenate([b.encoder_count for b in blocks])


def made(backend: Any) -> int:
    return sum(call in ("CreateTask", "CreateWatchdogTimerTaskEx") for call in backend.service.trace)


def test_further_trials_make_no_task_and_read_what_fresh_tasks_read(make_backend, assert_safe, config, command) -> None:
    backend = make_backend(config)
    longer = np.concatenate((1.3 * command[:-1], np.zeros(77)))
    first, other = blow(backend, config, command), blow(backend, config, longer)
    tasks = made(backend)
    assert tasks == 11  # force, three encoders, motor, camera, watchdog; its zero, drive enable: before and after reset
    again = blow(backend, config, command)
    assert made(backend) == tasks
    assert_safe(backend)
    for trial, (seen, volts) in enumerate(((first, command), (other, longer), (again, command))):
        alone = make_backend(config)
        alone.continue_after(trial)
        fresh = blow(alone, config, volts)
        np.testing.assert_array_equal(seen[0], fresh[0])
        np.testing.assert_array_equal(seen[1], fresh[1])
    assert not np.array_equal(first[1], other[1])


def test_trials_leave_nothing_for_the_garbage_collector(make_backend, config, command) -> None:
    """Tasks of the client refer to themselves: made anew each time they are memory that comes back late."""
    backend = make_backend(config)
    blow(backend, config, command)
    gc.disable()
    gc.freeze()  # what is there already is neither searched nor counted
    try:
        for _ in range(5):
            blow(backend, config, command)
        grown = len(gc.get_objects())
    finally:
        gc.unfreeze()
        gc.enable()
    assert grown < 200, f"{grown} objects more after five trials"


def test_after_a_fault_all_tasks_are_made_afresh(make_backend, intercept, config, command) -> None:
    backend = make_backend(config)
    blow(backend, config, command)
    energise(backend, config, command)

    def fail(call: str, request: Any) -> None:
        if call.startswith("Read"):
            raise DaqStatusError(-200279)

    with intercept(backend, fail), pytest.raises(SamplesLost):
        backend.read_block(100, 1.0)
    assert backend.device.tasks == {}
    tasks = made(backend)
    backend.continue_after(0)
    np.testing.assert_array_equal(blow(backend, config, command)[1], blow(make_backend(config), config, command)[1])
    assert made(backend) == tasks + 9


def test_another_rig_file_gets_tasks_of_its_own(make_backend, config, command) -> None:
    backend = make_backend(config)
    blow(backend, config, command)
    camera = config.camera.model_copy(update={"frame_rate_hz": 1234.0})
    timing = backend.configure(config.model_copy(update={"camera": camera}), command)
    assert timing.frame_rate_hz == pytest.approx(1234.0, rel=1e-4) and timing.frame_rate_hz != 2000.0
    backend.safe_stop()
    assert backend.configure(config, command).frame_rate_hz == 2000.0


def test_the_motor_is_put_at_zero_even_when_the_kept_task_is_gone(make_backend, config, command) -> None:
    """As after a restart of the server: what it was told before, it does not know any more."""
    backend = make_backend(config)
    blow(backend, config, command)
    energise(backend, config, command)
    backend.read_block(250, 1.0)
    for task in ("motor_zero", "drive_enable"):
        clear_task(backend.device, task)
    assert backend.device.output_v["cDAQ1Mod2/ao0"] > 1.0 and backend.device.drive_enabled()
    backend.safe_stop()
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not backend.device.drive_enabled()


def test_after_a_watchdog_that_expired_unseen_the_next_trial_is_sound(make_backend, config, command) -> None:
    backend = make_backend(config)
    energise(backend, config, command)
    backend.read_block(250, 1.0)
    backend.device.bench.clock.advance(10 * config.watchdog.timeout_s)
    backend.safe_stop()
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not backend.device.drive_enabled()
    backend.continue_after(0)
    np.testing.assert_array_equal(blow(backend, config, command)[1], blow(make_backend(config), config, command)[1])


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
