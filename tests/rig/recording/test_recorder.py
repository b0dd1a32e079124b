"""The recorder: quiet, blow, rest; what was recorded is kept and marked; bad input leaves nothing behind.

The feed drops the oldest and counts what it dropped.
"""

from __future__ import annotations

import itertools
import os
import shutil

import numpy as np
import pytest

from rig import (
    Block,
    BlockFeed,
    HardwareFault,
    InputError,
    LimitExceeded,
    RecordingFault,
    SamplesLost,
    Session,
    parse_profile,
)
from tests.rig.fake_backend import MV_PER_V_PER_N, RAD_PER_VOLT, RATE_HZ, FakeBackend


@pytest.fixture
def record(tmp_path, rig, record_steps):
    """Record two trials on the fake bench; returns (session folder, backend, call)."""
    backend = FakeBackend(noise_n=0.02)
    return tmp_path / "s", backend, lambda **more: record_steps(rig, **{"backend": backend, "trials": 2, **more})


def test_a_session_holds_quiet_blow_and_rest_of_every_trial(record, step_profile) -> None:
    folder, backend, call = record
    call(operator="ana", action_name="Boston", notes={"weather": "dry"})
    session = Session.open(folder)
    assert (session.info.operator, session.info.action.name, session.info.simulated) == ("ana", "Boston", True)
    assert session.info.profile.sha256 == step_profile.sha256
    assert (folder / "profile.toml").read_text() == step_profile.text
    assert {"python", "numpy", "nidaqmx", "piano-action-rig"} <= set(session.info.software)
    assert [t.status for t in session.trials] == ["complete", "complete"]
    for trial in session.trials:
        data = trial.read()
        onset = data.time_s[np.flatnonzero(data.motor_command_v)[0]]
        assert onset >= 0.3 and data.blow_start_s == pytest.approx(onset, abs=2.1e-4)
        last_moving = np.flatnonzero(np.any(np.diff(data.encoder_count, axis=0) != 0, axis=1))[-1] + 1
        assert data.time_s[-1] - data.time_s[last_moving] >= 0.2 - 2e-4
        assert data.time_s[-1] < 0.9
        np.testing.assert_allclose(data.time_s, np.arange(data.n_valid) / 5000, atol=1e-12)
        felt = np.concatenate(([0.0], data.motor_command_v[:-1]))
        expected = felt[:, None] * RAD_PER_VOLT
        assert np.max(np.abs(data.angle_rad - expected)) < 2 * np.pi / 163840
        assert data.motor_command_v.max() == pytest.approx(0.5) and data.motor_command_v[-1] == 0
        assert np.std(data.raw_force_n - 0.05 - 12 * felt) == pytest.approx(0.02, rel=0.05)
        np.testing.assert_allclose(data.force_raw, data.raw_force_n * MV_PER_V_PER_N, atol=1e-12)
    assert backend.is_safe


def test_frame_times_lie_within_the_record_at_the_middle_of_each_exposure(record) -> None:
    _, _, call = record
    data = call(trials=1).trials[0].read()
    camera = data.camera
    assert camera.frame_time_s[:2] == pytest.approx([1.05e-3, 1.55e-3])
    end = camera.frame_time_s[-1] + camera.exposure_s / 2
    assert end <= data.time_s[-1] < end + 1 / camera.frame_rate_hz


def test_progress_and_feed_see_every_block_and_a_full_feed_never_holds_up(record) -> None:
    _, _, call = record
    seen, feed = [], BlockFeed(capacity=3)
    session = call(trials=2, progress=seen.append, feed=feed)
    lengths = [trial.read().n_valid for trial in session.trials]
    assert len(seen) == sum(lengths) // 100 == feed.n_dropped + 3
    assert [(p.trial, p.trials) for p in seen[:1] + seen[-1:]] == [(1, 2), (2, 2)]
    assert seen[-1].time_s == pytest.approx(lengths[1] / 5000)
    assert max(p.raw_peak_force_n for p in seen) == pytest.approx(6.05, abs=0.1)


def test_the_drivers_own_count_must_be_what_is_stored(record) -> None:
    folder, backend, call = record
    counted = backend.read_positions
    seen: list[int] = []

    def short() -> dict[str, tuple[int, int]]:
        positions = counted()
        assert len(positions) == 4
        seen.extend(handed_out for handed_out, _ in positions.values())
        first = next(iter(positions))
        return positions if len(seen) < 8 else {**positions, first: (positions[first][0] + 1, positions[first][1] + 1)}

    backend.read_positions = short
    with pytest.raises(SamplesLost, match="samples are missing or doubled"):
        call()
    trials = Session.open(folder).trials
    assert [trial.status for trial in trials] == ["complete", "fault"]
    assert seen[:4] == [trials[0].read().n_valid] * 4


def test_before_each_trial_the_recorder_waits_with_the_outputs_safe(record) -> None:
    folder, backend, call = record
    began = []

    def wait(number: int) -> None:
        began.append(number)
        if number == 2:
            assert backend.is_safe
            assert [trial.status for trial in Session.open(folder).trials] == ["complete"]
        if number == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        call(trials=5, before_trial=wait)
    assert began == [1, 2, 3]
    assert [trial.status for trial in Session.open(folder).trials] == ["complete"] * 2  # the third did not begin


def stop_at(trial: int, time_s: float, error: BaseException):
    def progress(state) -> None:
        if state.trial == trial and state.time_s >= time_s:
            raise error

    return progress


def test_ctrl_c_keeps_and_marks_what_was_recorded(record) -> None:
    folder, backend, call = record
    with pytest.raises(KeyboardInterrupt):
        call(trials=5, progress=stop_at(2, 0.38, KeyboardInterrupt()))
    trials = Session.open(folder).trials
    assert [t.status for t in trials] == ["complete", "interrupted"]
    data = trials[1].read()
    assert data.n_valid == 1900 and data.reason == "stopped by the operator"
    assert data.motor_command_v[-1] == pytest.approx(0.5)  # the motor was pushing when it came
    assert backend.is_safe


def test_an_exception_of_the_program_keeps_and_marks_too(record) -> None:
    folder, backend, call = record
    with pytest.raises(ZeroDivisionError):
        call(progress=stop_at(1, 0.4, ZeroDivisionError("oops\0")))
    (trial,) = Session.open(folder).trials
    assert (trial.status, trial.read().reason) == ("defect", "ZeroDivisionError: oops")
    assert backend.is_safe


def test_a_folder_that_was_there_stays_empty_after_a_fault_before_the_first_sample(record) -> None:
    folder, backend, call = record
    folder.mkdir()
    backend.plan_fault("configure", HardwareFault("reserved"))
    with pytest.raises(HardwareFault):
        call()
    assert list(folder.iterdir()) == []


@pytest.fixture
def record_creeping(edited_rig, record_steps):
    """Record on a bench whose whippen goes on turning after the blow, at so many rad/s."""
    rig = edited_rig(("longest_s = 3.0", "longest_s = 0.5"))
    backend = FakeBackend(noise_n=0.02)

    def record(rad_per_s: float, trials: int) -> Session:
        def creep(block: Block) -> Block:
            time_s = (block.first_sample + np.arange(block.force_n.size)) / RATE_HZ
            turned = rad_per_s * np.maximum(time_s - 0.36, 0) / rig.config.encoders[1].rad_per_count
            block.encoder_count[:, 1] += np.rint(turned).astype(np.int64)
            return block

        backend.change_block = creep
        return record_steps(rig, backend=backend, trials=trials)

    return record


def test_an_action_that_never_rests_is_kept_and_says_so(record_creeping) -> None:
    data = record_creeping(0.01, trials=1).trials[0].read()
    assert data.status == "not at rest" and data.reason == "not at rest 0.5 s after the blow"
    assert data.time_s[-1] == pytest.approx(0.35 + 0.08 + 0.5, abs=0.021)


def test_an_action_that_has_not_come_back_is_not_struck_again(record_creeping, tmp_path) -> None:
    with pytest.raises(LimitExceeded, match="whippen encoder rests 0.01.* rad from where it began, allowed 0.005"):
        record_creeping(0.02, trials=3)
    assert [trial.status for trial in Session.open(tmp_path / "s").trials] == ["fault"]


def test_bad_input_is_refused_before_anything_moves_and_leaves_nothing(record, tmp_path) -> None:
    folder, backend, call = record
    strong = parse_profile('name="s"\npoints=[{time_s=0,force_n=0},{time_s=0.1,force_n=130},{time_s=0.2,force_n=0}]')
    for changes in (
        {"trials": 0},
        {"trials": 10_000},
        {"profile": strong},
        {"profile": "none"},
        {"rig_config": "none"},
    ):
        with pytest.raises(InputError):
            call(**changes)
    assert not folder.exists() and backend.calls == []


def test_a_path_that_cannot_be_used_is_refused_before_anything_moves(tmp_path, rig, record_steps) -> None:
    backend = FakeBackend()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    for out in ("file", "file/below", "full"):
        with pytest.raises(InputError) as refusal:
            record_steps(rig, out, backend=backend)
        assert out.split("/")[-1] in str(refusal.value) and "\n" not in str(refusal.value)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file", "full", "thesis.txt"]
    assert backend.calls == []


def test_an_error_of_the_program_in_the_safe_stop_is_no_fault_of_the_bench(record) -> None:
    folder, backend, call = record
    backend.plan_fault("stop", TypeError("wrong call"))
    with pytest.raises(TypeError, match="wrong call"):
        call()
    (trial,) = Session.open(folder).trials
    data = trial.read()
    assert (data.status, data.reason) == ("defect", "TypeError: wrong call") and data.n_valid > 1900
    assert not Session.open(folder).journals
    assert backend.is_safe


@pytest.mark.skipif(os.name == "nt", reason="Windows keeps an open folder")
def test_a_folder_deleted_under_a_recording_stops_it_and_is_said_truly(record) -> None:
    folder, backend, call = record

    def delete(at) -> None:
        if at.trial == 2 and folder.exists():
            shutil.rmtree(folder)

    with pytest.raises(RecordingFault, match="was deleted while it was .*its samples are lost") as caught:
        call(trials=3, progress=delete)
    assert "is kept" not in str(caught.value) and not folder.exists()
    assert backend.is_safe


def test_trials_deleted_between_two_blows_are_noticed(record) -> None:
    folder, backend, call = record
    with pytest.raises(RecordingFault, match="1 trials were sealed here, 0 are left"):
        call(trials=3, after_trial=lambda trial: trial.path.unlink())
    assert backend.is_safe


@pytest.mark.parametrize(("step_s", "words"), [(-3 * 86400.0, "back by 259200.0 s"), (7.5, "forward by 7.5 s")])
def test_a_clock_that_is_set_during_a_recording_is_noted(step_s, words, record) -> None:
    folder, _, call = record
    monotonic = itertools.count(100.0)
    now = iter(monotonic)
    shown = {"s": 100.0}

    def now_s() -> float:
        shown["s"] = next(now)
        return shown["s"]

    set_by = {"s": 0.0}

    def progress(at) -> None:
        if at.trial == 2:
            set_by["s"] = step_s

    call(trials=3, now_s=now_s, wall_s=lambda: 1.7e9 + shown["s"] + 1.0 + set_by["s"], progress=progress)
    notes = [(note.trial, note.reason) for note in Session.open(folder).annotations]
    assert [number for number, _ in notes] == [2] and words in notes[0][1]


def test_a_viewer_that_sleeps_loses_the_oldest_blocks_only() -> None:
    feed = BlockFeed(capacity=3)
    for k in range(5):
        feed.publish(Block(k, np.zeros(1), np.zeros(1), np.zeros((1, 3), dtype=np.int64)))
    assert feed.n_dropped == 2
    assert [block.first_sample for block in feed.take()] == [2, 3, 4]
    assert feed.take() == []
