"""Prediction of one trial: its own corrected force drives the model from rest; unchanged inputs are not
simulated again.

Place in the data flow: `validation.measurement.trial` → model → angles on the DAQ's sample times (and, by the same
cubic, on film times).  Conventions: changes since the model's own rest under the declared preload, rad; NaN
where the force is not known yet, that is for the last group delay of the record.
Failure: a result of the wrong shape is a `PredictionError`; a cache that cannot be read or written only costs
time.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from validation.errors import PredictionError
from validation.measurement.geometry import Array
from validation.measurement.trial import Measurement

BODIES = ("key", "whippen", "jack", "repetition", "hammer")
STEP = "prediction"
MOST_ACTIONS = 4  # whose predictions a session keeps, so that models side by side do not drive each other out
# what drives and what predicts, and how the derived step of each begins
VARIANTS = {"model": STEP, "raw_force": f"{STEP}_raw_force", "null": f"{STEP}_null"}


@dataclass(frozen=True)
class Prediction:
    """Predicted angles of one trial; ``reused`` says that no simulation was needed."""

    time_s: Array
    angle_rad: Array
    speed_rad_per_s: Array
    rest_angle_rad: Array
    input_sha256: str
    reused: bool
    counters: Mapping[str, float]

    def change_rad(self, body: str) -> Array:
        """Change of one body's angle since rest on the DAQ's sample times, (n,) rad."""
        i = BODIES.index(body)
        return self.angle_rad[:, i] - self.rest_angle_rad[i]

    def change_at(self, body: str, time_s: Array) -> Array:
        """The same at other times, by the cubic through angles and speeds; NaN outside the prediction."""
        from scipy.interpolate import CubicHermiteSpline

        i = BODIES.index(body)
        known = np.isfinite(self.angle_rad[:, i])
        at = np.asarray(time_s, dtype=float)
        if known.sum() < 2:
            return np.full(at.shape, np.nan)
        curve = CubicHermiteSpline(
            self.time_s[known], self.angle_rad[known, i], self.speed_rad_per_s[known, i], extrapolate=False
        )
        return np.asarray(curve(at) - self.rest_angle_rad[i], dtype=float)


def action_sha256(action: Any) -> str:
    """Hash of all parameter values and of which bodies and shapes they belong to."""
    structure = "\n".join(f"{path}={text}" for path, text in sorted(action.structure.items()))
    return hashlib.sha256(f"{action.content()}\n{structure}".encode()).hexdigest()


def driving_force(measurement: Measurement, variant: str) -> tuple[Array, Array]:
    """Times and values of the force that drives a variant: corrected, or as it was recorded."""
    if variant == "raw_force":
        return measurement.time_s, measurement.raw_force_n
    return measurement.force.time_s, measurement.force.force_n


def input_sha256(
    measurement: Measurement,
    action_hash: str,
    tolerance: float,
    model_version: str,
    rest: Array,
    variant: str = "model",
) -> str:
    """Hash of everything a prediction depends on."""
    digest = hashlib.sha256()
    for text in (action_hash, repr(float(tolerance)), model_version, variant):
        digest.update(text.encode() + b"\0")
    for array in (*driving_force(measurement, variant), measurement.time_s, rest):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes() + b"\0")
    return digest.hexdigest()


def predict_trial(
    measurement: Measurement,
    action: Any,
    rest: Any,
    predict: Callable[..., Any],
    *,
    tolerance: float,
    action_hash: str,
    model_version: str,
    session: Any = None,
    variant: str = "model",
) -> tuple[Prediction, str]:
    """Predict one trial, or read its prediction when nothing it depends on has changed.

    Parameters
    ----------
    measurement : Measurement
    action : model action
    rest : object with ``angle_rad`` (5,)
        Rest state under the preload of this trial.
    predict : callable
        ``model.simulate`` or a stand-in with the same call.
    tolerance : float
        Requested largest error of any angle, rad.
    action_hash, model_version : str
        Part of the cache key.
    session : rig.session.Session, optional
        Where predictions are kept (``derived/prediction_<action>``…); None keeps none.
    variant : {"model", "raw_force", "null"}
        Which force drives, and under which name the prediction is kept; ``predict`` must be the null model's for the
        last.

    Returns
    -------
    prediction : Prediction
    failure : str
        Why the prediction could not be kept, or empty.
    """
    rest_angle = np.asarray(rest.angle_rad, dtype=float)
    key = input_sha256(measurement, action_hash, tolerance, model_version, rest_angle, variant)
    step = f"{VARIANTS[variant]}_{action_hash[:12]}"
    kept = _read(session, measurement, key, rest_angle, step)
    if kept is not None:
        return kept, ""
    time = measurement.time_s
    force_time, force = driving_force(measurement, variant)
    inside = (time >= force_time[0]) & (time <= force_time[-1])
    solution = predict(action, force_time, force, tolerance=tolerance, output_time_s=time[inside], initial=rest)
    angle, speed = np.full((time.size, 5), np.nan), np.full((time.size, 5), np.nan)
    got = np.asarray(solution.angle_rad, dtype=float)
    if got.shape != (int(inside.sum()), 5):
        raise PredictionError(
            f"trial {measurement.number}: prediction has shape {got.shape}, expected {(int(inside.sum()), 5)}"
        )
    angle[inside] = got
    speed[inside] = np.asarray(solution.speed_rad_per_s, dtype=float)
    counters = {name: float(value) for name, value in dict(getattr(solution, "counters", {})).items()}
    prediction = Prediction(time, angle, speed, rest_angle, key, False, counters)
    return prediction, _write(session, measurement, prediction, step)


def _read(session: Any, measurement: Measurement, key: str, rest: Array, step: str) -> Prediction | None:
    if session is None:
        return None
    from rig.errors import InputError as RigInputError

    try:
        found = session.read_derived(step, measurement.number)
    except RigInputError:  # damaged: made again
        return None
    if found is None or found[1].get("input_sha256") != key:
        return None
    table, attrs = found
    columns = [f"{body}_rad" for body in BODIES], [f"{body}_rad_per_s" for body in BODIES]
    if not all(name in table.columns for group in columns for name in group) or len(table) != measurement.time_s.size:
        return None
    angle, speed = (table[group].to_numpy(dtype=float) for group in columns)
    return Prediction(measurement.time_s, angle, speed, rest, key, True, attrs.get("counters", {}))


def _write(session: Any, measurement: Measurement, prediction: Prediction, step: str) -> str:
    if session is None:
        return ""
    from rig.errors import InputError as RigInputError

    columns = {"time_s": prediction.time_s}
    columns |= {f"{body}_rad": prediction.angle_rad[:, i] for i, body in enumerate(BODIES)}
    columns |= {f"{body}_rad_per_s": prediction.speed_rad_per_s[:, i] for i, body in enumerate(BODIES)}
    attrs = {"input_sha256": prediction.input_sha256, "counters": dict(prediction.counters)}
    parents = {f"trial_{measurement.number:04d}.h5": measurement.seal}
    path = session.derived_path(step, measurement.number)
    begun = path.parent.is_dir()
    try:
        session.write_derived(step, measurement.number, pd.DataFrame(columns), attrs, parents)
        if not begun:
            _forget(path.parent)
    except (RigInputError, OSError) as error:
        return str(error)
    return ""


def _forget(new: Path) -> None:
    """Remove the predictions of the actions looked at longest ago, of the same variant as a new one."""
    variant = new.name.rpartition("_")[0]
    same = [folder for folder in new.parent.iterdir() if folder.name.rpartition("_")[0] == variant and folder != new]
    for folder in sorted(same, key=lambda folder: folder.stat().st_mtime, reverse=True)[MOST_ACTIONS - 1 :]:
        shutil.rmtree(folder, ignore_errors=True)
