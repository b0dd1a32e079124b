"""Recording on a bench: the permission to move it, its dry run, a session, what Ctrl-C did to it, going on later."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

import vision
from pianorig.console.failures import Interrupted, how_stopped
from pianorig.console.options import SELFTESTS
from pianorig.errors import CommandInputError
from pianorig.workflows.predict_blow import predictor
from pianorig.workflows.session_film import BODIES_NAME
from rig import (
    Backend,
    Permission,
    Profile,
    Progress,
    Rig,
    RigInputError,
    RoomInfo,
    Session,
    Trial,
    dry_run,
    load_plan,
    load_profile,
    load_rig,
    motor_command,
    open_backend,
    permit,
    plain_plan,
    session_rig,
)
from rig import record as record_session
from rig import resume as resume_session
from rig.configuration.toml_file import check
from rig.daq.task_plan import recording_plan
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.session.info import PASSIVE
from rig.simulated import ActionGeometry, CameraSettings, FilmTruth, PlantTruth, film_bodies, film_trial
from rig.simulated.backend import SimulatedBackend


@dataclass(frozen=True)
class BenchAccess:
    """A bench and the permission to move it.

    Attributes
    ----------
    rig : built-in rig or path of a rig file
    backend : address, ``sim://``, ``ni://local`` or ``ni-grpc://host:port``
    yes : take the place of a typed confirmation, where the rig file permits
    ask : shows a question and returns what was typed; None when nobody can be asked
    selftests : record of a self-test, or the folder of them
    """

    rig: str | Path = "virtual"
    backend: str = "sim://"
    yes: bool = False
    ask: Callable[[str], str | None] | None = None
    selftests: Path = SELFTESTS

    def permission(self, rig_file: Rig, bench: Backend) -> Permission | None:
        """Permission to move the hardware behind ``bench``, after a valid self-test and confirmation (else
        NotPermitted); None where nothing real moves.

        Raises
        ------
        rig.errors.NotPermitted : hardware without self-test or confirmation; nothing has moved
        """
        if not bench.capabilities.hardware:
            return None
        return permit(rig_file, self.backend, self.selftests, yes=self.yes, ask=self.ask)


@contextmanager
def report_interrupt(folder: Path, *, resumed: bool = False) -> Iterator[None]:
    """Context that turns Ctrl-C during a recording into ``folder`` into `Interrupted`, whose message says in which
    state outputs and session are; ``resumed``: the folder had a session before."""
    others = folder.is_dir() and any(folder.iterdir()) and not resumed  # the recorder would have refused it
    try:
        yield
    except KeyboardInterrupt as interrupt:
        outputs = "; ".join(getattr(interrupt, "__notes__", ()))  # added by rig.recording.trial_run
        left = "nothing was recorded" if others else _remaining_words(folder)
        told = [how_stopped(interrupt), *([outputs] if outputs else []), left]
        raise Interrupted("; ".join(told)) from interrupt


def _remaining_words(folder: Path) -> str:
    """In words, what an interrupted recording left in its folder (nothing, a journal, sealed trials), and the command
    that goes on."""
    if not folder.is_dir():
        return "nothing was recorded and no session was made"
    try:
        session = Session.open(folder, require_trials=False)
        trials, journals = session.trials, session.journals
        states = [trial.status for trial in trials]
    except RigInputError as problem:
        return f"session at {folder} cannot be read ({problem})"
    if journals:
        return f"trial {max(journals)} is in its journal, seal it with  pianorig recover {folder}; session at {folder}"
    if not trials:
        return f"no trial was recorded; session at {folder}"
    last, planned = trials[-1].number, session.info.plan.trials
    unplanned = session.info.profile.name == PASSIVE or session.info.kind == "felt"
    lacking = 0 if unplanned else planned - states.count("complete")
    more = f", {lacking} of {planned} trials to go: pianorig record --resume {folder}" if lacking > 0 else ""
    return f"trial {last} sealed as {states[-1]}; session at {folder}{more}"


STILL_BEFORE_S = 0.03  # still frames before the blow: reference picture and zero of the angles


def action_geometry(truth: PlantTruth) -> ActionGeometry:
    """Pivots, m, of whippen, jack and repetition lever of the virtual specimen, and their angles at the first sample,
    rad, jack and lever from the whippen: what the virtual camera draws."""

    def pivot(body: str) -> tuple[float, float]:
        return truth.action[f"{body}.pivot.x"], truth.action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(angle) for angle in truth.film_angles_at(truth.time_s[:1])[0])
    return ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))


def film_virtual_trial(
    session: Session, trial: Trial, bench: SimulatedBackend, progress: Callable[[int, int], None] | None = None
) -> FilmTruth:
    """Render the film of the trial just recorded from the virtual plant's true angles beside the trial's file, and
    write the session's outlines where it has none; return the true angles. CommandInputError without a camera.

    Frames start `STILL_BEFORE_S` before the blow; the trial's number is the seed of the camera's noise. A camera that
    runs by itself exposes when the bench says, not when the trial believes.
    """
    data = trial.read()
    camera = data.camera
    if camera is None:
        raise CommandInputError(f"{trial.path}: has no frame clock; add a [camera] to the rig file to film")
    settings = replace(CameraSettings(), frame_rate_hz=camera.frame_rate_hz, exposure_s=camera.exposure_s)
    times, truth, exposures = camera.frame_time_s, bench.plant.truth(), bench.device.bench.exposures
    if exposures is not None:
        times = exposures.first_s + np.arange(times.size) / exposures.rate_hz + camera.exposure_s / 2
    filmed = (times >= data.blow_start_s - STILL_BEFORE_S) & (times <= data.time_s[-1] - camera.exposure_s)
    geometry = action_geometry(truth)
    film = film_trial(
        trial.path.with_suffix(".mraw"),
        times[filmed],
        truth.film_angles_at,
        geometry,
        settings,
        seed=trial.number,
        progress=progress,
        start_frame=int(np.argmax(filmed)),
    )
    outlines = session.path / BODIES_NAME
    if not outlines.exists():
        vision.save_bodies(outlines, film_bodies(geometry, settings))
    return film


def rehearse(profile: str | Profile, rig: str, backend: str, plan_file: Path | None = None) -> dict[str, Any]:
    """Predict a blow, reserve every task on the bench and release it, so that nothing moves; return backend, rig,
    prediction and tasks by name, of a plan file those of each condition.

    With ``plan_file`` the profiles of its conditions count, and each answer stands by name under ``conditions``.

    Raises
    ------
    rig.errors.InputError : profile, rig file or prediction outside the limits
    rig.errors.HardwareFault : the device refuses a channel, route, rate or counter
    """
    if plan_file is not None:
        return {"conditions": {k: rehearse(one, rig, backend) for k, one in load_plan(plan_file).profiles.items()}}
    rig_file = load_rig(rig)
    chosen = profile if isinstance(profile, Profile) else load_profile(profile)
    command = motor_command(chosen, rig_file.config)
    predicted = dry_run(chosen, rig_file.config, predictor(rig_file))
    with closing(open_backend(backend, rig_file.config)) as bench:
        timing = bench.configure(rig_file.config, command.volts)
        tasks = recording_plan(rig_file.config, timing, command.volts.size)
        name = bench.capabilities.name
    return {
        "backend": name,
        "rig": rig_file.config.name,
        "prediction": predicted,
        "tasks": [asdict(row) for row in tasks],
    }


def rehearsal_lines(found: dict[str, Any]) -> list[str]:
    """Lines to print of what `rehearse` found: each task with its channel, clock, trigger and routes, then the
    predicted quantities."""
    if "conditions" in found:
        return [line for name, one in found["conditions"].items() for line in (f"{name}:", *rehearsal_lines(one))]
    lines = [f"{found['backend']}, rig {found['rig']}: every task was reserved and released, nothing has moved"]
    for row in found["tasks"]:
        lines.append(f"{row['task']:<16} {row['channel']:<24} {row['purpose']}")
        details = [("clock", row["clock"]), ("trigger", row["trigger"]), *(("route", route) for route in row["routes"])]
        lines += [f"{'':<16}   {label:<7} {text}" for label, text in details]
    return [*lines, "predicted:", *(f"  {key:<28} {value}" for key, value in found["prediction"].items())]


def room_conditions(temperature_c: float | None, humidity_percent: float | None) -> RoomInfo | None:
    """The room as ``session.toml`` describes it; None where nothing was measured."""
    measured = {"temperature_c": temperature_c, "relative_humidity_percent": humidity_percent}
    known = {name: value for name, value in measured.items() if value is not None}
    return check(RoomInfo, known, "--temperature, --humidity") if known else None


def record(
    out: Path,
    access: BenchAccess | None = None,
    *,
    plan_file: Path | None = None,
    film: Collection[int] = (),
    film_progress: Callable[[int, int], None] | None = None,
    **keywords: Unpack[RecordingKeywords],
) -> tuple[Session, dict[int, FilmTruth]]:
    """Record a session into ``out`` on a bench (None: the virtual one) after a dry run on the model; trials numbered in
    ``film`` are filmed too (virtual bench only). Return it and the films' true angles by number.

    On hardware nothing moves before a valid self-test was found and somebody confirmed, see `BenchAccess`.

    Parameters
    ----------
    access : the bench; by default the virtual one
    plan_file : trial plan, in place of ``profile`` and ``trials``
    film_progress : called with frames done and frames in all
    keywords : profile, trials, operator, action_name, room, progress, notes, see `rig.record`

    Returns
    -------
    session : rig.Session
    films : truth of each filmed trial of a virtual bench, by number; empty on hardware

    Raises
    ------
    CommandInputError : bad trial numbers, or a film wanted of a bench without virtual camera
    rig.RigError : bad profile, rig file, backend or path, a dry run outside the limits, no permission, a fault
    """
    access, options = access or BenchAccess(), RecordingOptions(**keywords)
    if plan_file is not None:
        plan = load_plan(plan_file)
    elif options.plan is not None:
        plan = options.plan
    else:
        profile = options.profile if isinstance(options.profile, Profile) else load_profile(options.profile)
        plan = plain_plan(profile, options.trials)
    wrong = [n for n in film if not 1 <= n <= len(plan.entries)]
    if wrong:
        raise CommandInputError(f"--film {wrong[0]}: allowed trial numbers 1 to {len(plan.entries)}")
    rig_file = load_rig(access.rig)
    films: dict[int, FilmTruth] = {}
    with closing(open_backend(access.backend, rig_file.config)) as bench:

        def after_trial(trial: Trial) -> None:
            if isinstance(bench, SimulatedBackend) and trial.number in film:
                films[trial.number] = film_virtual_trial(Session.open(out), trial, bench, film_progress)

        if film and not isinstance(bench, SimulatedBackend):
            raise CommandInputError(
                f"--film: {access.backend} has no virtual camera; save the real film beside the trial instead"
            )
        on_bench = RecordingKeywords(
            plan=plan,
            rig_config=rig_file,
            backend=bench,
            ask=access.ask,
            after_trial=after_trial,
            predict=predictor(rig_file),
            permission=access.permission(rig_file, bench),
        )
        session = record_session(out, **(keywords | on_bench))
    return session, films


def resume(
    folder: Path,
    access: BenchAccess,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[Session, list[int]]:
    """Record what is left of the plan of the session in ``folder``, with its own rig file, not that of ``access``;
    return the session and the numbers of the new trials.

    ``progress`` as for `rig.record`.

    Raises
    ------
    rig.errors.RigError : nothing left, another kind of bench, or the bench stopped
    """
    rig_file = session_rig(Session.open(folder, require_trials=False))
    before: list[int] = []
    with closing(open_backend(access.backend, rig_file.config)) as bench:
        session = resume_session(
            folder,
            bench,
            opened=before.append,
            progress=progress,
            ask=access.ask,
            predict=predictor(rig_file),
            permission=access.permission(rig_file, bench),
        )
    return session, [trial.number for trial in session.trials if trial.number > before[0]]
