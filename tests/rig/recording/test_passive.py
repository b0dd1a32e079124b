"""Recording without a motor: strokes become trials, nothing moves, nothing grows, a kill loses no stroke.

Strokes in a stream: each is found once, whole, with quiet before it; what is no stroke is left alone.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianorig.commands.watch import follow_session as watch
from rig import (
    Block,
    HardwareFault,
    InputError,
    RigConfig,
    Session,
    Timing,
    load_rig,
    open_backend,
    record_passive,
)
from rig import (
    recover as recover_session,
)
from rig.recording.passive import Stroke, StrokeDetector, StrokeSettings
from rig.session.live_view import SessionFollower
from tests.command_line import run
from tests.rig.fake_backend import RATE_HZ as RATE
from tests.rig.fake_backend import FakeBackend
from tests.rig.recording.memory_growth import Growth

EVERY_S = 4.0


class Player(FakeBackend):
    """A bench at which somebody plays the same stroke every four seconds."""

    def __init__(self, period: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        self.force, self.count = period or played(EVERY_S, [(2.0, 0.2, 15.0)])
        super().__init__(self.block, hardware=True)

    def configure(self, config: RigConfig, command_v: np.ndarray | None) -> Timing:
        assert command_v is None and config.camera is None
        return super().configure(config, command_v)

    def block(self, first: int, n: int) -> Block:
        k = np.arange(first, first + n) % self.force.size
        return Block(first, self.force[k], self.force[k] / 50, self.count[k])


def test_each_stroke_becomes_a_trial_with_the_streams_own_samples(tmp_path) -> None:
    player = Player()
    session = record_passive(tmp_path / "s", backend=player, strokes=3, operator="ana", action_name="Boston")
    assert player.calls == ["configure", "arm False", "start", "safe"] and not session.journals
    assert [trial.status for trial in session.trials] == ["complete"] * 3
    started = []
    for k, trial in enumerate(session.trials):
        data = trial.read()
        onset = int(np.argmax(np.abs(data.raw_force_n) > 0.5))
        assert data.blow_start_s < onset / RATE < data.blow_start_s + 0.1 and data.time_s[0] == 0.0
        shift = np.flatnonzero(data.raw_force_n == player.force.max())[0] - (
            k * player.force.size + player.force.argmax()
        )
        want = player.block(-shift, data.n_valid)
        np.testing.assert_array_equal(data.raw_force_n, want.force_n)
        np.testing.assert_array_equal(data.force_raw, want.force_raw)
        np.testing.assert_array_equal(data.encoder_count, want.encoder_count)
        assert not data.motor_command_v.any() and data.provenance["backend_serial_number"] == "01AB"
        assert 0.45 <= (data.raw_force_n.argmax() / RATE) <= 0.75
        started.append(datetime.fromisoformat(data.started_utc).timestamp() + shift / RATE)
    np.testing.assert_allclose(started, started[0], atol=2e-3)  # by the device's clock, to the millisecond of the text


def test_neither_memory_nor_disk_grow_while_somebody_plays_or_nobody_does(tmp_path) -> None:
    sizes: list[int] = []

    def progress(at: Any) -> None:
        growth(at)
        if round(at.time_s * 50) % 500 == 0:
            sizes.append(sum(f.stat().st_size for f in (tmp_path / "quiet").glob("*.journal")))

    player = Player(played(EVERY_S, []))
    with Growth(after_s=15.0) as growth:
        session = record_passive(tmp_path / "quiet", backend=player, duration_s=60.0, progress=progress)
    assert growth.mb < 1.5 < 45 * RATE * 5 * 8 / 1e6 / 5
    assert max(sizes) - min(sizes) < 2e6 and not session.path.exists()  # nobody played: nothing is left


def test_a_program_that_is_killed_within_a_stroke_leaves_it_to_be_recovered(tmp_path) -> None:
    folder, copies = tmp_path / "s", {"quiet": tmp_path / "quiet", "playing": tmp_path / "playing"}

    def progress(at: Any) -> None:
        name = {5.5: "quiet", 6.1: "playing"}.get(round(at.time_s, 2))
        if name:
            shutil.copytree(folder, copies[name])

    whole = record_passive(folder, backend=Player(), strokes=2, progress=progress).trial(2).read()
    assert [entry.status for entry in recover_session(copies["quiet"])] == ["empty"]
    (entry,) = recover_session(copies["playing"])
    data = Session.open(copies["playing"]).trial(2).read()
    assert entry.status == data.status == "incomplete" and data.n_valid == entry.samples
    np.testing.assert_array_equal(data.raw_force_n, whole.raw_force_n[: data.n_valid])
    assert abs(data.n_valid / RATE - 0.6) < 0.15 and data.started_utc == whole.started_utc
    assert recover_session(copies["playing"]) == []


def test_a_stroke_soon_after_the_last_is_recovered_where_rest_is_longer_than_the_lead(edited_rig, tmp_path) -> None:
    rig, (force, count) = edited_rig(("rest_s = 0.2", "rest_s = 0.9")), played(6.0, [(2.0, 0.2, 15.0), (3.4, 0.3, 9.0)])

    def progress(at: Any) -> None:
        if round(at.time_s, 2) == 3.6:
            shutil.copytree(tmp_path / "s", tmp_path / "killed")

    player = Player((force, count))
    record_passive(tmp_path / "s", backend=player, rig_config=rig, duration_s=3.62, progress=progress)
    (entry,) = recover_session(tmp_path / "killed")
    assert (entry.trial, entry.status) == (2, "incomplete")
    data = Session.open(tmp_path / "killed").trial(2).read()
    end = 3.6 * RATE
    np.testing.assert_array_equal(data.raw_force_n, force[round(end) - data.n_valid : round(end)])
    assert 2.8 * RATE < end - data.n_valid < 2.95 * RATE  # half a second before it


def test_what_was_never_at_rest_is_sealed_whole(tmp_path) -> None:
    def progress(at: Any) -> None:
        if round(at.time_s, 2) == 0.5:
            shutil.copytree(tmp_path / "s", tmp_path / "killed")

    player = Player(played(4.0, [(-0.1, 1.2, 30.0), (2.0, 0.1, 9.0)]))
    record_passive(tmp_path / "s", backend=player, strokes=1, progress=progress)
    (entry,) = recover_session(tmp_path / "killed")
    assert (entry.status, entry.samples) == ("incomplete", 0.5 * RATE)
    data = Session.open(tmp_path / "killed").trial(1).read()
    np.testing.assert_array_equal(data.encoder_count, player.count[: data.n_valid])


@pytest.mark.parametrize("before", [2, 9])
def test_a_stroke_that_begins_as_its_journal_is_rotated_is_kept_whole(before, tmp_path) -> None:
    force, count = 0.001 * np.sin(np.arange(60_000.0)), np.zeros((60_000, 3), dtype=np.int64)
    began = 50_500 - before  # the first block that ends beyond 10 s
    force[began : began + 2000] += 10.0
    data = record_passive(tmp_path / "s", backend=Player((force, count)), strokes=1).trial(1).read()
    at = int(np.argmax(data.raw_force_n > 5.0))
    np.testing.assert_array_equal(data.raw_force_n, force[began - at :][: data.n_valid])
    assert data.status == "complete" and at == 0.5 * RATE


def test_a_journal_beside_its_sealed_stroke_goes_and_any_other_stays(tmp_path) -> None:
    def progress(at: Any) -> None:
        if round(at.time_s, 2) == 2.3:
            shutil.copytree(tmp_path / "s", tmp_path / "killed")

    session = record_passive(tmp_path / "s", backend=Player(), strokes=1, progress=progress)
    (journal,) = Session.open(tmp_path / "killed", require_trials=False).journals.values()
    shutil.copy(session.trial(1).path, tmp_path / "killed")
    with pytest.raises(InputError, match="is not the journal of trial_0001.h5"):
        recover_session(tmp_path / "killed")  # which holds more than the journal does
    Session.open(tmp_path / "killed").trial(1).path.unlink()
    recover_session(tmp_path / "killed", tmp_path / "again")  # the journal stays
    shutil.copy(Session.open(tmp_path / "again").trial(1).path, tmp_path / "killed")
    (entry,) = recover_session(tmp_path / "killed")
    assert "was sealed already" in entry.note and not journal.exists()


@pytest.mark.parametrize(
    ("error", "status"),
    [(KeyboardInterrupt(), "interrupted"), (HardwareFault("gone"), "fault"), (ZeroDivisionError("x"), "defect")],
)
def test_what_stops_it_seals_the_stroke_under_way(error, status, tmp_path) -> None:
    player = Player()

    def progress(at: Any) -> None:
        if at.time_s > 6.1:
            raise error

    with pytest.raises(type(error)):
        record_passive(tmp_path / "s", backend=player, progress=progress)
    session = Session.open(tmp_path / "s")
    assert [t.status for t in session.trials] == ["complete", status] and not session.journals
    assert player.calls[-1] == "safe"
    with pytest.raises(type(error)):
        record_passive(tmp_path / "t", backend=player, progress=lambda at: (_ for _ in ()).throw(error))
    assert not (tmp_path / "t").exists()


def test_a_second_program_sees_it_alive_between_strokes_and_within(tmp_path) -> None:
    follower: list[SessionFollower] = []
    seen: list[tuple[float, int, int]] = []

    def progress(at: Any) -> None:
        follower[:] = follower or [SessionFollower(tmp_path / "s")]
        view = follower[0].poll()
        if view is not None:
            seen.append((at.time_s, view.trial, view.sealed))
        assert not follower[0].has_ended

    record_passive(tmp_path / "s", backend=Player(), strokes=2, progress=progress)
    assert {trial for _, trial, _ in seen} == {1, 2}
    gaps = np.diff([time_s for time_s, _, _ in seen])
    assert gaps.max() < 0.1 + 1e-9  # ten times a second while nobody plays,
    assert np.isclose(gaps, 0.02).sum() > 20  # with every block of a stroke


def test_who_watches_is_told_of_the_end_of_an_open_recording(tmp_path) -> None:
    record_passive(tmp_path / "s", backend=Player(), strokes=9999, duration_s=4.0)
    looks = iter(range(5))  # then StopIteration
    shown: list[int] = []
    last = watch(tmp_path / "s", lambda view: shown.append(view.trial), every_s=0.0, wait=lambda _: [next(looks)])
    assert last is not None and shown == [last.trial] and last.state == "complete" and last.sealed < last.trials


def test_on_the_virtual_device_nothing_drives_the_motor(tmp_path, assert_safe) -> None:
    rig = load_rig("virtual")
    backend = open_backend("sim://?hand=plays&seed=7", rig.config)
    states: list[tuple[bool, float]] = []

    def look(at: Any) -> None:
        states.append((backend.device.drive_enabled(), backend.device.output_v.get("cDAQ1Mod2/ao0", 0.0)))

    session = record_passive(tmp_path / "s", backend=backend, rig_config=rig, strokes=2, progress=look)
    assert set(states) == {(False, 0.0)}
    assert not any(task.type == "AO" and task.name == "motor" for task in backend.device.tasks.values())
    assert_safe(backend)
    for trial in session.trials:
        data = trial.read()
        assert data.status == "complete" and data.raw_force_n.max() > 3.0 and np.ptp(data.angle_rad[:, 2]) > 0.05
    backend.close()


def test_the_command_records_strokes_and_refuses_what_does_not_go_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("record", "--passive", "--backend", "sim://?hand=plays", "--out", tmp_path / "s")
    assert run(*arguments, "--trials", 1) == 0
    assert "1 of 1 complete" in capsys.readouterr().out
    for more, words in {
        ("--film", "1"): "--passive: plays no profile",
        ("--profile", "forte"): "--passive: plays no profile; leave out --profile",
        ("--for", "-1"): "duration_s = -1, allowed above 0",
        ("--trials", "0"): "strokes = 0, allowed 1 to 9999",
    }.items():
        assert run(*arguments[:-1], tmp_path / "t", *more) == 2
        assert words in capsys.readouterr().err and not (tmp_path / "t").exists()
    assert run("record", "--for", "3") == 2


def test_bad_settings_are_refused(edited_rig: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="passive.pre_s"):
        edited_rig(("[recording]", "[passive]\npre_s = 0.1\n[recording]"))


SETTINGS = StrokeSettings.from_rig(load_rig("virtual").config, RATE)


def played(
    duration_s: float,
    strokes: list[tuple[float, float, float]],
    *,
    seed: int = 1,
    noise_n: float = 0.03,
    drift_n_per_s: float = 0.0,
    change: Callable[[np.ndarray, np.ndarray, np.ndarray], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Force (n,) and counts (n, 3) of strokes (begin, length, peak N), with noise; the key follows the force."""
    random = np.random.default_rng(seed)
    t = np.arange(int(duration_s * RATE)) / RATE
    force, key = np.zeros(t.size), np.zeros(t.size)
    for begin, length, peak in strokes:
        phase = np.clip((t - begin) / length, 0, 1)
        force += peak * np.sin(np.pi * phase) ** 2
        key += -0.04 * np.sin(np.pi * np.clip(phase * 1.02, 0, 1)) ** 2
    if change is not None:
        change(t, force, key)
    force = force + drift_n_per_s * t + noise_n * random.standard_normal(t.size)
    count = np.rint(key[:, None] * [1, -2, 8] / np.array(SETTINGS.rad_per_count)).astype(np.int64)
    return force, count


def found(force: np.ndarray, count: np.ndarray, block: int = 100, settings: StrokeSettings = SETTINGS) -> list[Stroke]:
    detector, strokes = StrokeDetector(settings), []
    for first in range(0, force.size, block):
        part = slice(first, first + block)
        stroke = detector.add(Block(first, force[part], force[part], count[part]))
        assert detector.needed_from <= min(first + block, force.size)
        strokes += [stroke] if stroke else []
    return [*strokes, *filter(None, [detector.finish()])]


@pytest.mark.parametrize("seed", range(8))
def test_every_stroke_is_found_once_and_whole(seed) -> None:
    random = np.random.default_rng(seed)
    begins = np.cumsum(random.uniform(0.8, 2.5, 8)) + 0.3
    truth = [(b, random.uniform(0.06, 0.35), random.uniform(1.5, 60.0)) for b in begins]
    drift = random.uniform(-0.05, 0.05)
    force, count = played(begins[-1] + 2.0, truth, seed=seed, drift_n_per_s=drift)
    strokes = found(force, count, block=int(random.integers(20, 400)))
    assert len(strokes) == len(truth) and {s.status for s in strokes} == {"complete"}
    for stroke, (begin, length, _) in zip(strokes, truth, strict=True):
        assert stroke.first / RATE <= begin - 0.19 and begin - 1e-3 <= stroke.trigger / RATE <= begin + 0.6 * length
        assert begin + length + 0.1 <= stroke.end / RATE <= begin + length + 0.6
    ends = [0, *(s.end for s in strokes)]
    assert all(s.first >= end - 0.21 * RATE for s, end in zip(strokes, ends, strict=False))


def test_spikes_drift_and_a_finger_laid_on_the_key_are_no_strokes() -> None:
    def spikes(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        force[10_000:10_008] += 40.0  # 1.6 ms: a relay
        force += np.where(t > 3.0, np.minimum((t - 3.0) * 0.1, 0.4), 0.0)  # a hand comes to rest

    assert found(*played(12.0, [], change=spikes, drift_n_per_s=0.1)) == []


def test_after_a_finger_stays_on_the_key_strokes_end_and_the_next_is_found() -> None:
    def rests(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        force += np.where(t > 1.3, 0.9, 0.0)  # from the first stroke on

    strokes = found(*played(6.0, [(1.2, 0.2, 12.0), (3.5, 0.1, 20.0)], change=rests))
    assert [s.status for s in strokes] == ["complete", "complete"] and strokes[1].first / RATE == pytest.approx(
        3.0, abs=0.05
    )


def test_a_key_that_is_held_down_goes_on_until_it_is_let_go_or_too_long() -> None:
    def held(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        down = (t > 1.25) & (t < 3.0)
        key[down] = -0.04
        force[down] = np.maximum(force[down], 3.0)

    (stroke,) = found(*played(5.0, [(1.2, 0.1, 12.0)], change=held))
    assert stroke.status == "complete" and 3.1 < stroke.end / RATE < 3.6
    first, *_ = found(*played(5.0, [(1.2, 0.1, 12.0)], change=held), settings=replace(SETTINGS, longest_s=1.0))
    assert first.status == "not at rest" and first.end / RATE == pytest.approx(2.2, abs=0.05)


def test_a_slow_press_is_found_by_the_key_and_a_stream_that_begins_within_a_stroke_waits_for_rest() -> None:
    def slow(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        key[:] = -0.04 * np.clip((t - 2.0) / 1.5, 0, 1) * (t < 4.0)

    (stroke,) = found(*played(6.0, [], change=slow, noise_n=0.01))
    assert 2.0 < stroke.trigger / RATE < 2.2 and stroke.status == "complete"
    strokes = found(*played(5.0, [(-0.1, 0.6, 30.0), (2.5, 0.1, 10.0)]))
    assert len(strokes) == 1 and strokes[0].first / RATE == pytest.approx(2.0, abs=0.05)


def test_what_is_under_way_at_the_end_is_told_and_settings_survive_as_text() -> None:
    *_, last = found(*played(2.0, [(1.9, 0.4, 20.0)]))
    assert last.status == "interrupted" and last.end == 2 * RATE
    assert StrokeSettings.from_text(SETTINGS.to_text()) == SETTINGS
    for text in ("{}", "[]", "3", "x", '{"rad_per_count": 3}'):
        with pytest.raises((TypeError, ValueError, KeyError)):
            StrokeSettings.from_text(text)
