"""Variants of an action under one blow, many of them: computed in units, measured at once, kept as they finish.

A unit of members is plain data; it builds its scenes, advances them side by side in lanes (`model.batch.lanes`) and
gives marks alone, so that a million members need neither memory nor a network. Finished units lie in a folder under the
hash of all they depend on, and are not computed again.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.batch.job import Job, Member, content_sha256
from model.batch.lanes import UNIT, choose, run_unit, units
from model.batch.run import work_through, workers_here
from model.batch.store import Store
from model.errors import InputError, ModelError
from model.force_driven import ForceDrivenRun, output_times
from model.integrators.methods import DEFAULT_METHOD
from model.parameters.action import Action
from model.scene.build import build_scene
from model.scene.selection import choice_of
from model.scene.string_terms import with_modes
from model.screening.blow_marks import MARKS, blow_marks
from model.sensitivity.parameter_names import Parameter, changed_by
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

RATE_HZ = 5000.0  # of the samples that marks are read from
MANY = 8  # units from which on a study is estimated before it goes on
MUCH_BYTES = 1_000_000


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
        varied = tuple((p.name, p.value, repr(p.paths)) for p in self.parameters)
        about = self.action.content(), self.rest_input, self.tolerance, MARKS, varied
        return content_sha256(*about, self.time_s, self.force_n, self._of_members(values))

    def marks(self, values: ArrayLike) -> Array:
        """Marks (m, len(MARKS)) of members with values (m, P); a row of NaN where one cannot rest or be simulated."""
        values, choice = self._of_members(values), choice_of(self.action)
        action = with_modes(self.action, self.tolerance)
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
                out[i] = blow_marks(variant, job.run.scene, (times, *member.solution.whole()[1:]))
        return out

    def _of_members(self, values: ArrayLike) -> Array:
        found = as_numbers(values, "values of members", 2)
        if found.shape[1] != len(self.parameters):
            raise InputError(f"values of members: found shape {found.shape}, allowed (m, {len(self.parameters)})")
        return found


def _computed(jobs: Sequence[Job]) -> list[Member]:
    """Members of jobs in their order: in lanes, those of one structure together."""
    jobs = choose(jobs, lanes=True)
    members: dict[int, Member] = {}
    for unit in units(jobs, range(len(jobs)), workers=1):
        members.update(zip(unit, run_unit([jobs[i] for i in unit], [""] * len(unit)), strict=True))
    return [members[i] for i in range(len(jobs))]


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a study; ``done`` of ``total`` members are computed, and kept where there is a store."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"{done} of {total} members are done")
        self.done, self.total = done, total


class Estimate(NamedTuple):
    """What is left of a study, told before most of it is computed.

    Attributes
    ----------
    members : still to compute
    seconds : that they take on ``workers``
    workers : that compute at the same time
    size : bytes that their marks take on disk, 0 where none are kept
    """

    members: int
    seconds: float
    workers: int
    size: int

    def line(self) -> str:
        """One line for the terminal."""
        kept = f", {max(self.size / MUCH_BYTES, 0.1):.1f} MB on disk" if self.size else ""
        unit, size = next((u for u in (("h", 3600.0), ("min", 60.0)) if self.seconds >= 2.0 * u[1]), ("s", 1.0))
        about = f"{self.seconds / size:.{0 if unit == 's' else 1}f} {unit}"
        return f"{self.members} members: about {about} on {self.workers} workers{kept}"


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
        InputError : workers or store cannot be used, or the disk cannot hold what is to be kept
        Interrupted : Ctrl-C; units under way are finished and kept
        """
        store = None if self.store is None else Store(self.store)
        out = np.full((len(values), len(MARKS)), np.nan)
        todo = [range(k, min(k + UNIT, len(values))) for k in range(0, len(values), UNIT)]
        names: dict[int, str] = {}
        if store is not None:
            names = {unit.start: variants.sha256(values[unit]) for unit in todo}
            for unit in list(todo):
                kept = store.get(names[unit.start])
                if kept is not None and kept[1]["marks"].shape == out[unit].shape:
                    out[unit] = kept[1]["marks"]
                    todo.remove(unit)
        done = len(out) - sum(map(len, todo))
        if self.progress is not None and done:
            self.progress(done, len(out))

        def submit(pool: Executor, unit: Sequence[int]) -> Future[Array]:
            return pool.submit(variants.marks, values[unit])

        def finish(unit: Sequence[int], future: Future[Array]) -> None:
            nonlocal done
            out[unit] = future.result()
            if store is not None:
                store.put(names[unit[0]], {}, {"marks": out[unit]})
            done += len(unit)

        def work(units: list[range]) -> None:
            work_through(
                units,
                submit,
                finish,
                executor=self.executor,
                workers=self.workers,
                progress=self.progress,
                count=(done, len(out)),
            )

        try:
            if len(todo) > MANY:
                work(todo[:1])  # also loads what is compiled
                began = self.clock()
                work(todo[1:2])
                size = 0 if store is None else store.path(names[todo[1].start]).stat().st_size
                todo = todo[2:]
                self._estimate(self.clock() - began, todo, size)
            work(todo)
        except KeyboardInterrupt:
            raise Interrupted(done, len(out)) from None
        return out

    def _estimate(self, seconds: float, todo: list[range], size: int) -> None:
        """Tell what the units left take, each the time and bytes of the last one; refuse what the disk cannot hold."""
        workers = self.workers or getattr(self.executor, "_max_workers", None) or workers_here()
        needed = len(todo) * size
        if self.store is not None and needed > (free := shutil.disk_usage(self.store).free):
            raise InputError(
                f"{self.store}: the study needs {needed / MUCH_BYTES:.0f} MB, {free / MUCH_BYTES:.0f} MB are free; "
                "free space and go on with the same command, or choose another folder"
            )
        if self.announce is not None:
            self.announce(Estimate(sum(map(len, todo)), -(-len(todo) // workers) * seconds, workers, needed))
