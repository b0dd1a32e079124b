"""Predictions of all trials of a session: the second stage of a comparison.

A trial the model cannot predict is refused with the reason; a rival that cannot be predicted is left out with a note.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain
from time import thread_time
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

import model
from model.errors import ModelError
from model.simulation.solution import MISSED
from validation.cache.content_hash import result_key
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, WORKERS, Array
from validation.errors import PredictionError, ValidationInputError
from validation.measurement.measure_session import NOT_PREDICTED, MeasuredSession
from validation.measurement.trial import MOST_NAMED, MeasuredTrial, trials_in_words
from validation.prediction.key_driven import run_key_driven, run_null_key_driven
from validation.prediction.model_under_test import ModelUnderTest

STEP = "prediction"
# what drives and what predicts
VARIANTS = ("model", "raw_force", "null")
KEY_DRIVEN = ("model", "null")
COLUMNS = [f"{body}_rad" for body in BODIES], [f"{body}_rad_per_s" for body in BODIES]


@dataclass(frozen=True)
class PredictedAngles:
    """Predicted angles of one trial.

    ``turn_rad`` are the changes since rest, in columns that traces share: a session has hundreds. ``reused`` says that
    no simulation was needed, ``error_rad`` how large their largest numerical error is (estimated; NaN where it was not:
    for rivals and stand-ins). ``counters`` are those of the solution, and ``seconds`` of processor time. ``check_load``
    says where the back check presses the rising hammer.
    """

    time_s: Array
    turn_rad: Array
    speed_rad_per_s: Array
    rest_angle_rad: Array
    input_sha256: str
    reused: bool
    counters: Mapping[str, float]
    error_rad: float = float("nan")
    check_load: str = ""

    @property
    def angle_rad(self) -> Array:
        """Absolute angles, (n, 5) rad."""
        return self.turn_rad + self.rest_angle_rad

    def change_rad(self, body: str) -> Array:
        """Change of one body's angle since rest on the DAQ's sample times, (n,) rad."""
        return self.turn_rad[:, BODIES.index(body)]

    def without_speeds(self) -> PredictedAngles:
        """Copy without speeds, for a trial without film, which is read at its samples only."""
        return replace(self, speed_rad_per_s=np.empty((0, len(BODIES))))

    def change_at(self, body: str, time_s: Array) -> Array:
        """Change of a body's angle since rest, rad, at times (k,), s, by cubic interpolation; NaN outside."""
        i = BODIES.index(body)
        known = np.isfinite(self.turn_rad[:, i])
        at = np.asarray(time_s, dtype=float)
        if known.sum() < 2:
            return np.full(at.shape, np.nan)
        curve = CubicHermiteSpline(
            self.time_s[known], self.turn_rad[known, i], self.speed_rad_per_s[known, i], extrapolate=False
        )
        return np.asarray(curve(at), dtype=float)


def _turn(angle_rad: Array, rest_rad: Array) -> Array:
    return np.asfortranarray(angle_rad - rest_rad)


def predict_trial(m: MeasuredTrial, tested: ModelUnderTest, variant: str = "model") -> PredictedAngles:
    """Predict the angles of one trial at its samples, by the ``variant`` ``model``, ``raw_force`` (the model under the
    uncorrected force) or ``null``; the model's prediction is read from the store, or computed and kept there.

    Conventions: angles on the DAQ's sample times (and, by the same cubic, on film times); changes since the model's own
    rest under the declared preload, rad; NaN where the force is not known yet, that is for the last group delay of the
    record.

    Parameters
    ----------
    tested : its store keeps predictions of the model, and all of a stand-in, as derived steps ``prediction_<action>``;
        other rivals are computed in the time in which they would be read
    variant : {"model", "raw_force", "null"}, which force drives, and whether the null model takes the place of the
        model
    """
    if m.driven_by_key:
        return _predict_by_key(m, tested, variant)
    load = tested.load(m.force.preload_n)
    rest = np.asarray(load.rest.angle_rad, dtype=float)[: len(BODIES)]
    force_s, force_n = (m.time_s, m.raw_force_n) if variant == "raw_force" else (m.force.time_s, m.force.force_n)
    inputs = (tested.action_hash, float(tested.tolerance), variant, force_s, force_n, m.time_s, rest)
    key = result_key("predictions", tested.version, inputs)
    is_kept = variant == "model" or (variant == "raw_force" and tested.stand_ins.predict is not None)
    step = f"{STEP if variant == 'model' else f'{STEP}_{variant}'}_{tested.action_hash[:12]}"
    stored = _load_prediction(tested, m, step, key, rest) if is_kept else None
    if stored is not None:
        tested.store.count("predictions", reused=True)
        return stored
    inside = (m.time_s >= force_s[0]) & (m.time_s <= force_s[-1])
    simulate = model.null_model.simulate if variant == "null" else tested.simulate
    # a stand-in for the model need not know how to estimate its error
    estimate = {"estimate_error": True} if variant == "model" and tested.stand_ins.predict is None else {}
    began_s = thread_time()
    solution = simulate(
        tested.action,
        force_s,
        force_n,
        tolerance=tested.tolerance,
        output_time_s=m.time_s[inside],
        initial=load.rest,
        **estimate,
    )
    took_s = thread_time() - began_s
    angle, speed = np.full((2, m.time_s.size, len(BODIES)), np.nan)
    got = np.asarray(solution.angle_rad, dtype=float)[:, : len(BODIES)]  # a scene's own coordinates follow
    if got.shape != (int(inside.sum()), len(BODIES)):
        raise PredictionError(
            f"trial {m.number}: prediction has shape {got.shape}, expected {(int(inside.sum()), len(BODIES))}"
        )
    angle[inside], speed[inside] = got, np.asarray(solution.speed_rad_per_s, dtype=float)[:, : len(BODIES)]
    counters = {name: float(value) for name, value in dict(getattr(solution, "counters", {})).items()}
    counters["seconds"] = took_s
    turn = _turn(angle, rest)
    if not is_kept:
        return PredictedAngles(m.time_s, turn, speed, rest, key, False, counters)
    columns = {"time_s": m.time_s} | dict(zip([*COLUMNS[0], *COLUMNS[1]], [*angle.T, *speed.T], strict=True))
    error = getattr(solution, "error_rad", None)
    error_rad = float("nan") if error is None else float(error)
    attributes: dict[str, Any] = {"input_sha256": key, "counters": counters}
    if error is not None:
        attributes["error_rad"] = error_rad
    check_load = ""
    if variant == "model" and tested.stand_ins.predict is None:
        found = model.touch.find_check_load(
            tested.action, force_s, force_n, solution, tolerance=tested.tolerance, initial=load.rest
        )
        check_load = attributes["check_load"] = "" if found is None else str(found)
    failure = tested.store.write_table(step, m.number, m.seal, pd.DataFrame(columns), attributes)
    tested.store.count("predictions", reused=False, failure=failure)
    return PredictedAngles(m.time_s, turn, speed, rest, key, False, counters, error_rad, check_load)


def _predict_by_key(m: MeasuredTrial, tested: ModelUnderTest, variant: str) -> PredictedAngles:
    """Predict the angles of a trial from its measured key motion, by the ``variant`` ``model`` (read from the store, or
    computed and kept there) or ``null`` (neither); refuses any other, and stand-ins."""
    if variant not in KEY_DRIVEN or not tested.stand_ins.are_absent:
        raise PredictionError("is not driven by the key")
    rest = np.asarray(tested.load(m.force.preload_n).rest.angle_rad, dtype=float)[: len(BODIES)]
    sensors = None if m.sensors is None else (m.sensors.calibration, m.sensors.hammer_travel_m)
    inputs = (tested.action_hash, float(tested.tolerance), variant, m.time_s, m.change_rad, m.resolution_rad, sensors)
    key = result_key("predictions by key", tested.version, (*inputs, rest))
    step = f"{STEP}_by_key_{tested.action_hash[:12]}"
    stored = _load_prediction(tested, m, step, key, rest) if variant == "model" else None
    if stored is not None:
        tested.store.count("predictions", reused=True)
        return stored
    began_s = thread_time()
    counters: dict[str, float] = {}
    if variant == "null":
        turn = run_null_key_driven(tested.action, m)
        speed = np.full(turn.shape, np.nan)
    else:
        turn, speed, counters = run_key_driven(tested.action, m, rest, tested.tolerance)
    counters["seconds"] = thread_time() - began_s
    turn = np.asfortranarray(turn)
    if variant == "null":
        return PredictedAngles(m.time_s, turn, speed, rest, key, False, counters)
    columns = {"time_s": m.time_s} | dict(zip([*COLUMNS[0], *COLUMNS[1]], [*(turn + rest).T, *speed.T], strict=True))
    attributes = {"input_sha256": key, "counters": counters}
    failure = tested.store.write_table(step, m.number, m.seal, pd.DataFrame(columns), attributes)
    tested.store.count("predictions", reused=False, failure=failure)
    return PredictedAngles(m.time_s, turn, speed, rest, key, False, counters)


def _load_prediction(
    tested: ModelUnderTest, m: MeasuredTrial, step: str, key: str, rest: Array
) -> PredictedAngles | None:
    """Prediction of a trial from table ``step`` of the store, with the rest angles ``rest`` (5,), rad; None where it is
    missing, incomplete, or not of the inputs whose hash is ``key``."""
    found = tested.store.table(step, m.number, key)
    if found is None:
        return None
    table, attributes = found
    if not all(name in table for group in COLUMNS for name in group) or len(table) != m.time_s.size:
        return None
    angle, speed = (table[group].to_numpy(dtype=float) for group in COLUMNS)
    error_rad = float(attributes.get("error_rad", float("nan")))
    counters = attributes.get("counters", {})
    return PredictedAngles(
        m.time_s, _turn(angle, rest), speed, rest, key, True, counters, error_rad, str(attributes.get("check_load", ""))
    )


@dataclass(frozen=True)
class RivalCurves:
    """Changes since rest predicted by a rival, by channel: on the DAQ's sample times, and on the film's, rad."""

    encoder: Mapping[str, NDArray[np.float32]]
    film: Mapping[str, Array]


@dataclass(frozen=True)
class PredictedTrial:
    """What is predicted for one trial: by the model, and by its rivals."""

    model: PredictedAngles
    rivals: dict[str, RivalCurves]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class PredictedSession:
    """Trials that were measured and predicted, and by number the reason for each that was not."""

    trials: tuple[MeasuredTrial, ...]
    predictions: dict[int, PredictedTrial]
    refused: dict[int, str]


def predict_session(
    measured: MeasuredSession, tested: ModelUnderTest, progress: Callable[[str], None] | None = None
) -> PredictedSession:
    """Predict every measured trial by the model and its rivals; stored predictions are read, not simulated. Trials that
    the model cannot predict are refused with the reason; input error where none is left. ``progress`` gets a line a
    trial."""
    refused, predictions = dict(measured.refused), {}
    # a user's function need not bear threads, nor be called in another order
    with ThreadPoolExecutor(WORKERS if tested.own_model else 1) as pool:
        first = [
            _predict_with_rivals(m, tested) for m in measured.trials[:1]
        ]  # alone: what all trials share is made once
        every = chain(first, pool.map(lambda m: _predict_with_rivals(m, tested), measured.trials[1:]))
        for m, found in zip(measured.trials, every, strict=True):
            if progress is not None:
                progress(f"predicted trial {m.number}")
            if isinstance(found, ModelError):
                refused[m.number] = f"{NOT_PREDICTED} {found}"
                continue
            predictions[m.number] = found
            missed = _describe_missed_tolerance(found.model, tested.tolerance)
            if missed and progress is not None:
                progress(f"trial {m.number}: {missed}")
    if not predictions:
        raise ValidationInputError(
            f"{measured.session.path}: no usable trial ({_describe_refused(refused)}); record or accept at least one"
        )
    return PredictedSession(tuple(m for m in measured.trials if m.number in predictions), predictions, refused)


def _predict_with_rivals(m: MeasuredTrial, tested: ModelUnderTest) -> PredictedTrial | ModelError:
    """Prediction of a trial by the model and its rivals, with notes on rivals that cannot; the error where the model
    cannot."""
    try:
        found = predict_trial(m, tested)
    except ModelError as error:
        return error
    missed = _describe_missed_tolerance(found, tested.tolerance)
    notes, rivals = [text for text in (missed, found.check_load) if text], {}
    for name in (name for name in tested.rivals if name in (KEY_DRIVEN if m.driven_by_key else VARIANTS)):
        try:
            rivals[name] = _select_rival_curves(predict_trial(m, tested, name), m)
        except (ModelError, PredictionError) as error:
            notes.append(f"{name.replace('_', ' ')} not predicted: {error}")
    return PredictedTrial(found if m.film is not None else found.without_speeds(), rivals, tuple(notes))


def _select_rival_curves(found: PredictedAngles, m: MeasuredTrial) -> RivalCurves:
    """Changes of angle since rest, rad, that a rival predicts: by encoder at the trial's samples, by filmed body at the
    frames' times, none without a film.

    In single precision, a thousandth of an encoder's count.
    """
    encoder = {name: found.change_rad(name).astype(np.float32) for name in ENCODER_CHANNELS}
    film = {} if m.film is None else {name: found.change_at(name, m.film.time_s) for name in FILM_CHANNELS}
    return RivalCurves(encoder, film)


def _describe_missed_tolerance(found: PredictedAngles, tolerance: float) -> str:
    """Warning where the estimated numerical error exceeds the tolerance by far; empty where it does not."""
    if not found.error_rad > MISSED * tolerance:
        return ""
    return (
        f"the requested error of the simulation is missed: angles off by about {found.error_rad:.1e} rad, "
        f"{found.error_rad / tolerance:.0f} x the requested {tolerance:g}; small errors grow under this force, "
        "tighten `tolerance`"
    )


def _describe_refused(refused: dict[int, str]) -> str:
    """Why trials are not used, by number in ``refused``, in one line however many they are."""
    numbers: dict[str, list[int]] = {}
    for number, reason in refused.items():
        numbers.setdefault(reason, []).append(number)
    lines = (f"{trials_in_words(found, MOST_NAMED)}: {reason}" for reason, found in numbers.items())
    return "; ".join(lines) or "it has no trials"
