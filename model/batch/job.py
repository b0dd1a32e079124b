"""One member of a batch as plain data: what to simulate, its content hash, and the function that simulates it.

Its hash covers everything the answer depends on: scene, start, force table, output times, tolerance, method, outputs,
the text of the model's code; labels are excluded. A job that cannot be made or computed gives a `Member` with its
error.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord
from model.errors import ModelError
from model.files.force_table import check_force_table
from model.force_driven import (
    ForceDrivenRun,
    Recorded,
    check_output_times,
    force_table_of_trial,
    require_force_input,
    resolve_string_modes,
)
from model.parameters.action import Action, ActionLike, as_action
from model.scene.build import Scene
from model.scene.selection import SceneChoice
from model.simulation.options import ForceDrivenOptions
from model.simulation.run import State
from model.simulation.solution import Solution
from model.simulation.statics import RestState, solve_rest

Array = NDArray[np.float64]
_LABELS = ("trial", "parameters", "failure")


@dataclass(frozen=True)
class Job(ArrayRecord):
    """What one member of a batch needs.

    Attributes
    ----------
    trial, parameters : labels of the force table and of the parameter set
    run : what to simulate, with all numbers; None where ``failure`` says why there is none
    start_rad : (n,) angles at the first time, at rest
    in_lanes : computed side by side with others; another order of operations, hence other last digits
    """

    trial: str
    parameters: str
    run: ForceDrivenRun | None
    start_rad: Array | None
    failure: Exception | None = None
    in_lanes: bool = False

    def sha256(self, known: dict[int, bytes] | None = None) -> str:
        """Hash of everything the result depends on; ``known`` caches digests of arrays and records that jobs share."""
        values = (getattr(self, item.name) for item in fields(self) if item.name not in _LABELS)
        return content_sha256(*values, known=known)


@dataclass(frozen=True)
class Member:
    """Result of one job: a solution, or the error that kept it from one.

    Attributes
    ----------
    trial, parameters : labels of its job
    sha256 : content hash of its job; empty where the job could not be made
    solution, error : one of them is None
    reused : it was read from a store
    """

    trial: str
    parameters: str
    sha256: str
    solution: Solution | None = None
    error: Exception | None = None
    reused: bool = False


def content_sha256(*values: Any, known: dict[int, bytes] | None = None) -> str:
    """Hash of plain values, arrays and records, and of the model's code; ``known`` caches digests by id."""
    digest = hashlib.sha256(code_sha256().encode())
    for value in values:
        _update_digest(digest, value, {} if known is None else known)
    return digest.hexdigest()


def _update_digest(digest: Any, value: Any, known: dict[int, bytes]) -> None:
    """Add a value to the hash ``digest``, with kind and length, so that no two values look alike; ``known`` caches
    digests by id."""
    if isinstance(value, np.ndarray) or is_dataclass(value):
        if id(value) not in known:
            known[id(value)] = _content_digest(value, known)
        digest.update(known[id(value)])
    elif isinstance(value, tuple):
        digest.update(f"tuple {len(value)}\0".encode())
        for one in value:
            _update_digest(digest, one, known)
    elif value is None or isinstance(value, (bool, int, float, str)):
        text = repr(value).encode()
        digest.update(f"{type(value).__name__} {len(text)}\0".encode() + text)
    else:
        raise TypeError(f"a job cannot hold a {type(value).__name__}")


def _content_digest(value: Any, known: dict[int, bytes]) -> bytes:
    """Digest of one array or record; ``known`` caches digests of its parts by id."""
    if isinstance(value, np.ndarray):
        plain = np.ascontiguousarray(value)
        digest = hashlib.sha256(f"array {plain.dtype.str} {plain.shape}\0".encode())
        digest.update(plain.data)
    else:
        digest = hashlib.sha256(f"{type(value).__name__}\0".encode())
        for item in fields(value):
            _update_digest(digest, getattr(value, item.name), known)
    return digest.digest()


@cache
def code_sha256() -> str:
    """SHA-256, hexadecimal, of the text of every Python file of the package ``model`` and of the versions of NumPy and
    numba."""
    digest = hashlib.sha256(f"numpy {np.__version__} numba {numba.__version__}".encode())
    folder = Path(__file__).resolve().parents[1]
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _with_writable_arrays(run: ForceDrivenRun) -> ForceDrivenRun:
    fewer = None if run.fewer_modes is None else _scene_with_writable_arrays(run.fewer_modes)
    return replace(run, scene=_scene_with_writable_arrays(run.scene), fewer_modes=fewer)


def _scene_with_writable_arrays(scene: Scene) -> Scene:
    if all(array.flags.writeable for array in (scene.vector, *scene.tables)):
        return scene
    tables = type(scene.tables)(*(np.require(table, requirements=["C", "W"]) for table in scene.tables))
    return replace(scene, tables=tables)  # with a vector that can be written, as every record is made


def make_jobs(
    action: ActionLike,
    trials: Mapping[str, tuple[ArrayLike, ArrayLike] | Recorded],
    parameter_sets: Mapping[str, Mapping[str, float]],
    options: ForceDrivenOptions,
    initial: RestState | None = None,
) -> list[Job]:
    """Jobs of every parameter set (label -> path -> value) with every trial (name -> times s, forces N, or a record),
    in that order; each starts from ``initial`` (None: its own rest state); one of wrong input holds its error.

    Parameters
    ----------
    action : parameter set that the others start from
    trials : name -> times (k,), s, and forces (k,), N; or a recorded trial, as for `model.simulate`
    parameter_sets : name -> parameter path -> value
    options : tolerance, output times, scene and method, as for `model.simulate`
    initial : rest state to start from; by default that of each parameter set

    Returns
    -------
    list of Job
        A job that cannot be made carries the reason and becomes a member with an ``error``.

    Examples
    --------
    >>> import model
    >>> from model.force_driven import ForceDrivenOptions
    >>> jobs = model.batch.make_jobs(model.load_action(), {"forte": model.force_table("forte")}, {"printed": {}},
    ...                              ForceDrivenOptions())
    >>> jobs[0].trial, jobs[0].parameters
    ('forte', 'printed')
    """
    return make_jobs_of_actions(change_action(action, parameter_sets), trials, options, initial)


def change_action(
    action: ActionLike, parameter_sets: Mapping[str, Mapping[str, float]]
) -> dict[str, Action | ModelError]:
    """By label, the action with the values (path -> value) of each parameter set, or the error that these cause."""
    action = as_action(action)
    out: dict[str, Action | ModelError] = {}
    for label, overrides in parameter_sets.items():
        try:
            out[label] = action.with_values(overrides) if overrides else action
        except ModelError as problem:
            out[label] = problem
    return out


def make_jobs_of_actions(
    actions: Mapping[str, Action | ModelError],
    trials: Mapping[str, tuple[ArrayLike, ArrayLike] | Recorded],
    options: ForceDrivenOptions,
    initial: RestState | None = None,
) -> list[Job]:
    """Jobs of every action (label -> action or error) with every trial (name -> times s, forces N, or a record), in
    that order; each starts from ``initial`` (None: its own rest state); one of wrong input holds its error."""
    tables: dict[str, _Table | Exception] = {}
    for trial, given in trials.items():
        try:
            tables[trial] = _make_table(trial, given, options)
        except (ModelError, ValueError) as problem:  # the force of a recorded trial may not be correctable
            tables[trial] = problem
    jobs = []
    for label, action in actions.items():
        scene, fewer, failure, choice = None, None, None, SceneChoice()
        starts: dict[float, Array] = {}  # by the load at rest
        try:
            if isinstance(action, ModelError):
                raise action
            changed, choice = options.resolve(action)
            scene, fewer = resolve_string_modes(changed, choice, options)
            for table in tables.values():
                if isinstance(table, _Table) and table.is_recorded:
                    require_force_input(choice)
                if isinstance(table, _Table) and table.preload_n not in starts:
                    rest = solve_rest(scene, table.preload_n) if initial is None else initial.angle_rad
                    starts[table.preload_n] = np.array(rest, dtype=float)
        except ModelError as problem:
            failure = problem
        for trial, table in tables.items():
            if isinstance(table, Exception):
                jobs.append(Job(trial, label, None, None, failure or table))
            elif scene is None or failure is not None:
                jobs.append(Job(trial, label, None, None, failure))
            else:
                run = ForceDrivenRun(
                    scene,
                    table.time_s,
                    table.force_n,
                    table.output_time_s,
                    options.tolerance,
                    options.method,
                    choice.outputs,
                    options.estimate_error,
                    fewer,
                )
                jobs.append(Job(trial, label, run, starts[table.preload_n]))
    return jobs


@dataclass(frozen=True)
class _Table:
    """What drives a member: a force table (k,), where rows come out (m,), and the load at rest."""

    time_s: Array
    force_n: Array
    output_time_s: Array
    preload_n: float
    is_recorded: bool


def _make_table(name: str, given: tuple[ArrayLike, ArrayLike] | Recorded, options: ForceDrivenOptions) -> _Table:
    """Force table (s, N), output times, s, and load at rest, N, of a trial ``given`` as (time s, force N), then without
    load, or as a record; the output times of ``options``, else the trial's own. ``name`` is for messages."""
    preload_n, sampled, is_recorded = 0.0, None, not isinstance(given, tuple | list)
    if isinstance(given, tuple | list):
        times, forces = check_force_table(*given, f"trial {name}")
    else:
        times, forces, preload_n, sampled = force_table_of_trial(given)
    asked = sampled if options.output_time_s is None else options.output_time_s
    return _Table(times, forces, check_output_times(asked, times), preload_n, is_recorded)


def prepare_run(job: Job) -> tuple[ForceDrivenRun, State]:
    """What a job simulates, with arrays that kernels accept, and the state it starts from."""
    assert job.run is not None and job.start_rad is not None
    run = _with_writable_arrays(job.run)
    return run, State(float(run.time_s[0]), job.start_rad.copy(), np.zeros(run.scene.size))


def run_job(job: Job, sha256: str) -> Member:
    """Compute one job, the same to the last bit as ``model.simulate`` with the same input; the member carries
    ``sha256`` and holds a solution or the error.

    Parameters
    ----------
    job : from `make_jobs`
    sha256 : its content hash, `Job.sha256`, which the member carries on

    Returns
    -------
    Member
        With a ``solution``, or with the ``error`` that kept it from one.

    Examples
    --------
    >>> import model
    >>> from model.force_driven import ForceDrivenOptions
    >>> jobs = model.batch.make_jobs(model.load_action(), {"forte": model.force_table("forte")}, {"printed": {}},
    ...                              ForceDrivenOptions())
    >>> model.batch.run_job(jobs[0], jobs[0].sha256()).solution.angle_rad.shape
    (3501, 5)
    """
    if job.run is None or job.start_rad is None:
        return Member(job.trial, job.parameters, sha256, error=job.failure)
    run, state = prepare_run(job)
    try:
        solution = run.simulate_from(state)
    except ModelError as problem:
        return Member(job.trial, job.parameters, sha256, error=problem)
    return Member(job.trial, job.parameters, sha256, solution)
