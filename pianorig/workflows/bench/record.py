"""Recording a session, with films where the bench is the virtual one."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import closing
from pathlib import Path
from typing import Unpack

from pianorig.errors import CommandInputError
from pianorig.workflows.bench.access import BenchAccess
from pianorig.workflows.bench.render_film import film_virtual_trial
from pianorig.workflows.model.predict_blow import predictor
from rig import Profile, RoomInfo, Session, Trial, load_plan, load_profile, load_rig, open_backend, plain_plan
from rig import record as record_session
from rig import record_passive as record_passive
from rig.configuration.toml_file import check
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.simulated import FilmTruth


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
    """Record a session and film the trials numbered in ``film``; a dry run on the model comes first.

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
            if trial.number in film:
                truth = bench.plant.truth()  # type: ignore[attr-defined]
                films[trial.number] = film_virtual_trial(Session.open(out), trial, truth, film_progress)

        if film and not hasattr(bench, "plant"):
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
