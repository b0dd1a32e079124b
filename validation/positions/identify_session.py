"""An identified set of a session: fits, left-out fits for the bands, and what explains the release."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

import model
from rig.session import Session
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.positions.band import Calibration, PredictedStroke, calibrate, spread
from validation.positions.identify import Fit, Predict, fit, misfit, of_model, of_null
from validation.positions.measured import Stroke, measure_positions
from validation.positions.parameters import FREE, NAMES, SENSORS
from validation.positions.phases import RELEASE, phases
from validation.positions.record import Identified, sensors_of

START = {"stop_felt": -2.5, "hammer_shape": 1.0, "key_shape": 0.5, "check": -0.2, "spring": -0.5}
"""Where a fit begins, in standard deviations of the priors: a soft stop and a weak spring, as the curves suggest."""
DRAWS, SEED, SPREAD = 40, 5, 0.6
"""A second fit begins at the best of so many seeded draws from the priors, narrowed by the last, and nominal."""
GROUPS = {
    "repetition spring": ("spring", "spring_torque", "lever_friction", "repetition_pad", "drop"),
    "hammer's mass": ("hammer_mass",),
    "back check": ("check", "check_friction"),
    "friction and damping": ("hammer_friction", "knuckle_friction", "rest_damping", "knuckle_damping"),
    "jack, let-off, stop": ("let_off", "jack_pad", "capstan", "string", "stop_felt", "stop_damping"),
    "sensors": tuple(one.name for one in SENSORS),
}


def identify_session(
    session: Session, trials: Sequence[int], action_name: str, say: Callable[[str], None] = lambda text: None
) -> Identified:
    """Identify a set on some strokes of a session.

    Parameters
    ----------
    session : Session
    trials : sequence of int
        Strokes to fit; at least two, so that bands can be calibrated on what was left out.
    action_name : str
        Built-in action or file whose parameters are changed.
    say : callable
        Told of the progress.

    Raises
    ------
    ValidationInputError
        A trial is not usable, or there are fewer than two.
    """
    measured = measure_positions(session)
    by_number = {stroke.number: stroke for stroke in measured.strokes}
    if missing := [n for n in trials if n not in by_number]:
        reason = measured.refused.get(missing[0], "there is no such trial")
        raise ValidationInputError(f"{session.path}: trial {missing[0]} cannot be identified on: {reason}")
    if len(set(trials)) < 2:
        raise ValidationInputError(f"{session.path}: {len(set(trials))} trial to identify on, allowed from 2")
    strokes = [by_number[n] for n in trials]
    action = model.load_action(action_name)
    full, null = of_model(action), of_null(action)
    say("identified set: all strokes")
    best = _search(strokes, full, len(FREE), say)
    null_best = _search(strokes, null, len(SENSORS), say)
    left_z: dict[str, dict[str, list[float]]] = {"null": {}, "identified": {}}
    for stroke in strokes:
        say(f"without trial {stroke.number}")
        others = [one for one in strokes if one is not stroke]
        left_z["null"][str(stroke.number)] = _search(others, null, len(SENSORS), say).z.tolist()
        left_z["identified"][str(stroke.number)] = _search(others, full, len(FREE), say).z.tolist()
    return Identified(
        action=action_name,
        session=session.info.name or session.path.name,
        seals={str(n): session.trial(n).sha256 for n in trials},
        sensors=sensors_of(strokes[0]),
        names=NAMES,
        z=best.z.tolist(),
        covariance=best.covariance.tolist(),
        null_names=NAMES[: len(SENSORS)],
        null_z=null_best.z.tolist(),
        null_covariance=null_best.covariance.tolist(),
        misfit={"before": _cost(np.zeros(len(FREE)), strokes, full), "after": best.cost, "null": null_best.cost},
        bands=bands_of(strokes, action, left_z),
        left_out=left_z,
        release=explain_release(strokes, full, best.z),
    )


def bands_of(
    strokes: Sequence[Stroke], action: model.Action, left_out: dict[str, dict[str, list[float]]]
) -> dict[str, Calibration]:
    """Choose and calibrate the band of each model on strokes predicted by parameters that have not seen them."""
    full, null, nominal = of_model(action), of_null(action), [0.0] * len(FREE)
    found = {}
    for name, predict in (("regulated", full), ("null", null), ("identified", full)):
        left = []
        for stroke in strokes:
            z = np.array(left_out.get(name, {}).get(str(stroke.number), nominal))
            prediction = predict(z, stroke, None)
            left.append(PredictedStroke(stroke, prediction, spread(stroke, predict, z, prediction)))
        found[name] = calibrate(left)
    return found


def _cost(z: Array, strokes: Sequence[Stroke], predict: Predict) -> float:
    r = misfit(z, strokes, predict)
    return 0.5 * float(r @ r)


def _search(strokes: Sequence[Stroke], predict: Predict, size: int, say: Callable[[str], None]) -> Fit:
    """The better of two fits: the misfit has many valleys."""
    random = np.random.default_rng(SEED)
    first = np.array([START.get(name, 0.0) for name in NAMES])[:size]
    draws = [np.zeros(size), *(SPREAD * random.standard_normal(size) for _ in range(DRAWS))]
    second = min(draws, key=lambda z: _cost(z, strokes, predict))
    fits = [fit(strokes, predict, start, say=say) for start in (first, second)]
    return min(fits, key=lambda one: one.cost)


def explain_release(strokes: Sequence[Stroke], predict: Predict, z: Array) -> dict[str, dict[str, float]]:
    """RMS of the hammer in the release (rulers) with each group left nominal, and with it alone identified.

    Sensors stay as identified when another group stands alone: they are no part of the action.
    """

    def rms(values: Array) -> float:
        squares = []
        for stroke in strokes:
            try:
                error = (predict(values, stroke, None) - stroke.hammer.value_m) / stroke.hammer.travel_m
            except model.ModelError:
                return float("nan")
            squares.append(np.mean(error[phases(stroke) == RELEASE] ** 2))
        return float(np.sqrt(np.mean(squares)))

    out = {"nothing": {"nominal": rms(z), "alone": rms(np.where(_of("sensors"), z, 0.0))}}
    for group in GROUPS:
        chosen = _of(group)
        out[group] = {
            "nominal": rms(np.where(chosen, 0.0, z)),
            "alone": rms(np.where(chosen | _of("sensors"), z, 0.0)),
        }
    return out


def _of(group: str) -> NDArray[np.bool_]:
    return np.array([name in GROUPS[group] for name in NAMES])
