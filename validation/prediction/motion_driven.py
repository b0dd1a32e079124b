"""The other way round: the measured motion of the key drives the model, and the force at the key front is predicted.

Conventions: N, positive downwards; differences are predicted − measured on the DAQ's sample times, measured force
corrected and taken at the time it acted. Left out: samples where the model's rail would have to pull the key down,
and lifts of the key, with 5 ms on either side, because there the encoder's angle is no rotation.
Source: under a prescribed force the heavy key hides what the rest of the action does; only a prescribed motion tests
the action (Thorin, Boutillon and Lozada 2014).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import model
from validation.conventions import WORKERS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

MEMBERS = 8  # of the ensemble that carries the uncertainty of the angle: u is then known to a quarter
AROUND_S = 5e-3  # of a peak: choice, within which trial and prediction may have it
COLUMNS = [
    "trial",
    "peak_measured_n",
    "peak_predicted_n",
    "rmse_n",
    "rmse_over_peak",
    "bias_n",
    "u_rms_n",
    "within_95_share",
    "left_out_share",
    "n",
]


def motion_driven(tested: ModelUnderTest, m: MeasuredTrial, at: Array, lifted: NDArray[np.bool_]) -> pd.DataFrame:
    """Force at the key front, N, down positive, measured and predicted from the key's motion, at the times ``at`` (n,),
    s, a row each, with u and whether it is left out: near ``lifted`` (n,) samples and the model's lifts. The store
    keeps the prediction.

    Parameters
    ----------
    at : (n,), sample times of the evaluation window, s
    lifted : (n,), samples at which the key lifts

    Returns
    -------
    DataFrame
        time_s, force_n (measured), u_force_n, predicted_force_n, u_predicted_n, factor (of 95 %), left_out.
    """
    rest = tested.load(m.force.preload_n).rest.angle_rad
    # a quantised encoder's own jitter is in the change's uncertainty beyond a count's
    resolution = float(m.resolution_rad[0])

    def drive() -> dict[str, object]:
        with ThreadPoolExecutor(WORKERS) as pool:
            driven = model.simulate_motion(
                tested.action,
                m.time_s,
                m.change_rad[:, 0] + rest[0],
                tolerance=tested.tolerance,
                output_time_s=at,
                resolution_rad=resolution,
                members=MEMBERS,
                share=pool.map,
            )
        return {
            "force_n": driven.force_n.tolist(),
            "u_force_n": driven.u_force_n.tolist(),
            "lifted": driven.lifted.tolist(),
            "coverage_factor": driven.coverage_factor,
        }

    driven = tested.store.value(
        "force from motion", (tested.identity, MEMBERS, m.time_s, m.change_rad[:, 0], rest, at, resolution), drive
    )
    step = float(np.median(np.diff(m.time_s)))
    out = _widen_mask(np.asarray(driven["lifted"], dtype=bool) | lifted, round(AROUND_S / step))
    return pd.DataFrame(
        {
            "time_s": at,
            "force_n": np.interp(at, m.force.time_s, m.force.force_n, left=np.nan, right=np.nan),
            "u_force_n": np.interp(at, m.force.time_s, m.force.u_force_n),
            "predicted_force_n": driven["force_n"],
            "u_predicted_n": driven["u_force_n"],
            "factor": driven["coverage_factor"],
            "left_out": out,
        }
    )


def _widen_mask(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    if not mask.any():
        return mask
    near = np.convolve(mask.astype(np.int64), np.ones(2 * reach + 1, dtype=np.int64), mode="same")
    return np.asarray(near > 0)


def motion_row(trial: int, frame: pd.DataFrame, gain_relative_u: float) -> dict[str, Any]:
    """Row of table *motion_driven* (`COLUMNS`) of one trial: scores of predicted less measured force, N, in ``frame``,
    of `motion_driven`; only number and shares where no sample is left. ``gain_relative_u``: of the force, common to all
    samples."""
    use = ~frame["left_out"].to_numpy(dtype=bool)
    measured, predicted = frame["force_n"].to_numpy(), frame["predicted_force_n"].to_numpy()
    use &= np.isfinite(measured) & np.isfinite(predicted)
    if not use.any():
        return {"trial": trial, "left_out_share": 1.0, "n": 0}
    e = (predicted - measured)[use]
    u_force = np.hypot(frame["u_force_n"].to_numpy(), gain_relative_u * measured)
    reach: Array = np.hypot(2.0 * u_force, frame["factor"].to_numpy() * frame["u_predicted_n"].to_numpy())[use]
    rmse, peak = float(np.sqrt(np.mean(e**2))), float(measured[use].max())
    return {
        "trial": trial,
        "peak_measured_n": peak,
        "peak_predicted_n": float(predicted[use].max()),
        "rmse_n": rmse,
        "rmse_over_peak": rmse / peak if peak > 0 else float("nan"),
        "bias_n": float(e.mean()),
        "u_rms_n": float(np.sqrt(np.mean((reach / 2) ** 2))),
        "within_95_share": float(np.mean(np.abs(e) <= reach)),
        "left_out_share": float(1 - use.mean()),
        "n": int(use.sum()),
    }
