"""Curves, events and the moving action of one trial: measured, and predicted by one or two models.

The stages are those of a report: force corrected, each model driven by it from rest. Angles are changes since rest in
degrees with the thesis's signs; jack and repetition lever come from the film.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import model
from model.errors import ModelError
from model.inside.seen_motion import see_motion
from pianorig.player.moving_action import drawing_times, measured_poses, moving_action
from pianorig.player.packing import pack
from pianorig.workflows.film.session_film import STEP
from rig.errors import RigError
from rig.session import Session, TrialData
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.curves.signs import SIGN, TITLE, degrees
from validation.errors import ValidationError
from validation.events.definitions import EVENTS, Event
from validation.events.detect import find_events
from validation.events.session import predicted_motion
from validation.measurement.trial import MeasuredTrial, measure
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.session import PredictedAngles, predict_trial
from vision.output.colours import colour_of

TOLERANCE_RAD = 1e-5
MOST_MODELS = 2


@dataclass(frozen=True)
class _Predicted:
    """What one model says of a trial."""

    tested: ModelUnderTest
    angles: PredictedAngles


def trial_view(session: Session, number: int, actions: Sequence[str]) -> dict[str, Any]:
    """Everything about a trial but its film, as plain data.

    Parameters
    ----------
    session : Session
    number : of the trial
    actions : built-in actions, at most two; each is drawn, beside the measured action

    Raises
    ------
    rig.errors.RigInputError : no such trial, or it cannot be read
    model.InputError : no such action
    """
    trial = session.trial(number)
    data = trial.read()
    tested = [ModelUnderTest(model.load_action(name), TOLERANCE_RAD) for name in actions[:MOST_MODELS]]
    view: dict[str, Any] = {
        "session": session.path.name,
        "trial": number,
        "status": data.status,
        "rejected": trial.rejected,
        "models": [],
        "notes": [],
        "events": [],
        "drawings": [],
    }
    if data.status == "complete" or data.n_valid == 0:
        view["notes"] = [] if data.n_valid else ["the trial has no samples"]
    else:
        view["notes"] = [f"status {data.status}: {data.reason}"]
    try:
        derived = session.read_derived(STEP, number)
        measured = measure(
            data, None if derived is None else derived[0], tested[0].geometry_at(data.force_info.preload_n)
        )
    except (ValidationError, RigError) as error:
        view["notes"].append(f"shown as recorded: {error}")
        return {**view, **_as_recorded(data)}
    predicted = []
    for one in tested:
        try:
            predicted.append(_Predicted(one, predict_trial(measured, one)))
        except (ModelError, ValidationError) as error:
            view["notes"].append(f"{one.action.name}: not predicted: {error}")
    view["models"] = [each.tested.action.name for each in predicted]
    view["notes"] += measured.notes
    view["events"] = _events(measured, predicted)
    if predicted:
        view["drawings"] = [_drawing(measured, each) for each in predicted]
    return {**view, "force": _force(measured), "channels": _channels(measured, predicted)}


def _force(measured: MeasuredTrial) -> dict[str, Any]:
    return {"time_s": pack(measured.force.time_s), "value": pack(measured.force.force_n), "unit": "N"}


def _as_recorded(data: TrialData) -> dict[str, Any]:
    """Force and encoders as they stand in the file, where a trial cannot be compared."""
    angle = data.angle_rad()
    curve: dict[str, Any] = {
        encoder.name: {
            "title": TITLE.get(encoder.name, encoder.name),
            "color": colour_of(encoder.name, i),
            "measured": {
                "time_s": pack(data.time_s),
                "value": pack(np.degrees(angle[:, i]) * SIGN.get(encoder.name, 1.0)),
            },
            "models": [],
            "residuals": [],
        }
        for i, encoder in enumerate(data.encoders)
    }
    force = {"time_s": pack(data.time_s), "value": pack(data.force_n), "unit": "N"}
    return {"force": force, "channels": curve}


def _measured_of(measured: MeasuredTrial, body: str) -> tuple[Array, Array] | None:
    """Times and measured change of a body's angle, s and rad; None where it was not measured."""
    if body in ENCODER_CHANNELS:
        return measured.time_s, measured.change_rad[:, ENCODER_CHANNELS.index(body)]
    if measured.film is not None and body in FILM_CHANNELS:
        return measured.film.time_s, measured.film.change_rad[body]
    return None


def _channels(measured: MeasuredTrial, predicted: list[_Predicted]) -> dict[str, Any]:
    channels = {}
    for i, body in enumerate(BODIES):
        found = _measured_of(measured, body)
        residuals = []
        for each in predicted if found is not None else []:
            assert found is not None
            at, change = found
            residuals.append(
                {"time_s": pack(at), "value": pack(degrees(body, each.angles.change_at(body, at) - change))}
            )
        channels[body] = {
            "title": TITLE[body],
            "color": colour_of(body, i),
            "measured": None if found is None else {"time_s": pack(found[0]), "value": pack(degrees(body, found[1]))},
            "models": [
                {"time_s": pack(each.angles.time_s), "value": pack(degrees(body, each.angles.change_rad(body)))}
                for each in predicted
            ],
            "residuals": residuals,
        }
    return channels


def _events(measured: MeasuredTrial, predicted: list[_Predicted]) -> list[dict[str, Any]]:
    """Moments of the trial and of the first model, in the order of time."""
    sources = [("measured", find_events(measured.motion, measured.quiet.stop))]
    for each in predicted[:1]:
        geometry = each.tested.geometry_at(measured.force.preload_n)
        motion = predicted_motion(each.angles, geometry, each.tested.tolerance)
        sources.append(("model", find_events(motion, measured.quiet.stop)))
    rows = [_row(source, event) for source, events in sources for event in events.values() if _is_moment(event)]
    return sorted(rows, key=lambda row: row["time_s"])


def _is_moment(event: Event) -> bool:
    return EVENTS[event.name].unit == "s" and event.status != "absent" and math.isfinite(event.value)


def _row(source: str, event: Event) -> dict[str, Any]:
    kind = EVENTS[event.name]
    return {
        "source": source,
        "name": event.name,
        "title": kind.title,
        "time_s": event.value,
        "meaning": kind.definition,
    }


def _drawing(measured: MeasuredTrial, predicted: _Predicted) -> dict[str, Any]:
    """The model's action, and the same bodies at the measured angles."""
    load = predicted.tested.load(measured.force.preload_n)
    start = max(float(measured.force.time_s[0]), float(measured.time_s[0]))
    times = drawing_times(start, float(min(measured.force.time_s[-1], measured.time_s[-1])))
    action, force = predicted.tested.action, measured.force
    scene = model.build_scene(action)
    solution = model.simulate(
        action, force.time_s, force.force_n, output_time_s=times, initial=load.rest, tolerance=TOLERANCE_RAD,
        contact_forces=scene.remembers,
    )  # fmt: skip
    force_n = np.interp(times, force.time_s, force.force_n)
    motion = solution.angle_rad, solution.speed_rad_per_s
    seen = see_motion(scene, times, *motion, force_n, solution.contact_normal_n)
    angle = np.full((times.size, len(BODIES)), np.nan)
    for i, body in enumerate(BODIES):
        found = _measured_of(measured, body)
        if found is not None:
            angle[:, i] = load.rest.angle_rad[i] + np.interp(times, *found, left=np.nan, right=np.nan)
    return moving_action(seen, measured_poses(scene, angle, solution.angle_rad))
