"""One trial under one time cursor: curves, film with outlines, the action moving as measured and as the model says."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import model
import vision
from model.errors import ModelError
from model.inside.body_poses import observe_poses
from model.tolerance import DEFAULT_TOLERANCE
from pianorig.player.moving_action import drawing_times, measured_poses, moving_action, pack
from pianorig.workflows.session_film import BODIES_NAME, STEP, SessionFilm
from rig.atomic_write import sha256_of_file
from rig.errors import RigError
from rig.session import Session, Trial, TrialData
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.curves.display_signs import SIGN, TITLE, degrees
from validation.errors import ValidationError
from validation.events.definitions import EVENTS, Event
from validation.events.detect import find_events
from validation.events.session_events import make_predicted_motion
from validation.measurement.trial import MeasuredTrial, measure
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles, predict_trial
from vision.output.colours import LOST, body_colour
from vision.results.flags import FAILURE

MOST_OPEN = 4  # film files at once: two sessions side by side, twice

Key = tuple[Path, int, int]


class FilmShelf:
    """Films that stay open between two frames, the last `MOST_OPEN` of them."""

    def __init__(self) -> None:
        self._films: OrderedDict[Key, tuple[vision.Film, threading.Lock]] = OrderedDict()
        self._lock = threading.Lock()

    def frames(self, path: Path, first: int, count: int) -> bytes:
        """Grey values of ``count`` frames from ``first`` on, fewer at the film's end, frame after frame, row by row, a
        byte a pixel; of deeper films the upper eight bits.

        Not encoded: on the loopback a byte is cheaper than what it takes to compress it.
        """
        film, lock = self._film(path)
        with lock:
            frames = [film.read(index) for index in range(first, min(first + count, film.n_frames))] or [
                film.read(first)
            ]
        down = max(0, film.bit_depth - 8)
        grey = [frame if frame.dtype == np.uint8 else (frame >> down).astype(np.uint8) for frame in frames]
        return b"".join(frame.tobytes() for frame in grey)

    def _film(self, path: Path) -> tuple[vision.Film, threading.Lock]:
        """The film at ``path``, kept open, and the lock to hold while reading it; it is opened anew where the file
        changed, and those unused longest are closed."""
        stat = path.stat()
        key = (path, stat.st_size, stat.st_mtime_ns)
        with self._lock:
            if key not in self._films:
                self._films[key] = vision.open_film(path, allow_truncated=True), threading.Lock()
            self._films.move_to_end(key)
            while len(self._films) > MOST_OPEN:
                _, (old, busy) = self._films.popitem(last=False)
                with busy:
                    old.close()
            return self._films[key]

    def close(self) -> None:
        with self._lock:
            for film, busy in self._films.values():
                with busy:
                    film.close()
            self._films.clear()


def film_view(session: Session, trial: Trial) -> dict[str, Any] | None:
    """Size, frame times (s on the trial's clock) and tracked outlines of a trial's film, as plain data for the page;
    None where it has none.

    Times come from the trial's frame clock; a film that cannot be tied to it has a ``note`` and no times.
    """
    if trial.film is None:
        return None
    return outlined_film(SessionFilm(trial.film, session.path / BODIES_NAME), session.read_derived(STEP, trial.number))


def outlined_film(film: SessionFilm, found: tuple[pd.DataFrame, dict[str, Any]] | None) -> dict[str, Any]:
    """Size, frame times, s, and tracked outlines of a film as plain data for the page; ``found``: table of tracked
    angles and its attributes, None before tracking; a ``note`` says why times are None."""
    with vision.open_film(film.path, allow_truncated=True) as source:
        note = ""
        try:
            times: Any = film.frame_times(source)[0]
        except (RigError, ValueError) as error:
            times, note = None, f"frames have no place on the time axis: {error}"
        else:
            times = source.frame_time_s if times is None else times
        view: dict[str, Any] = {
            "name": film.path.name,
            "n_frames": source.n_frames,
            "height": source.height,
            "width": source.width,
            "in_order": source.in_order,
            "time_s": None if times is None else times.tolist(),
            "note": note,
            "version": f"{film.path.stat().st_mtime_ns}",
            "lost_color": LOST,
            "bodies": [],
        }
        if found is not None:
            outlines, doubt = _outlines(film.outlines, source, *found)
            view["bodies"], view["note"] = outlines, "; ".join(filter(None, (note, doubt)))
    return view


def _outlines(
    outlines_file: Path, source: vision.Film, table: pd.DataFrame, attributes: dict[str, Any]
) -> tuple[list[dict[str, Any]], str]:
    """Outline of each tracked body, px about its centre, with its pose and whether it was lost, by tracked frame, as
    plain data; and a text on what to doubt, empty for nothing."""
    if not outlines_file.is_file():
        return [], f"{outlines_file.name} is missing; the tracked outlines cannot be drawn"
    if "frame" in table:
        table = table[table["frame"] >= 0]  # others are missing in the film
    try:
        bodies = vision.load_bodies(outlines_file)
        masks = vision.build_masks(bodies, source.height, source.width)
    except vision.VisionError as error:
        return [], f"the tracked outlines cannot be drawn: {error}"
    seals = attributes.get("parents_sha256", {})  # a table on its own has none
    seal = seals.get(outlines_file.name)
    doubt = ""
    if seals and seal != sha256_of_file(outlines_file):
        doubt = f"{outlines_file.name} has changed since the film was tracked: track again"
    views = []
    for i, (body, mask) in enumerate(zip(bodies, masks, strict=True)):
        columns = [f"{body.name}_{name}" for name in ("rad", "x_px", "y_px", "flag")]
        if any(name not in table for name in (*columns, "frame")):
            doubt = doubt or f"{body.name} was not tracked; track the film again"
            continue
        rows, cols = np.nonzero(mask)  # the pose is that of the centre of the pixels that were fitted
        angle, x, y, flag = (table[name].to_numpy() for name in columns)
        views.append(
            {
                "name": body.name,
                "color": body_colour(body.name, i),
                "points": (body.polygon_px - (cols.mean(), rows.mean())).tolist(),
                "frame": table["frame"].to_numpy(dtype=int).tolist(),
                "turn": pack(vision.ccw_to_picture(angle)),
                "x": pack(x),
                "y": pack(y),
                "lost": ((flag.astype(int) & int(FAILURE)) != 0).tolist(),
            }
        )
    return views, doubt


MOST_MODELS = 2  # drawn over one film: more cannot be told apart


_Predicted = tuple[ModelUnderTest, PredictedAngles]


def trial_view(session: Session, number: int, actions: Sequence[str]) -> dict[str, Any]:
    """Everything about a trial but its film as plain data: status, notes, events, measured curves, and those predicted
    by built-in ``actions`` (the first two) with drawings; only the recorded curves where it cannot be compared."""
    trial = session.trial(number)
    data = trial.read()
    tested = [ModelUnderTest(model.load_action(name), DEFAULT_TOLERANCE) for name in actions[:MOST_MODELS]]
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
        return {**view, **_recorded_curves(data)}
    predicted = []
    for one in tested:
        try:
            predicted.append((one, predict_trial(measured, one)))
        except (ModelError, ValidationError) as error:
            view["notes"].append(f"{one.action.name}: not predicted: {error}")
    view["models"] = [model_of.action.name for model_of, _ in predicted]
    view["notes"] += measured.notes
    view["events"] = _events(measured, predicted)
    if predicted:
        view["drawings"] = [_animate_trial(measured, model_of) for model_of, _ in predicted]
    return {**view, "force": _force(measured), "channels": _channels(measured, predicted)}


def _force(measured: MeasuredTrial) -> dict[str, Any]:
    return {"time_s": pack(measured.force.time_s), "value": pack(measured.force.force_n), "unit": "N"}


def _recorded_curves(data: TrialData) -> dict[str, Any]:
    """Raw force, N, and angles since the first sample, degrees, clockwise positive but for the whippen, of a trial that
    cannot be compared, as packed float32 (`pack`)."""
    angle = data.angle_rad
    curve: dict[str, Any] = {
        encoder.name: {
            "title": TITLE.get(encoder.name, encoder.name),
            "color": body_colour(encoder.name, i),
            "measured": {
                "time_s": pack(data.time_s),
                "value": pack(np.degrees(angle[:, i]) * SIGN.get(encoder.name, 1.0)),
            },
            "models": [],
            "residuals": [],
        }
        for i, encoder in enumerate(data.encoders)
    }
    force = {"time_s": pack(data.time_s), "value": pack(data.raw_force_n), "unit": "N"}
    return {"force": force, "channels": curve}


def _measured_of(measured: MeasuredTrial, body: str) -> tuple[Array, Array] | None:
    """Times and measured change of a body's angle, s and rad; None where it was not measured."""
    if body in ENCODER_CHANNELS:
        return measured.time_s, measured.change_rad[:, ENCODER_CHANNELS.index(body)]
    if measured.film is not None and body in FILM_CHANNELS:
        return measured.film.time_s, measured.film.change_rad[body]
    return None


def _channels(measured: MeasuredTrial, predicted: list[_Predicted]) -> dict[str, Any]:
    """Curves of each body as packed float32 (`pack`), degrees, clockwise positive but for the whippen: measured (None
    where it was not), predicted by each model, and residuals: prediction less measurement, at the measured times."""
    channels = {}
    for i, body in enumerate(BODIES):
        found = _measured_of(measured, body)
        at, change = found or (measured.time_s[:0], measured.time_s[:0])
        channels[body] = {
            "title": TITLE[body],
            "color": body_colour(body, i),
            "measured": None if found is None else {"time_s": pack(at), "value": pack(degrees(body, change))},
            "models": [
                {"time_s": pack(angles.time_s), "value": pack(degrees(body, angles.change_rad(body)))}
                for _, angles in predicted
            ],
            "residuals": [
                {"time_s": pack(at), "value": pack(degrees(body, angles.change_at(body, at) - change))}
                for _, angles in predicted
                if found is not None
            ],
        }
    return channels


def _events(measured: MeasuredTrial, predicted: list[_Predicted]) -> list[dict[str, Any]]:
    """Rows of the page's table of events, in order of time: one for each event that is a moment, of the measured trial
    (``source`` measured) and again of the first of ``predicted`` (``source`` model)."""
    sources = [("measured", find_events(measured.motion, measured.quiet.stop))]
    for tested, angles in predicted[:1]:
        motion = make_predicted_motion(angles, tested.geometry_at(measured.force.preload_n), tested.tolerance)
        sources.append(("model", find_events(motion, measured.quiet.stop)))
    rows = [_event_row(source, event) for source, events in sources for event in events.values() if _is_moment(event)]
    return sorted(rows, key=lambda row: row["time_s"])


def _is_moment(event: Event) -> bool:
    return EVENTS[event.name].unit == "s" and event.status != "absent" and math.isfinite(event.value)


def _event_row(source: str, event: Event) -> dict[str, Any]:
    """Row of the page's table of events: ``source`` (measured or model), name, title, time, s, meaning."""
    kind = EVENTS[event.name]
    return {
        "source": source,
        "name": event.name,
        "title": kind.title,
        "time_s": event.value,
        "meaning": kind.definition,
    }


def _animate_trial(measured: MeasuredTrial, tested: ModelUnderTest) -> dict[str, Any]:
    """Simulate the model under the trial's corrected force, from its rest under the preload; return the moving drawing,
    with the measured bodies over it."""
    load = tested.load(measured.force.preload_n)
    start = max(float(measured.force.time_s[0]), float(measured.time_s[0]))
    times = drawing_times(start, float(min(measured.force.time_s[-1], measured.time_s[-1])))
    action, force = tested.action, measured.force
    scene = model.build_scene(action)
    solution = model.simulate(
        action, force.time_s, force.force_n, output_time_s=times, initial=load.rest, tolerance=DEFAULT_TOLERANCE,
        contact_forces=scene.remembers,
    )  # fmt: skip
    force_n = np.interp(times, force.time_s, force.force_n)
    motion = solution.angle_rad, solution.speed_rad_per_s
    seen = observe_poses(scene, times, *motion, force_n, solution.contact_normal_n)
    angle = np.full((times.size, len(BODIES)), np.nan)
    for i, body in enumerate(BODIES):
        found = _measured_of(measured, body)
        if found is not None:
            angle[:, i] = load.rest.angle_rad[i] + np.interp(times, *found, left=np.nan, right=np.nan)
    return moving_action(seen, measured_poses(scene, angle, solution.angle_rad))
