"""The film of a trial on the virtual bench, as a real camera would have saved it beside the trial.

The only place that joins the virtual bench's plant to its camera: the plant's true angles are rendered into frames
that follow the frame pulses of the trial's counter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import vision
from pianorig.errors import CommandInputError
from pianorig.workflows.film.session_film import BODIES_NAME
from rig import Session, Trial
from rig.simulated import ActionGeometry, CameraSettings, FilmTruth, PlantTruth, film_bodies, film_trial

STILL_BEFORE_S = 0.03  # still frames before the blow: reference picture and zero of the angles


def action_geometry(truth: PlantTruth) -> ActionGeometry:
    """Pivots and rest angles of the specimen's filmed bodies, as the camera sees them before the blow."""

    def pivot(body: str) -> tuple[float, float]:
        return truth.action[f"{body}.pivot.x"], truth.action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(angle) for angle in truth.film_angles_at(truth.time_s[:1])[0])
    return ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))


def film_virtual_trial(
    session: Session, trial: Trial, truth: PlantTruth, progress: Callable[[int, int], None] | None = None
) -> FilmTruth:
    """Render the film of one recorded trial from the plant's truth and put it beside the trial.

    Frames start `STILL_BEFORE_S` before the blow; the trial's number is the seed of the camera's noise.

    Raises
    ------
    CommandInputError : the trial has no frame clock
    """
    data = trial.read()
    camera = data.camera
    if camera is None:
        raise CommandInputError(f"{trial.path}: has no frame clock; add a [camera] to the rig file to film")
    settings = replace(CameraSettings(), frame_rate_hz=camera.frame_rate_hz, exposure_s=camera.exposure_s)
    times = camera.frame_time_s
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
