"""Variants of an action under one blow, many of them: computed in units, measured at once, kept as they finish.

A unit of members is plain data; it builds its scenes, advances them side by side in lanes (`model.batch.lanes`) and
gives marks alone, so that a million members need neither memory nor a network. Finished units lie in a folder under the
hash of all they depend on, and are not computed again.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.batch.job import Job, Member, code_sha256, run_job
from model.batch.lanes import can, run_together
from model.batch.run import POLL_S, workers_here
from model.errors import InputError, ModelError
from model.files.atomic_write import whole_file
from model.force_driven import ForceDrivenRun, output_times
from model.integrators.methods import DEFAULT_METHOD
from model.kernels.lanes import lanes_pay
from model.parameters.action import Action
from model.scene.build import build_scene
from model.scene.selection import choice_of
from model.screening.blow_marks import MARKS, blow_marks
from model.screening.estimate import Estimate
from model.sensitivity.parameter_names import Parameter, changed_by
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

RATE_HZ = 5000.0  # of the samples that marks are read from
UNIT = 64  # members of a unit: as many as lanes advance together (`model.batch.lanes`)
AHEAD = 4  # units submitted per worker
MANY = 8  # units from which on a study is estimated before it goes on


@dataclass(frozen=True)
class Variants(ArrayRecord):
    """What members of a study have in common.

    Attributes
    ----------
    action : that they are variants of
    time_s, force_n : (k,) the blow
    parameters : that vary, in the order of a member's values
    rest_input : input under which the action rests before the blow
    tolerance : requested largest error of any angle, rad
    """

    action: Action
    time_s: Array
    force_n: Array
    parameters: tuple[Parameter, ...]
    rest_input: float = 0.0
    tolerance: float = 1e-5

    def sha256(self, values: ArrayLike) -> str:
        """Hash of all that the marks of members with these values (m, P) depend on."""
        digest = hashlib.sha256(code_sha256().encode())
        about = (self.action.content(), repr(self.rest_input), repr(self.tolerance), MARKS)
        digest.update(repr(about).encode())
        digest.update(repr([(p.name, p.value, p.paths) for p in self.parameters]).encode())
        for array in (self.time_s, self.force_n, self._of_members(values)):
            digest.update(f"{array.shape} ".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def marks(self, values: ArrayLike) -> Array:
        """Marks (m, len(MARKS)) of members with values (m, P); a row of NaN where one cannot rest or be simulated."""
        action, values, choice = self.action, self._of_members(values), choice_of(self.action)
        out = np.full((len(values), len(MARKS)), np.nan)
        times = output_times(float(self.time_s[0]), float(self.time_s[-1]), RATE_HZ)
        start = solve_rest(build_scene(action, choice), self.rest_input)
        jobs: list[Job] = []
        rows: list[tuple[int, Action]] = []
        for i, row in enumerate(values):
            variant = changed_by(action, self.parameters, row - np.array([p.value for p in self.parameters]))
            try:
                scene = build_scene(variant, choice)
                rest = solve_rest(scene, self.rest_input, start)
            except ModelError:
                continue
            run = ForceDrivenRun(scene, self.time_s, self.force_n, times, self.tolerance, DEFAULT_METHOD)
            jobs.append(Job("", "", run, rest))
            rows.append((i, variant))
        for (i, variant), job, member in zip(rows, jobs, _computed(jobs), strict=True):
            if member.solution is not None and job.run is not None:
                motion = times, member.solution.angle_rad, member.solution.speed_rad_per_s
                out[i] = blow_marks(variant, job.run.scene, motion)
        return out

    def _of_members(self, values: ArrayLike) -> Array:
        found = as_numbers(values, "values of members", 2)
        if found.shape[1] != len(self.parameters):
            raise InputError(f"values of members: found shape {found.shape}, allowed (m, {len(self.parameters)})")
        return found


def _computed(jobs: Sequence[Job]) -> Iterator[Member]:
    if not (jobs and lanes_pay() and can(jobs[0])):
        return iter([run_job(job, "") for job in jobs])
    kinds: dict[bytes, list[int]] = {}
    for i, job in enumerate(jobs):  # a variant that switches an element off has another structure
        assert job.run is not None
        kinds.setdefault(b"".join(table.tobytes() for table in job.run.scene.tables), []).append(i)
    members: dict[int, Member] = {}
    for group in kinds.values():
        alike = [replace(jobs[i], in_lanes=True) for i in group]
        members.update(zip(group, run_together(alike, [""] * len(alike)), strict=True))
    return iter([members[i] for i in range(len(jobs))])


def marks_of_unit(variants: Variants, values: Array) -> Array:
    """`Variants.marks`, for an executor."""
    return variants.marks(values)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a study; ``done`` of ``total`` members are computed, and kept where there is a store."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"{done} of {total} members are done")
        self.done, self.total = done, total


@dataclass
class Study:
    """Computes members in units: where, where finished ones are kept, whom to tell.

    ``workers`` counts the threads of this process where no ``executor`` is given.
    """

    executor: Executor | None = None
    workers: int | None = None
    progress: Callable[[int, int], None] | None = None
    store: Path | None = None
    announce: Callable[[Estimate], None] | None = None  # of a study with many units, after its first two
    clock: Callable[[], float] = time.monotonic

    def run(self, variants: Variants, values: Array) -> Array:
        """Marks (m, len(MARKS)) of members with values (m, P), in their order.

        Raises
        ------
        InputError : workers or store cannot be used
        Interrupted : Ctrl-C; units under way are finished and kept
        """
        if self.workers is not None and self.workers < 1:
            raise InputError(f"workers: found {self.workers}, allowed 1 or more")
        if self.store is not None:
            try:
                self.store.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise InputError(f"{self.store}: cannot be made ({problem.strerror}); choose another store") from None
        out = np.full((len(values), len(MARKS)), np.nan)
        units = [slice(k, min(k + UNIT, len(values))) for k in range(0, len(values), UNIT)]
        names = [variants.sha256(values[unit]) if self.store else "" for unit in units]
        todo, done = [], 0
        for unit, name in zip(units, names, strict=True):
            kept = self._kept(name)
            if kept is None or kept.shape != out[unit].shape:
                todo.append((unit, name))
            else:
                out[unit] = kept
                done += len(kept)
        self._tell(done, len(values))
        self._compute(variants, values, todo, out)
        return out

    def _compute(self, variants: Variants, values: Array, todo: list[tuple[slice, str]], out: Array) -> None:
        done = len(out) - sum(unit.stop - unit.start for unit, _ in todo)
        own = ThreadPoolExecutor(self.workers or workers_here()) if self.executor is None else None
        pool = self.executor or own
        assert pool is not None
        at_work = self.workers or getattr(pool, "_max_workers", None) or workers_here()
        waiting: dict[Future[Array], tuple[slice, str]] = {}

        def collect(timeout: float | None) -> None:
            nonlocal done
            for future in wait(waiting, timeout=timeout, return_when=FIRST_COMPLETED).done:
                unit, name = waiting.pop(future)
                out[unit] = future.result()
                self._keep(name, out[unit])
                done += unit.stop - unit.start
                self._tell(done, len(out))

        try:
            if len(todo) > MANY:
                for _ in range(2):  # the first also loads what is compiled
                    began, (unit, name) = self.clock(), todo.pop(0)
                    waiting[pool.submit(marks_of_unit, variants, values[unit])] = unit, name
                    while waiting:
                        collect(POLL_S)
                self._estimate(self.clock() - began, todo, at_work, name)
            for unit, name in todo:
                waiting[pool.submit(marks_of_unit, variants, values[unit])] = unit, name
                while len(waiting) >= AHEAD * at_work:
                    collect(POLL_S)
            while waiting:
                collect(POLL_S)
        except KeyboardInterrupt:
            for future in [f for f in waiting if f.cancel()]:
                waiting.pop(future)
            while waiting:
                collect(None)
            raise Interrupted(done, len(out)) from None
        finally:
            for future in waiting:
                future.cancel()
            if own is not None:
                own.shutdown(wait=True, cancel_futures=True)

    def _estimate(self, seconds: float, todo: list[tuple[slice, str]], workers: int, name: str) -> None:
        """Tell what the units left take, as the last one took; refuse what the disk cannot hold."""
        rounds = -(-len(todo) // workers)
        size = len(todo) * self._path(name).stat().st_size if self.store is not None else 0
        members = sum(unit.stop - unit.start for unit, _ in todo)
        found = Estimate(members, rounds * seconds, workers, size)
        found.check(self.store)
        if self.announce is not None:
            self.announce(found)

    def _tell(self, done: int, total: int) -> None:
        if self.progress is not None and done:
            self.progress(done, total)

    def _path(self, name: str) -> Path:
        assert self.store is not None
        return self.store / f"{name}.npz"

    def _kept(self, name: str) -> Array | None:
        if self.store is None:
            return None
        try:
            with open(self._path(name), "rb") as raw, np.load(raw, allow_pickle=False) as file:
                marks, digest = file["marks"], str(file["sha256"])
        except (OSError, ValueError, KeyError, EOFError, ModelError):
            return None
        except Exception as problem:  # a damaged archive: zipfile and zlib raise errors of their own
            if type(problem).__module__ in ("zipfile", "zlib"):
                return None
            raise
        return marks if digest == _digest(name, marks) else None

    def _keep(self, name: str, marks: Array) -> None:
        if self.store is None:
            return
        with whole_file(self._path(name), "free space, then go on") as part, open(part, "wb") as file:
            np.savez(file, marks=marks, sha256=np.array(_digest(name, marks)))


def _digest(name: str, marks: Array) -> str:
    return hashlib.sha256(name.encode() + np.ascontiguousarray(marks).tobytes()).hexdigest()
