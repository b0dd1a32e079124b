"""Predictions of all trials of a session: the second stage of a comparison.

A trial the model cannot predict is refused with the reason; a rival that cannot be predicted is left out with a note.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from model.simulation.solution import MISSED
from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.errors import PredictionError, ValidationInputError
from validation.measurement.session import MeasuredSession
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.trial_prediction import PredictedAngles, predict_trial

MOST_NAMED = 4
"""Trials named of those that share a reason."""


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
    """Predict every measured trial; unchanged ones are read, not simulated.

    Raises
    ------
    ValidationInputError
        No trial is left.
    """
    refused = dict(measured.refused)
    predictions = {}
    for m in measured.trials:
        if progress is not None:
            progress(f"predicting trial {m.number}")
        try:
            predictions[m.number] = _predict(m, tested)
            missed = _missed(predictions[m.number].model, tested.tolerance)
            if missed and progress is not None:
                progress(f"trial {m.number}: {missed}")
        except ModelError as error:
            refused[m.number] = f"not predicted: {error}"
    if not predictions:
        raise ValidationInputError(
            f"{measured.session.path}: no usable trial ({_reasons(refused)}); record or accept at least one"
        )
    return PredictedSession(tuple(m for m in measured.trials if m.number in predictions), predictions, refused)


def _predict(m: MeasuredTrial, tested: ModelUnderTest) -> PredictedTrial:
    found = predict_trial(m, tested)
    missed = _missed(found, tested.tolerance)
    notes, rivals = [missed] if missed else [], {}
    for name in tested.rivals:
        try:
            rivals[name] = _curves_of(predict_trial(m, tested, name), m)
        except (ModelError, PredictionError) as error:
            notes.append(f"{name.replace('_', ' ')} not predicted: {error}")
    return PredictedTrial(found if m.film is not None else found.without_speeds(), rivals, tuple(notes))


def _curves_of(found: PredictedAngles, m: MeasuredTrial) -> RivalCurves:
    """What is compared of a rival; the rest, two thirds of it, would be kept for every trial.

    In single precision, a thousandth of an encoder's count.
    """
    encoder = {name: found.change_rad(name).astype(np.float32) for name in ENCODER_CHANNELS}
    film = {} if m.film is None else {name: found.change_at(name, m.film.time_s) for name in FILM_CHANNELS}
    return RivalCurves(encoder, film)


def _missed(found: PredictedAngles, tolerance: float) -> str:
    """What to say where the numerical error is far above the requested one; empty where it is not."""
    if not found.error_rad > MISSED * tolerance:
        return ""
    return (
        f"the requested error of the simulation is missed: angles off by about {found.error_rad:.1e} rad, "
        f"{found.error_rad / tolerance:.0f} x the requested {tolerance:g}; small errors grow under this force, "
        "tighten --tolerance"
    )


def _reasons(refused: dict[int, str]) -> str:
    """Why trials are not used, in one line however many they are."""
    numbers: dict[str, list[int]] = {}
    for number, reason in refused.items():
        numbers.setdefault(reason, []).append(number)
    lines = []
    for reason, found in numbers.items():
        named = ", ".join(map(str, found[:MOST_NAMED]))
        more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
        lines.append(f"trial{'s' if found[1:] else ''} {named}{more}: {reason}")
    return "; ".join(lines) or "it has no trials"
