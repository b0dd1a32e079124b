"""Every exit leaves the motor at 0 V and the drive disabled; every fault is typed, with code and phase."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rig.errors import (
    DeviceNotFound,
    HardwareFault,
    NotSupported,
    OutputUnderrun,
    ReadTimeout,
    ResourceBusy,
    SamplesLost,
)
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import stop_task
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.wait import advance


def run_into(backend: Any, config: Any, command: np.ndarray) -> None:
    backend.configure(config, command)
    backend.arm()
    backend.start()
    for _ in range(10):
        backend.read_block(100, 1.0)


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
    code, kind, phase, make_backend, assert_safe, intercept, config, command
) -> None:
    backend = make_backend(config)

    def fail(call: str, request: Any) -> None:
        if phase == "configure" and call == "CfgSampClkTiming" or phase == "read" and call.startswith("Read"):
            raise DaqStatusError(code)
        if call == "StartTask" and request.task.name == {"arm": "encoder_hammer", "start": "force"}.get(phase):
            raise DaqStatusError(code)

    with intercept(backend, fail), pytest.raises(kind) as fault:
        run_into(backend, config, command)
    assert type(fault.value) is kind
    assert (fault.value.code, fault.value.phase, fault.value.exit_code) == (code, phase, 3)
    assert "\n" not in str(fault.value) and str(code) in str(fault.value)
    assert_safe(backend)


def test_a_read_that_times_out_tells_how_many_samples_came(make_backend, assert_safe, config, command) -> None:
    backend = make_backend(config)
    backend.configure(config, command)
    backend.arm()
    backend.start()
    with pytest.raises(ReadTimeout) as fault:
        backend.read_block(100, 0.01)
    assert fault.value.samples_read == 50 and fault.value.code == -200284
    assert_safe(backend)


def test_a_program_that_reads_too_late_learns_that_samples_are_lost(
    make_backend, assert_safe, unwatched, command
) -> None:
    config = unwatched
    backend = make_backend(config)
    backend.configure(config, command)
    backend.arm()
    backend.start()
    backend.read_block(100, 1.0)
    advance(backend.device, 100_001)  # 20 s at 5 kHz is what the driver was told to keep
    with pytest.raises(SamplesLost, match="overwritten"):
        backend.read_block(100, 1.0)
    assert_safe(backend)


def test_an_exception_of_the_program_half_way_ends_at_zero_volts(make_backend, assert_safe, config, command) -> None:
    backend = make_backend(config)
    with pytest.raises(ZeroDivisionError):
        try:
            backend.configure(config, command)
            backend.arm()
            backend.start()
            backend.read_block(250, 1.0)
            assert backend.device.output_v["cDAQ1Mod2/ao0"] > 1.0
            _ = 1 / 0
        finally:
            backend.safe_stop()
    assert_safe(backend)


def test_a_stopped_output_would_hold_its_last_value(make_backend, config, command) -> None:
    """The hazard that the 0 V task is there for: without it the virtual DAC stays where it was."""
    backend = make_backend(config)
    backend.configure(config, command)
    backend.arm()
    backend.start()
    backend.read_block(250, 1.0)
    stop_task(backend.device, backend.device.tasks["motor"])
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == command[249] > 1.0


def test_when_zero_volts_cannot_be_written_the_drive_is_still_disabled_and_the_fault_reported(
    make_backend, intercept, config, command
) -> None:
    backend = make_backend(config)
    energised(backend, config, command)

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


def energised(backend: Any, config: Any, command: np.ndarray) -> None:
    backend.configure(config, command)
    backend.arm()
    backend.start()
    backend.read_block(250, 1.0)
    assert backend.device.output_v["cDAQ1Mod2/ao0"] > 1.0 and backend.device.drive_enabled()


@pytest.mark.parametrize("way_out", ["end", "close", "fault", "exception", "limit", "next configure"])
def test_every_way_out_de_energises_in_the_same_order(
    way_out, make_backend, assert_safe, intercept, config, command
) -> None:
    backend = make_backend(config)
    steps = []
    energised(backend, config, command)
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
