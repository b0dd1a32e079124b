"""Recording a session, with films where the bench is the virtual one.

The only place that joins the virtual bench's plant to its camera: after a filmed trial the plant's true angles are
rendered into the film that a real camera would have saved beside the trial.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pianorig.errors import InputError
from pianorig.workflows.film.track import BODIES_NAME

if TYPE_CHECKING:
    from rig.session import Session, Trial
    from rig.session.info import RoomInfo
    from rig.simulated.bench.camera import FilmTruth
    from rig.simulated.bench.camera_view import ActionGeometry, CameraSettings
    from rig.simulated.bench.plant import PlantTruth

SELFTESTS = Path("selftests")
"""Where ``pianorig selftest`` puts its records."""
STILL_BEFORE_S = 0.03  # still frames before the blow: reference picture and zero of the angles


def action_geometry(truth: PlantTruth) -> ActionGeometry:
    """Pivots and rest angles of the specimen's filmed bodies, as the camera sees them before the blow."""
    from rig.simulated.bench.camera_view import ActionGeometry

    def pivot(body: str) -> tuple[float, float]:
        return truth.action[f"{body}.pivot.x"], truth.action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(angle) for angle in truth.film_angles_at(truth.time_s[:1])[0])
    return ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))


def film_virtual_trial(
    session: Session,
    trial: Trial,
    truth: PlantTruth,
    settings: CameraSettings | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> FilmTruth:
    """Render the film of one recorded trial from the plant's truth and put it beside the trial.

    Frames start `STILL_BEFORE_S` before the blow and follow the frame pulses of the trial's counter.

    Raises
    ------
    InputError : the trial has no frame clock
    """
    from dataclasses import replace

    from rig.simulated.bench.camera import film_trial
    from rig.simulated.bench.camera_view import CameraSettings, film_bodies
    from vision import save_bodies

    data = trial.read()
    if data.camera is None:
        raise InputError(f"{trial.path}: has no frame clock; add a [camera] to the rig file to film")
    camera = data.camera
    settings = replace(settings or CameraSettings(), frame_rate_hz=camera.frame_rate_hz, exposure_s=camera.exposure_s)
    times = camera.frame_time_s
    inside = (times >= data.blow_start_s - STILL_BEFORE_S) & (times <= data.time_s[-1] - camera.exposure_s)
    first = int(np.argmax(inside))
    geometry = action_geometry(truth)
    film = film_trial(
        trial.path.with_suffix(".mraw"),
        times[inside],
        truth.film_angles_at,
        geometry,
        settings,
        seed=seed,
        progress=progress,
        start_frame=first,
    )
    outlines = session.path / BODIES_NAME
    if not outlines.exists():
        save_bodies(outlines, film_bodies(geometry, settings))
    return film


def record(
    out: Path,
    *,
    profile: str | Path = "forte",
    rig: str | Path = "virtual",
    backend: str = "sim://",
    trials: int = 5,
    film: Collection[int] = (),
    operator: str = "unknown",
    action_name: str = "unknown",
    progress: Callable[[Any], None] | None = None,
    film_progress: Callable[[int, int], None] | None = None,
    settings: CameraSettings | None = None,
    yes: bool = False,
    ask: Callable[[str], str | None] | None = None,
    selftests: Path = SELFTESTS,
    plan: Path | None = None,
    room: RoomInfo | None = None,
) -> tuple[Session, dict[int, PlantTruth], dict[int, FilmTruth]]:
    """Record a session and film the trials named in ``film``; a dry run on the model comes first.

    On hardware nothing moves before a valid self-test was found in ``selftests`` (a record or a folder of them) and
    somebody confirmed: ``ask`` shows a question and returns what was typed, ``yes`` takes its place where the rig
    file permits. A ``plan`` file takes the place of ``profile`` and ``trials``; ``ask`` also shows its prompts.

    Returns
    -------
    session : rig.session.Session
    plants, films : truth of each filmed trial of a virtual bench, by number; empty on hardware

    Raises
    ------
    InputError : bad profile, rig file, backend, trial numbers or path, or a dry run outside the limits
    rig.errors.NotPermitted : hardware without self-test or confirmation; nothing has moved
    """
    from pianorig.workflows.model.predict_blow import predictor
    from rig.backend import open_backend
    from rig.configuration.profile import load_profile
    from rig.configuration.rig_file import load_rig
    from rig.recording.recorder import record_session
    from rig.recording.trial_plan import load_plan, plain_plan
    from rig.safety.permission import permit

    trial_plan = load_plan(plan) if plan is not None else plain_plan(load_profile(profile), trials)
    trials = len(trial_plan.entries)
    wrong = [n for n in film if not 1 <= n <= trials]
    if wrong:
        raise InputError(f"--film {wrong[0]}: allowed trial numbers 1 to {trials}")
    rig_file = load_rig(rig)
    bench = open_backend(backend, rig_file.config)
    plants: dict[int, PlantTruth] = {}
    films: dict[int, FilmTruth] = {}

    def after_trial(trial: Trial) -> None:
        if trial.number not in film:
            return
        from rig.session import Session

        session = Session.open(out)
        plants[trial.number] = bench.plant.truth()  # type: ignore[attr-defined]
        films[trial.number] = film_virtual_trial(
            session, trial, plants[trial.number], settings, seed=trial.number, progress=film_progress
        )

    try:
        if film and not hasattr(bench, "plant"):
            raise InputError(f"--film: {backend} has no virtual camera; save the real film beside the trial instead")
        permission = None
        if bench.capabilities.hardware:
            permission = permit(rig_file, backend, selftests, yes=yes, ask=ask)
        session = record_session(
            out,
            plan=trial_plan,
            rig_config=rig_file,
            backend=bench,
            room=room,
            ask=ask,
            operator=operator,
            action_name=action_name,
            progress=progress,
            after_trial=after_trial,
            predict=predictor(rig_file),
            permission=permission,
        )
    finally:
        bench.close()
    return session, plants, films
