"""Members side by side in lanes: bits do not depend on neighbours, failures stay alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from model import batch
from model.batch import lanes
from model.batch.job import Job, make_jobs
from model.simulation.options import ForceDrivenOptions
from tests.model.batch.members import Elsewhere, contents

TIMES = np.array([0.0, 0.02, 0.06, 0.14, 0.16, 0.2])
OUT = np.linspace(0.0, 0.2, 41)


def blows(count: int, seed: int = 0, scale: float = 1.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Force tables of different strength, shape, length; every fifth ends in silence, where the key comes to rest."""
    rng = np.random.default_rng(seed)
    out = {}
    for i in range(count):
        force = rng.uniform(1.0, 15.0) * rng.uniform(0.5, 1.0, len(TIMES)) * scale
        force[[0, -1]] = 0.0
        if i % 5 == 0:
            force[2:] = 0.0
        out[f"{i}"] = (TIMES * rng.uniform(1.0, 1.2), force)
    return out


def jobs_of(action: model.Action, trials: Any, sets: Any = None, **options: Any) -> list[Job]:
    options = {"tolerance": 1e-5, "output_time_s": OUT, "scene": "key", **options}
    made = make_jobs(action, trials, sets or {"": {}}, ForceDrivenOptions(**options))
    return [replace(job, in_lanes=True) for job in made]


SETS = {"printed": {}, "heavy": {"key.mass": 0.11}, "smooth": {"contact02.friction": 0.0}}


def together(jobs: Sequence[Job]) -> list[batch.Member]:
    return lanes.run_lane_jobs(jobs, ["" for _ in jobs])


def test_a_member_is_the_same_to_the_last_bit_whatever_its_neighbours_lane_and_width(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = jobs_of(action, blows(7), SETS, contact_forces=True)
    whole = contents(together(jobs))
    rng = np.random.default_rng(1)
    for size in (1, 2, 5, 13, 21):
        some = [int(i) for i in rng.permutation(len(jobs))[:size]]
        assert contents(together([jobs[i] for i in some])) == [whole[i] for i in some]
    for seed in range(4):  # time and again the same ones
        some = [int(i) for i in np.random.default_rng(seed).integers(0, len(jobs), 9)]
        assert contents(together([jobs[i] for i in some])) == [whole[i] for i in some]


def scalar_and_error(job: Job) -> tuple[np.ndarray, float]:
    """Angles of the single run, and its largest error against a run at 1e-11."""
    one = batch.run_job(job, "").solution
    assert one is not None and job.run is not None
    fine = batch.run_job(replace(job, run=replace(job.run, tolerance=1e-11, estimate_error=False)), "").solution
    assert fine is not None
    return one.angle_rad, float(np.abs(one.angle_rad - fine.angle_rad).max())


@pytest.mark.parametrize(
    ("scene", "tolerance", "method"), [("key", 1e-3, "rodas4p"), ("key", 1e-6, "rodas5p"), ("whole", 1e-6, "rodas4p")]
)
def test_members_agree_with_single_runs(action: model.Action, scene: str, tolerance: float, method: str) -> None:
    jobs = jobs_of(action, blows(5), SETS, tolerance=tolerance, method=method, scene=scene)
    for job, member in zip(jobs, together(jobs), strict=True):
        angles, error = scalar_and_error(job)
        assert member.solution is not None
        assert np.abs(member.solution.angle_rad - angles).max() <= max(0.1 * tolerance, error)
        assert member.solution.counters["n_rests"] > 0 or int(member.trial) % 5 or scene == "whole"


def test_a_failing_member_reports_its_own_error_and_disturbs_no_neighbour(action: model.Action) -> None:
    jobs = jobs_of(action, blows(11))
    good = contents(together(jobs))
    inside = replace(jobs[3], start_rad=np.array([-0.9]))  # deep in the felt
    wild = replace(jobs[5], start_rad=np.array([np.nan]))
    assert jobs[7].run is not None
    impossible = replace(jobs[7], run=replace(jobs[7].run, tolerance=1.0))
    planted = {3: inside, 5: wild, 7: impossible}
    members = together([planted.get(i, job) for i, job in enumerate(jobs)])
    for i, member in enumerate(members):
        if i in planted:
            alone = batch.run_job(planted[i], "")
            assert type(member.error) is type(alone.error) and str(member.error) == str(alone.error)
        else:
            assert contents([member]) == [good[i]]
    assert all(members[i].error is not None for i in (5, 7))


def test_attempts_are_limited_as_in_a_single_run(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.simulation.run.STEPS_AT_LEAST", 40)
    monkeypatch.setattr("model.simulation.run.STEPS_PER_SECOND", 0)
    jobs = jobs_of(action, blows(3))
    for job, member in zip(jobs, together(jobs), strict=True):
        assert "too many steps" in str(member.error)
        assert str(member.error).split(":")[-1] == str(batch.run_job(job, "").error).split(":")[-1]


def test_estimated_error_comes_from_a_companion_in_lanes(action: model.Action) -> None:
    jobs = jobs_of(action, blows(3), estimate_error=True)
    tighter = jobs_of(action, blows(3), tolerance=0.1 * 1e-5)
    for member, fine in zip(together(jobs), together(tighter), strict=True):
        assert member.solution is not None and fine.solution is not None
        difference = np.abs(member.solution.angle_rad - fine.solution.angle_rad).max()
        assert member.solution.error_rad == difference


def test_lanes_are_chosen_for_many_members_of_a_kind_and_never_for_what_they_cannot_give(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lanes, "has_wide_vectors", lambda: True)
    monkeypatch.setattr(lanes, "LEAST_MEMBERS", 6)

    def chosen(wanted: bool | None, count: int = 6, **options: Any) -> int:
        jobs = [replace(job, in_lanes=False) for job in jobs_of(action, blows(count), **options)]
        return sum(job.in_lanes for job in lanes.select_lane_jobs(jobs, wanted))

    assert (chosen(None), chosen(None, 5), chosen(True, 1), chosen(False)) == (6, 0, 1, 0)
    assert chosen(True, energy=True) == chosen(True, inside=True) == 0
    assert chosen(None, contact_forces=True, estimate_error=True) == 6
    failed = make_jobs(action, {"torn": ([0.0, 0.1], [0.0, np.nan])}, {"": {}}, ForceDrivenOptions(scene="key"))
    assert not lanes.select_lane_jobs(failed, True)[0].in_lanes
    two_kinds = jobs_of(action, blows(4)) + jobs_of(action, blows(4), method="rodas5p")
    assert not any(
        job.in_lanes for job in lanes.select_lane_jobs([replace(j, in_lanes=False) for j in two_kinds], None)
    )
    monkeypatch.setattr(lanes, "has_wide_vectors", lambda: False)
    assert chosen(True) == 0


def test_members_of_two_methods_never_share_a_unit(action: model.Action) -> None:
    jobs = jobs_of(action, blows(6))
    mixed = [
        job if i % 2 else replace(job, run=replace(job.run, method="rodas5p"))  # of one scene object
        for i, job in enumerate(jobs)
        if job.run is not None
    ]
    parts = lanes.group_jobs(mixed, range(6), 1)
    assert sorted(sorted(part) for part in parts) == [[0, 2, 4], [1, 3, 5]]
    members = batch.run_jobs(mixed, workers=1)
    assert contents(members[::2]) == contents(together(mixed[::2]))
    assert contents(members[1::2]) == contents(together(mixed[1::2]))


def test_executor_and_store_change_no_bit_and_lanes_have_files_of_their_own(
    action: model.Action, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lanes, "has_wide_vectors", lambda: True)
    trials = blows(10)
    options: dict[str, Any] = {"tolerance": 1e-5, "output_time_s": OUT, "scene": "key"}
    seen: list[int] = []
    first = model.simulate_many(
        action, trials, lanes=True, store=tmp_path, workers=2, progress=lambda done, _: seen.append(done), **options
    )
    assert seen == list(range(1, 11)) and [m.trial for m in first] == list(trials)
    elsewhere = model.simulate_many(action, trials, lanes=True, executor=Elsewhere(4), workers=4, **options)
    again = model.simulate_many(action, trials, lanes=True, store=tmp_path, **options)
    alone = model.simulate_many(action, trials, lanes=False, store=tmp_path, **options)
    assert all(m.reused for m in again) and not any(m.reused for m in alone)
    assert contents(first) == contents(elsewhere) == contents(again)
    for a, b, d in zip(first, elsewhere, alone, strict=True):
        assert a.sha256 == b.sha256 != d.sha256
