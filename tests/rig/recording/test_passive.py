"""Recording without a motor: strokes become trials, nothing moves, nothing grows, a kill loses no stroke."""

from __future__ import annotations

import shutil
import tracemalloc
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.backend import Backend, Block, Capabilities, Timing
from rig.configuration.rig_file import RigConfig, load_rig
from rig.errors import HardwareFault, InputError
from rig.recording.passive import record_passive
from rig.recording.recover import recover_session
from rig.session import Session
from rig.session.journal.live_reader import SessionFollower
from rig.simulated.backend import open_backend
from tests.command_line import run
from tests.rig.recording.test_strokes import RATE, played

EVERY_S = 4.0


class Player(Backend):
    """A bench at which somebody plays the same stroke every four seconds."""

    def __init__(self, period: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        force, count = period or played(EVERY_S, [(2.0, 0.2, 15.0)])
        self.force, self.count, self.next = force, count, 0
        self.calls: list[str] = []

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities("test", True, {"serial_number": "01AB"}, hardware=True)

    def configure(self, config: RigConfig, command_v: np.ndarray | None) -> Timing:
        assert command_v is None and config.camera is None
        return Timing(RATE, 0.0)

    def arm(self, *, enable_drive: bool = True) -> None:
        self.calls.append(f"arm {enable_drive}")

    def start(self) -> None:
        self.next = 0

    def block(self, first: int, n: int) -> Block:
        k = np.arange(first, first + n) % self.force.size
        return Block(first, self.force[k], self.force[k] / 50, self.count[k])

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        self.next += n_samples
        return self.block(self.next - n_samples, n_samples)

    def safe_stop(self) -> None:
        self.calls.append("safe")

    def close(self) -> None:
        pass


def test_each_stroke_becomes_a_trial_with_the_streams_own_samples(tmp_path) -> None:
    player = Player()
    session = record_passive(tmp_path / "s", backend=player, strokes=3, operator="ana", action_name="Boston")
    assert player.calls == ["arm False", "safe"] and not session.journals
    assert [trial.status for trial in session.trials] == ["complete"] * 3
    started = []
    for k, trial in enumerate(session.trials):
        data = trial.read()
        onset = int(np.argmax(np.abs(data.force_n) > 0.5))
        assert data.blow_start_s < onset / RATE < data.blow_start_s + 0.1 and data.time_s[0] == 0.0
        shift = np.flatnonzero(data.force_n == player.force.max())[0] - (k * player.force.size + player.force.argmax())
        want = player.block(-shift, data.n_valid)
        np.testing.assert_array_equal(data.force_n, want.force_n)
        np.testing.assert_array_equal(data.force_raw, want.force_raw)
        np.testing.assert_array_equal(data.encoder_count, want.encoder_count)
        assert not data.motor_command_v.any() and data.provenance["backend_serial_number"] == "01AB"
        assert 0.45 <= (data.force_n.argmax() / RATE) <= 0.75
        started.append(datetime.fromisoformat(data.started_utc).timestamp() + shift / RATE)
    np.testing.assert_allclose(started, started[0], atol=2e-3)  # by the device's clock, to the millisecond of the text


def test_neither_memory_nor_disk_grow_while_somebody_plays_or_nobody_does(tmp_path) -> None:
    rig = load_rig("virtual")
    sizes: list[int] = []
    began: list[int] = []

    def progress(at: Any) -> None:
        if at.time_s > 20.0 and not began:
            tracemalloc.reset_peak()
            began.append(tracemalloc.get_traced_memory()[0])
        if round(at.time_s * 50) % 500 == 0:
            sizes.append(sum(f.stat().st_size for f in (tmp_path / "quiet").glob("*.journal")))

    quiet = played(EVERY_S, [])
    tracemalloc.start()
    player = Player(quiet)
    session = record_passive(tmp_path / "quiet", backend=player, rig_config=rig, duration_s=120.0, progress=progress)
    growth_mb = (tracemalloc.get_traced_memory()[1] - began[0]) / 1e6
    tracemalloc.stop()
    assert growth_mb < 1.5 < 120 * RATE * 5 * 8 / 1e6 / 10
    assert max(sizes) - min(sizes) < 2e6 and not session.path.exists()  # nobody played: nothing is left


@pytest.mark.slow
def test_an_hour_of_playing_stays_flat(tmp_path) -> None:
    resource = pytest.importorskip("resource")
    peaks: list[float] = []

    def progress(at: Any) -> None:
        if at.time_s > 60.0 * (1 + len(peaks)):
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)

    session = record_passive(tmp_path / "s", backend=Player(), duration_s=3600.0, progress=progress)
    print(f"{len(session.trials)} strokes in an hour; peak memory {peaks[0]:.1f} to {peaks[-1]:.1f} MB")
    assert len(session.trials) == 900 and {t.status for t in session.trials} == {"complete"}
    assert peaks[-1] - peaks[0] < 10.0


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
    np.testing.assert_array_equal(data.force_n, whole.force_n[: data.n_valid])
    assert abs(data.n_valid / RATE - 0.6) < 0.15 and data.started_utc == whole.started_utc
    assert recover_session(copies["playing"]) == []


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

    record_passive(tmp_path / "s", backend=Player(), strokes=2, progress=progress)
    assert {trial for _, trial, _ in seen} == {1, 2}
    gaps = np.diff([time_s for time_s, _, _ in seen])
    assert gaps.max() < 0.1 + 1e-9  # ten times a second while nobody plays,
    assert np.isclose(gaps, 0.02).sum() > 20  # with every block of a stroke


def test_few_calls_are_made_while_nobody_plays(tmp_path) -> None:
    sizes: list[tuple[int, int]] = []

    class Counted(Player):
        def read_block(self, n_samples: int, timeout_s: float) -> Block:
            sizes.append((self.next, n_samples))
            return super().read_block(n_samples, timeout_s)

    record_passive(tmp_path / "s", backend=Counted(), strokes=1)
    quiet = [n for first, n in sizes if first + n < 1.9 * RATE]
    playing = [n for first, n in sizes if 2.15 * RATE < first < 2.3 * RATE]
    assert set(quiet) == {int(0.1 * RATE)} and set(playing) == {int(0.02 * RATE)}


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
        assert data.status == "complete" and data.force_n.max() > 3.0 and np.ptp(data.angle_rad()[:, 2]) > 0.05
    backend.close()


def test_the_command_records_strokes_and_refuses_what_does_not_go_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("record", "--passive", "--backend", "sim://?hand=plays", "--out", tmp_path / "s")
    assert run(*arguments, "--trials", 1) == 0
    assert "trial 1: complete" in capsys.readouterr().out
    for more, words in {
        ("--film", "1"): "--passive: plays no profile",
        ("--for", "-1"): "duration_s = -1, allowed above 0",
        ("--trials", "0"): "strokes = 0, allowed 1 to 9999",
    }.items():
        assert run(*arguments[:-1], tmp_path / "t", *more) == 2
        assert words in capsys.readouterr().err and not (tmp_path / "t").exists()
    assert run("record", "--for", "3") == 2


def test_bad_settings_are_refused(edited_rig: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="passive.pre_s"):
        edited_rig(("[recording]", "[passive]\npre_s = 0.1\n[recording]"))
