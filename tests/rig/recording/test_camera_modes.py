"""A camera that runs by itself: its exposures are counted on the AI clock and tell when each frame was taken."""

from __future__ import annotations

import numpy as np
import pytest

from pianorig.workflows.bench.dry_run import rehearse
from rig.errors import HardwareFault, InputError, RecordingFault
from rig.recording.recorder import record_session
from rig.recording.recover import recover_session
from rig.session import Session
from rig.session.journal.format import block_payload, read_journal
from rig.session.journal.trial_head import FrameClock
from rig.simulated.backend import CAMERA_CLOCK_ERROR
from rig.simulated.device.fault_injection import FaultPlan, parse_faults

COUNTED = (('mode = "pulses"', 'mode = "counted"'), ('terminal = "/cDAQ1Mod4/PFI4"', 'terminal = "/cDAQ1Mod4/PFI0"'))


def record(make_backend, rig, profile, folder, faults: str = "", **changes) -> Session:
    backend = make_backend(rig.config, noise_n=0.02)
    backend.device.faults = FaultPlan(parse_faults(faults))
    record_session(folder, profile=profile, rig_config=rig, backend=backend, trials=2, **changes)
    return backend


def test_counted_exposures_give_the_frame_times_within_their_uncertainty(
    edited_rig, make_backend, step_profile, tmp_path
) -> None:
    rig = edited_rig(*COUNTED)
    truths = []
    backend = make_backend(rig.config, noise_n=0.02)
    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=2,
        after_trial=lambda trial: truths.append(backend.device.bench.exposures),
    )  # fmt: skip
    for trial, true in zip(session.trials, truths, strict=True):
        data = trial.read()
        assert true.rate_hz == pytest.approx(2000 * (1 + CAMERA_CLOCK_ERROR), rel=1e-12)
        assert data.camera.n_frames == true.passed(data.time_s[-1:])[0]
        real = true.first_s + np.arange(data.camera.n_frames) / true.rate_hz + data.camera.exposure_s / 2
        error = data.camera.frame_time_s - real
        assert data.camera.u_time_s < 4e-5 and np.abs(error).max() < np.sqrt(3) * data.camera.u_time_s
    assert truths[0].first_s != truths[1].first_s


def test_what_was_counted_survives_in_the_journal(
    edited_rig, make_backend, step_profile, tmp_path, monkeypatch
) -> None:
    rig = edited_rig(*COUNTED)

    def full(*trial):
        raise InputError("full")

    with monkeypatch.context() as context, pytest.raises(RecordingFault):
        context.setattr("rig.session.folder.write_trial_parts", full)
        record(make_backend, rig, step_profile, tmp_path / "s")
    journal = read_journal(tmp_path / "s" / "trial_0001.journal")
    assert all(len(block_payload(b)) == 48 * b.force_n.size for b in journal.blocks)
    recover_session(tmp_path / "s")
    whole = record_session(
        tmp_path / "t", profile=step_profile, rig_config=rig, backend=make_backend(rig.config, noise_n=0.02), trials=1
    )
    assert Session.open(tmp_path / "s").trial(1).read().camera == whole.trial(1).read().camera


def test_too_few_exposures_are_no_frame_clock_and_a_line_is_fitted_exactly() -> None:
    clock = FrameClock(1000.0, 0.0, 2e-4, 0.0, counted=True)
    time_s = np.arange(1000) / 5000
    assert clock.frames_counted(time_s, np.zeros(1000, dtype=np.int64)) is None
    # an exposure at 0.37 of every third sample interval, from sample 4 on
    count = np.maximum((np.arange(1000) - 4) // 3 + 1, 0)
    found = clock.frames_counted(time_s, count)
    assert found.frame_rate_hz == pytest.approx(5000 / 3, rel=1e-6)
    assert found.first_frame_time_s == pytest.approx(3.5 / 5000 + 1e-4, abs=1e-7)
    assert found.u_time_s == pytest.approx(1e-4 / np.sqrt(3), rel=0.01)  # the phase within a sample stays unknown
    jumps = count + (np.arange(1000) > 500) * (count > 0)
    assert clock.frames_counted(time_s, jumps) is None  # a frame that was counted twice fits no line
    assert found.n_frames == count[-1]


def test_a_camera_without_a_free_counter_is_refused(edited_rig, tmp_path) -> None:
    with pytest.raises(InputError, match="one task per counter"):
        edited_rig(*COUNTED, ("Mod4/ctr3", "Mod4/ctr2"))
    fifth = edited_rig(*COUNTED, ("Mod4/ctr3", "Mod4/ctr4"))  # a chassis has four
    (tmp_path / "rig.toml").write_text(fifth.text)
    with pytest.raises(HardwareFault, match="ctr4: no such channel"):
        rehearse("forte", str(tmp_path / "rig.toml"), "sim://")
    with pytest.raises(InputError, match="allowed at most 2500 Hz"):
        edited_rig(*COUNTED, ("frame_rate_hz = 2000.0", "frame_rate_hz = 4000.0"))
    counted = edited_rig(*COUNTED)
    (tmp_path / "rig.toml").write_text(counted.text)
    tasks = rehearse("forte", str(tmp_path / "rig.toml"), "sim://")["tasks"]
    (row,) = [row for row in tasks if row["task"] == "exposures"]
    assert row["channel"] == "cDAQ1Mod4/ctr3" and row["routes"] == ("/cDAQ1Mod4/PFI0 -> counter source",)
    assert row["clock"].startswith("/cDAQ1/ai/SampleClock")
