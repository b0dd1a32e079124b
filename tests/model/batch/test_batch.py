"""Batches: the same bits as single runs on any executor, nothing dropped, nothing half, nothing done twice."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from model import batch
from model.batch import run as batch_run
from model.codegen import load as scenes
from model.codegen.evaluate_observables import evaluate_rows
from model.integrators.rosenbrock import integrate
from model.simulation.compliant_joints import CompliantJointMotion
from model.simulation.options import ForceDrivenOptions
from model.simulation.string_motion import StringMotion
from tests.model.batch.members import Elsewhere, Loses, content, contents

OUT = np.linspace(0.0, 0.14, 29)
SETS = {"printed": {}, "heavy": {"hammer.mass": 0.0115}, "loose": {"contact04.friction": 0.0}}


def blow(force: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.0, 0.02, 0.1, 0.14]), np.array([0.0, force, force, 0.0])


TRIALS = {"soft": blow(3.0), "loud": blow(12.0), "short": blow(20.0)}


def many(action: model.Action, **options: Any) -> list[batch.Member]:
    options = {"tolerance": 1e-4, "output_time_s": OUT, **options}
    return model.simulate_many(action, TRIALS, SETS, **options)


def test_members_are_single_runs_to_the_last_bit(action: model.Action) -> None:
    seen: list[tuple[int, int]] = []
    members = many(action, contact_forces=True, energy=True, workers=3, progress=lambda *x: seen.append(x))
    assert [(m.parameters, m.trial) for m in members] == [(s, t) for s in SETS for t in TRIALS]
    for m in members:
        single = model.simulate(
            action.with_values(SETS[m.parameters]), *TRIALS[m.trial],
            tolerance=1e-4, output_time_s=OUT, contact_forces=True, energy=True,
        )  # fmt: skip
        assert m.solution is not None and m.error is None
        assert content(m.solution) == content(single)
    assert seen == [(k, 9) for k in range(1, 10)]


def test_order_of_work_and_pickling_change_nothing(action: model.Action) -> None:
    here, elsewhere = many(action), many(action, executor=Elsewhere(9))
    for a, b in zip(here, elsewhere, strict=True):
        assert (a.sha256, a.trial, a.parameters, a.error) == (b.sha256, b.trial, b.parameters, None)
    assert contents(here) == contents(elsewhere)


def test_scene_with_everything_it_says_reaches_the_members(action: model.Action) -> None:
    """Effects, their values and outputs, as in a single run."""
    choice = replace(model.load_scene("flexible-shank"), outputs=("contact_forces",))
    (member,) = model.simulate_many(action, [blow(3.0)], tolerance=1e-4, output_time_s=OUT, scene=choice)
    single = model.simulate(action, *blow(3.0), tolerance=1e-4, output_time_s=OUT, scene=choice)
    assert member.solution is not None and single.contact_normal_n is not None
    assert len(single.bodies) > 5
    assert content(member.solution) == content(single)


def test_rows_without_names_are_numbered(action: model.Action) -> None:
    members = model.simulate_many(action, [blow(3.0), blow(4.0)], tolerance=1e-3, output_time_s=[0.14])
    assert [(m.parameters, m.trial) for m in members] == [("", "0"), ("", "1")]
    assert members[0].solution is not None and members[0].solution.angle_rad.shape == (1, 5)


def test_failures_are_members(action: model.Action) -> None:
    trials = {**TRIALS, "torn": ([0.0, 0.1], [0.0, np.nan])}
    sets = {"printed": {}, "none": {"hammer.colour": 1.0}, "bad": {"key.mass": -1.0}}
    members = model.simulate_many(action, trials, sets, tolerance=1e-4, output_time_s=OUT)
    assert len(members) == 12
    errors = {(m.parameters, m.trial): m.error for m in members if m.error is not None}
    assert len(errors) == 9 and all((m.solution is None) == (m.error is not None) for m in members)
    assert all(isinstance(e, model.InputError) for e in errors.values())
    assert "trial torn" in str(errors["printed", "torn"]) and "hammer.colour" in str(errors["none", "soft"])


def test_lost_worker_is_the_error_of_its_member(action: model.Action) -> None:
    with Loses(lambda job: job.trial == "loud") as pool:
        members = many(action, executor=pool)
    assert [m.trial for m in members if isinstance(m.error, MemoryError)] == ["loud"] * 3
    assert sum(m.solution is not None for m in members) == 6


def test_executor_that_gives_up_loses_no_member(action: model.Action, tmp_path: Path) -> None:
    class GivesUp(ThreadPoolExecutor):
        taken = 0

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
            self.taken += 1
            if self.taken > 5:
                raise BrokenExecutor("workers are gone")
            return super().submit(fn, *args, **kwargs)

    with GivesUp(1) as pool:
        members = many(action, executor=pool, store=tmp_path)
    assert [isinstance(m.error, BrokenExecutor) for m in members] == [False] * 5 + [True] * 4
    assert [m.reused for m in many(action, store=tmp_path)] == [True] * 5 + [False] * 4


def test_hash_covers_what_decides_and_no_more(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    def jobs(trials: Any = None, parameter_sets: Any = None, **keywords: Any) -> batch.Job:
        options = ForceDrivenOptions(**{"tolerance": 1e-4, "output_time_s": OUT, **keywords})
        return batch.make_jobs(action, trials or {"a": blow(3.0)}, parameter_sets or {"x": {}}, options)[0]

    base = jobs().sha256()
    assert len(base) == 64
    assert jobs(trials={"b": blow(3.0)}, parameter_sets={"y": {}}).sha256() == base  # labels
    others = [
        jobs(trials={"a": blow(3.0 + 1e-12)}),
        jobs(parameter_sets={"x": {"hammer.mass": action["hammer.mass"] * (1 + 1e-15)}}),
        jobs(parameter_sets={"x": {"contact12": 0.0}}),  # a structure that test_selection.py compiles, too
        jobs(tolerance=1e-5),
        jobs(output_time_s=OUT[:-1]),
        jobs(scene=model.SceneChoice(effects=("motor_arm",))),
        jobs(energy=True),
        jobs(method="rodas5p"),
        replace(jobs(), start_rad=np.nextafter(jobs().start_rad, 1.0)),
    ]
    hashes = {job.sha256() for job in others}
    assert len(hashes) == len(others) and base not in hashes
    monkeypatch.setattr("model.batch.job.code_sha256", lambda: "other code")
    assert jobs().sha256() != base


def test_interrupted_batch_goes_on_where_it_stopped(action: model.Action, tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        many(action, workers=1, progress=stop, store=tmp_path)
    assert isinstance(caught.value, batch.BatchInterrupt)
    finished = [m for m in caught.value.members if m is not None]
    assert 4 <= len(finished) < 9 and len(list(tmp_path.glob("*.npz"))) == len(finished)
    assert threading.active_count() < 20
    members = many(action, store=tmp_path)
    assert sum(m.reused for m in members) == len(finished)
    assert not list(tmp_path.glob(".*"))  # no half-written file is left
    assert contents(members) == contents(many(action))


def test_damaged_or_foreign_files_are_done_again(action: model.Action, tmp_path: Path) -> None:
    first = many(action, store=tmp_path, energy=True, contact_forces=True)
    files = sorted(tmp_path.glob("*.npz"))
    files[0].write_bytes(files[0].read_bytes()[:-1000])
    files[1].write_bytes(b"")
    whole = bytearray(files[2].read_bytes())
    whole[len(whole) // 2] ^= 1
    files[2].write_bytes(bytes(whole))
    files[3].write_bytes(files[4].read_bytes())  # another member under this name
    again = many(action, store=tmp_path, energy=True, contact_forces=True)
    assert sum(m.reused for m in again) == 5
    assert contents(first) == contents(again)
    assert all(m.reused for m in many(action, store=tmp_path, energy=True, contact_forces=True))


@pytest.mark.parametrize(
    "change",
    [
        lambda f: f | {"angle_rad": f["angle_rad"] + 1e-9},
        lambda f: f | {name: f[name][:10] for name in ("time_s", "angle_rad", "speed_rad_per_s")},
        lambda f: {name: item for name, item in f.items() if name != "contact_normal_n"},
        lambda f: f | {"about": np.array(str(f["about"]).replace('"tolerance": 0.0001', '"tolerance": 1e-07'))},
        lambda f: f | {"angle_rad": f["angle_rad"].astype(np.float32)},
    ],
    ids=["altered", "cut", "column lost", "facts altered", "rounded"],
)
def test_a_stored_file_whose_content_was_changed_is_done_again(
    action: model.Action, tmp_path: Path, change: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    options: dict[str, Any] = {"tolerance": 1e-4, "output_time_s": OUT, "contact_forces": True, "store": tmp_path}
    options["estimate_error"] = True
    (first,) = model.simulate_many(action, [blow(3.0)], **options)
    (path,) = tmp_path.glob("*.npz")
    with np.load(path) as file:
        held = dict(file)
    np.savez(path, **held)  # written again as it was: still good
    assert model.simulate_many(action, [blow(3.0)], **options)[0].reused
    np.savez(path, **change(held))
    (again,) = model.simulate_many(action, [blow(3.0)], **options)
    assert not again.reused and again.solution is not None and contents([first]) == contents([again])
    assert again.solution.error_rad is not None and again.solution.error_rad > 0.0


def test_lasting_failure_is_kept_and_an_accident_is_not(tmp_path: Path) -> None:
    store = batch.Store(tmp_path)
    store.write(batch.Member("t", "p", "a" * 64, error=model.IntegrationError("stopped at t = 1 s")))
    store.write(batch.Member("t", "p", "b" * 64, error=MemoryError("lost")))
    kept = store.read("a" * 64, "other", "labels")
    assert kept is not None and isinstance(kept.error, model.IntegrationError)
    assert str(kept.error) == "stopped at t = 1 s" and kept.trial == "other" and kept.reused
    assert store.read("b" * 64, "t", "p") is None


def test_what_joints_give_and_a_string_does_is_kept(action: model.Action, tmp_path: Path) -> None:
    scene, time, z = model.build_scene(action, model.load_scene("string")), np.array([0.0, 1.0]), np.arange(400.0)
    angles, give = np.arange(10.0).reshape(2, 5), [np.array([[k], [0.5 * k]]) for k in (1.0, 2.0, 3.0)]
    solution = model.Solution(
        model.BODIES, time, angles, -angles, string=StringMotion(scene, time, np.stack([z, z + 0.5])),
        give=CompliantJointMotion(("hammer_pin_x",), *give),
    )  # fmt: skip
    store, member = batch.Store(tmp_path), batch.Member("t", "p", "c" * 64, solution)
    store.write(member)
    kept = store.read("c" * 64, "t", "p", scene)
    assert kept is not None and kept.solution is not None and contents([kept]) == contents([member])
    assert kept.solution.give is not None and kept.solution.give.directions == ("hammer_pin_x",)
    assert kept.solution.string is not None and kept.solution.string.scene is scene
    assert store.read("c" * 64, "t", "p") is None  # without its scene nobody could say what the string did


def test_store_that_cannot_be_written_is_refused_before_any_work(action: model.Action, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(model.InputError, match="store"):
        many(action, store=tmp_path / "file")
    with pytest.raises(model.InputError, match="workers"):
        many(action, workers=0)


def test_structure_is_loaded_once_and_scene_and_rest_are_shared(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = []
    monkeypatch.setattr("model.batch.job.solve_rest", lambda *_: solved.append(1) or action_rest)
    action_rest = model.rest_state(action).angle_rad
    many(action)
    assert len(solved) == len(SETS)
    loads: list[object] = []
    original = scenes._compile_kernels
    monkeypatch.setattr(scenes, "_loaded", {})
    monkeypatch.setattr(scenes, "_compile_kernels", lambda *given: loads.append(given) or original(*given))
    gate = threading.Barrier(4)
    tables = model.build_scene(action).tables

    def load() -> None:
        gate.wait()
        scenes.load_kernels(tables)

    threads = [threading.Thread(target=load) for _ in range(4)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(loads) == 1


def test_kernels_run_without_the_global_lock() -> None:
    """What makes threads worth while; benchmarks/batches.py measures how much."""
    for kernel in (integrate, evaluate_rows):
        assert kernel.targetoptions["nogil"] is True


def test_processes_of_this_machine_are_counted() -> None:
    assert 1 <= batch_run.count_processors() <= (os.cpu_count() or 1)


def test_dask_cluster_of_two_workers(action: model.Action) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' (dask[distributed]) is not installed")
    with (
        distributed.LocalCluster(2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        members = many(action, executor=client.get_executor())
    here = many(action)
    assert [(m.sha256, None) for m in here] == [(m.sha256, m.error) for m in members]
    assert contents(here) == contents(members)
