"""Prediction of one trial: its own force drives the model from rest; unchanged inputs are not simulated again.

Conventions: angles on the DAQ's sample times (and, by the same cubic, on film times); changes since the model's own
rest under the declared preload, rad; NaN where the force is not known yet, that is for the last group delay of the
record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicHermiteSpline

import model
from validation.cache.content_hash import result_key
from validation.conventions import BODIES, Array
from validation.errors import PredictionError
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

STEP = "prediction"
# what drives and what predicts, and how the derived step of each begins
VARIANTS = {"model": STEP, "raw_force": f"{STEP}_raw_force", "null": f"{STEP}_null"}
COLUMNS = [f"{body}_rad" for body in BODIES], [f"{body}_rad_per_s" for body in BODIES]


@dataclass(frozen=True)
class PredictedAngles:
    """Predicted angles of one trial.

    ``turn_rad`` are the changes since rest, in columns that traces share: a session has hundreds. ``reused`` says that
    no simulation was needed, ``error_rad`` how large their largest numerical error is (estimated; NaN where it was not:
    for rivals and stand-ins).
    """

    time_s: Array
    turn_rad: Array
    speed_rad_per_s: Array
    rest_angle_rad: Array
    input_sha256: str
    reused: bool
    counters: Mapping[str, float]
    error_rad: float = float("nan")

    @property
    def angle_rad(self) -> Array:
        """Absolute angles, (n, 5) rad."""
        return self.turn_rad + self.rest_angle_rad

    def change_rad(self, body: str) -> Array:
        """Change of one body's angle since rest on the DAQ's sample times, (n,) rad."""
        return self.turn_rad[:, BODIES.index(body)]

    def without_speeds(self) -> PredictedAngles:
        """The same for a trial without film, which is not read between the samples."""
        return replace(self, speed_rad_per_s=np.empty((0, len(BODIES))))

    def change_at(self, body: str, time_s: Array) -> Array:
        """The same at other times, by the cubic through angles and speeds; NaN outside the prediction."""
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
    """Predict one trial, or read its prediction when nothing it depends on has changed.

    Parameters
    ----------
    m : MeasuredTrial
    tested : ModelUnderTest
        Its store keeps predictions as the derived step ``prediction_<action>``.
    variant : {"model", "raw_force", "null"}
        Which force drives, and whether the null model takes the place of the model.

    Raises
    ------
    PredictionError
        The result has the wrong shape.
    """
    load = tested.load(m.force.preload_n)
    rest = np.asarray(load.rest.angle_rad, dtype=float)[: len(BODIES)]
    force_s, force_n = (m.time_s, m.raw_force_n) if variant == "raw_force" else (m.force.time_s, m.force.force_n)
    inputs = (tested.action_hash, float(tested.tolerance), variant, force_s, force_n, m.time_s, rest)
    key = result_key("predictions", tested.version, inputs)
    step = f"{VARIANTS[variant]}_{tested.action_hash[:12]}"
    stored = _stored(tested, m, step, key, rest)
    if stored is not None:
        tested.store.count("predictions", reused=True)
        return stored
    inside = (m.time_s >= force_s[0]) & (m.time_s <= force_s[-1])
    simulate = model.null_model.simulate if variant == "null" else tested.simulate
    # a stand-in for the model need not know how to estimate its error
    estimate = {"estimate_error": True} if variant == "model" and tested.stand_ins.predict is None else {}
    solution = simulate(
        tested.action,
        force_s,
        force_n,
        tolerance=tested.tolerance,
        output_time_s=m.time_s[inside],
        initial=load.rest,
        **estimate,
    )
    angle, speed = np.full((m.time_s.size, 5), np.nan), np.full((m.time_s.size, 5), np.nan)
    got = np.asarray(solution.angle_rad, dtype=float)[:, : len(BODIES)]  # a scene's own coordinates follow
    if got.shape != (int(inside.sum()), 5):
        raise PredictionError(f"trial {m.number}: prediction has shape {got.shape}, expected {(int(inside.sum()), 5)}")
    angle[inside], speed[inside] = got, np.asarray(solution.speed_rad_per_s, dtype=float)[:, : len(BODIES)]
    counters = {name: float(value) for name, value in dict(getattr(solution, "counters", {})).items()}
    columns = {"time_s": m.time_s} | dict(zip([*COLUMNS[0], *COLUMNS[1]], [*angle.T, *speed.T], strict=True))
    error = getattr(solution, "error_rad", None)
    error_rad = float("nan") if error is None else float(error)
    attributes: dict[str, Any] = {"input_sha256": key, "counters": counters}
    if error is not None:
        attributes["error_rad"] = error_rad
    failure = tested.store.write_table(step, m.number, m.seal, pd.DataFrame(columns), attributes, versioned=True)
    tested.store.count("predictions", reused=False, failure=failure)
    return PredictedAngles(m.time_s, _turn(angle, rest), speed, rest, key, False, counters, error_rad)


def _stored(tested: ModelUnderTest, m: MeasuredTrial, step: str, key: str, rest: Array) -> PredictedAngles | None:
    found = tested.store.table(step, m.number, key)
    if found is None:
        return None
    table, attributes = found
    if not all(name in table for group in COLUMNS for name in group) or len(table) != m.time_s.size:
        return None
    angle, speed = (table[group].to_numpy(dtype=float) for group in COLUMNS)
    error_rad = float(attributes.get("error_rad", float("nan")))
    counters = attributes.get("counters", {})
    return PredictedAngles(m.time_s, _turn(angle, rest), speed, rest, key, True, counters, error_rad)
