"""Variants in units: their marks against the events of single blows, units kept and reused, an interrupt."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import model
from model.screening import MARKS, Spread, Variants, spreads
from model.screening import members as computing
from model.screening.members import Estimate, Interrupted, Study


@pytest.fixture(scope="module")
def drawn(action: model.Action) -> list[Spread]:
    names = ["hammer.mass", "contact02", "hammer.pivot.x"]
    return spreads(action, names, {"hammer.mass": 2e-4, "contact02": 0.1})


@pytest.fixture(scope="module")
def variants(action: model.Action, drawn: list[Spread]) -> Variants:
    return Variants(action, *model.force_table("forte"), tuple(s.parameter for s in drawn))


@pytest.fixture(scope="module")
def values(drawn: list[Spread]) -> np.ndarray:
    random = np.random.default_rng(4)
    return np.column_stack([s.at(random.random(5)) for s in drawn])


@pytest.fixture(scope="module")
def marks(variants: Variants, values: np.ndarray) -> np.ndarray:
    return Study(workers=1).run(variants, values)


def test_marks_are_the_events_of_each_variant(action: model.Action, values: np.ndarray, marks: np.ndarray) -> None:
    accuracy = {"s": 2e-6, "m": 3e-6, "m_per_s": 1e-3}
    for row, (mass, felt, pivot) in zip(marks[:2], values[:2], strict=True):
        variant = model.scaled(action.with_values({"hammer.mass": mass, "hammer.pivot.x": pivot}), {"contact02": felt})
        options = model.SensitivityOptions(tolerance=1e-7)
        events = model.sensitivities(variant, model.force_table("forte"), ["key.mass"], options=options).events
        for name, mark in zip(MARKS, row, strict=True):
            unit = "m_per_s" if name.endswith("_per_s") else name.rpartition("_")[2]
            assert mark == pytest.approx(events[name], abs=accuracy[unit] if name != "drop_s" else 1e-4), name


def test_the_hold_of_a_double_blow_is_that_of_its_first_strike() -> None:
    """Held from the first check to the last release the hammer was taken for 5.8 mm below the string, not 13.5."""
    action, blow = model.load_action("hirschkorn2004-regulated"), model.force_table("double")
    events = model.sensitivities(action, blow, ["hammer.mass"]).events
    run = model.simulate(action, *blow)
    height = model.observables.head_height_m(action, model.BODIES, run.angle_rad)
    first, second = run.time_s[:-1][(height[:-1] > 0.0) & (height[1:] <= 0.0)]
    held = float(np.median(height[(run.time_s > first + 0.02) & (run.time_s < 0.165)]))
    drops = float(run.time_s[(run.time_s > 0.15) & (height > held + 5e-4)][0])
    assert drops < second and held > 1e-2
    (mass,) = spreads(action, ["hammer.mass"])
    (row,) = Variants(action, *blow, (mass.parameter,)).marks([[mass.parameter.value]])
    for found in (events, dict(zip(MARKS, row, strict=True))):
        assert found["check_m"] == pytest.approx(held, abs=2e-4)
        assert found["drop_s"] == pytest.approx(drops, abs=5e-3)


def test_units_are_kept_and_not_computed_again(
    variants: Variants, values: np.ndarray, marks: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "UNIT", 2)
    told: list[tuple[int, int]] = []
    study = Study(workers=1, store=tmp_path / "kept", progress=lambda done, total: told.append((done, total)))
    np.testing.assert_array_equal(study.run(variants, values), marks)
    assert told[-1] == (5, 5) and len(list((tmp_path / "kept").glob("*.npz"))) == 3
    computed: list[int] = []
    true = Variants.marks
    monkeypatch.setattr(Variants, "marks", lambda self, rows: computed.append(len(rows)) or true(self, rows))
    np.testing.assert_array_equal(study.run(variants, values), marks)
    assert computed == []
    damaged, altered, _ = sorted((tmp_path / "kept").glob("*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:50])
    with np.load(altered) as file:
        np.savez(altered, marks=file["marks"] + 1e-9, about=file["about"])
    np.testing.assert_array_equal(study.run(variants, values), marks)
    assert len(computed) == 2  # neither half a file nor altered numbers are used


def test_an_interrupt_keeps_what_is_finished(
    variants: Variants, values: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "UNIT", 1)
    seen = 0

    def tell(done: int, total: int) -> None:
        nonlocal seen
        seen += 1
        if seen == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(Variants, "marks", lambda self, rows: np.zeros((len(rows), len(MARKS))))
    with pytest.raises(Interrupted, match="of 5 members are done") as stopped:
        Study(workers=1, store=tmp_path, progress=tell).run(variants, values)
    assert 2 <= stopped.value.done <= 5
    assert len(list(tmp_path.glob("*.npz"))) >= 2


def test_a_study_is_estimated_before_it_goes_on(
    variants: Variants, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "UNIT", 64)
    monkeypatch.setattr(Variants, "marks", lambda self, rows: np.zeros((len(rows), len(MARKS))))
    clock = iter([100.0, 102.5])  # begin and end of the second unit; the first also loads what is compiled
    told: list[Estimate] = []
    values = np.random.default_rng(1).random((20_000, 3))
    study = Study(workers=2, store=tmp_path, announce=told.append, clock=lambda: next(clock))
    stopped = InterruptAfter(1280)
    study.progress = stopped
    with pytest.raises(Interrupted):
        study.run(variants, values)
    (found,) = told
    units = -(-20_000 // 64) - 2
    assert found.members == 20_000 - 128 and found.seconds == pytest.approx(2.5 * -(-units // 2))
    size = sum(path.stat().st_size for path in tmp_path.glob("*.npz")) / len(list(tmp_path.glob("*.npz")))
    assert found.size == pytest.approx(units * size, rel=0.01)
    assert found.line() == f"19872 members: about 6.5 min on 2 workers, {found.size / 1e6:.1f} MB on disk"
    kept = len(list(tmp_path.glob("*.npz")))
    assert 20 <= kept < units  # stopped midway; goes on from there
    clock = iter([0.0, 0.0])
    study.progress = lambda done, total: begun.append(done)
    begun: list[int] = []
    study.run(variants, values)
    assert begun[0] == 64 * kept and begun[-1] == 20_000


def test_a_disk_that_cannot_hold_a_study_ends_it(
    variants: Variants, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "UNIT", 1)
    monkeypatch.setattr(Variants, "marks", lambda self, rows: np.zeros((len(rows), len(MARKS))))
    monkeypatch.setattr("shutil.disk_usage", lambda _: DiskUsage(10**9, 10**9, 2000))
    with pytest.raises(model.InputError, match="the study needs .* MB, 0 MB are free; free space"):
        Study(workers=1, store=tmp_path).run(variants, np.random.default_rng(1).random((50, 3)))
    assert len(list(tmp_path.glob("*.npz"))) == 2


@pytest.mark.slow  # starts a scheduler and two processes
def test_a_worker_that_is_killed_midway_changes_no_number(
    variants: Variants, values: np.ndarray, marks: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    monkeypatch.setattr(computing, "UNIT", 1)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
    ):
        first = list(client.run(os.getpid).values())
        killed: list[int] = []

        def kill(done: int, total: int) -> None:
            if not killed:
                killed.append(first[0])
                os.kill(first[0], signal.SIGKILL)

        found = Study(executor=client.get_executor(), progress=kill).run(variants, values)
        assert killed and killed[0] not in client.run(os.getpid).values()
    np.testing.assert_array_equal(found, marks)


class DiskUsage(NamedTuple):
    total: int
    used: int
    free: int


class InterruptAfter:
    """Progress that presses Ctrl-C after so many members."""

    def __init__(self, members: int) -> None:
        self.members, self.pressed = members, False

    def __call__(self, done: int, total: int) -> None:
        if done >= self.members and not self.pressed:
            self.pressed = True
            raise KeyboardInterrupt


def test_a_variant_that_cannot_rest_is_a_row_of_nan(action: model.Action) -> None:
    (pivot,) = spreads(action, ["hammer.pivot.y"], {"hammer.pivot.y": 0.1})
    broken = Variants(action, *model.force_table("forte"), (pivot.parameter,))
    marks = broken.marks(np.array([[action["hammer.pivot.y"]], [action["hammer.pivot.y"] - 0.5]]))
    assert np.all(np.isfinite(marks[0])) and np.isnan(marks[1, MARKS.index("strike_m_per_s")])


def test_another_executor_gives_the_same_numbers(variants: Variants, values: np.ndarray, marks: np.ndarray) -> None:
    with ProcessPoolExecutor(1) as pool:
        np.testing.assert_array_equal(Study(executor=pool).run(variants, values), marks)


def test_what_cannot_be_used(variants: Variants, values: np.ndarray, tmp_path: Path) -> None:
    with pytest.raises(model.InputError, match="workers: found 0"):
        Study(workers=0).run(variants, values)
    (tmp_path / "file").write_text("")
    with pytest.raises(model.InputError, match="cannot be written"):
        Study(workers=1, store=tmp_path / "file" / "inside").run(variants, values)
