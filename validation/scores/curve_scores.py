"""All scores of one curve against another, by name: one function for model, null model and trial against trial.

Conventions: SI and rad; difference = second − first; nothing is aligned. Samples that are left out (NaN in either) are
cut out of both curves; the ISO-style score then sees what is left as one curve. A score that cannot be stated is NaN.
Source: `validation.scores.metrics` and `validation.scores.iso18571`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.scores.iso18571 import FEWEST_SAMPLES, iso_score
from validation.scores.metrics import score_curve, sprague_geers

# film frames are lost one by one; a curve with more holes than this is not one curve any more
MOST_CUT_FOR_ISO = 0.1


@dataclass(frozen=True)
class ScoreKind:
    """Title of a score, its unit, and whether a small or a large value is good."""

    title: str
    unit: str
    better: str


SCORES: dict[str, ScoreKind] = {
    "rmse_rad": ScoreKind("RMSE", "rad", "lower"),
    "before_impact_rmse_rad": ScoreKind("RMSE before impact", "rad", "lower"),
    "rmse_over_range": ScoreKind("RMSE / range", "1", "lower"),
    "iso_overall": ScoreKind("ISO 18571-style overall", "1", "higher"),
    "iso_corridor": ScoreKind("ISO 18571-style corridor", "1", "higher"),
    "iso_phase": ScoreKind("ISO 18571-style phase", "1", "higher"),
    "iso_magnitude": ScoreKind("ISO 18571-style magnitude", "1", "higher"),
    "iso_slope": ScoreKind("ISO 18571-style slope", "1", "higher"),
    "sg_magnitude": ScoreKind("Sprague–Geers magnitude", "1", "lower"),
    "sg_phase": ScoreKind("Sprague–Geers phase", "1", "lower"),
    "sg_combined": ScoreKind("Sprague–Geers combined", "1", "lower"),
}


def all_scores(
    time: Array, trial: Array, model: Array, early: NDArray[np.bool_] | None = None, *, iso: bool = True
) -> dict[str, float]:
    """Every score of `SCORES`, and ``iso_shift_s``.

    Parameters
    ----------
    time, trial, model : (n,) arrays
        NaN where lost or marked.
    early : (n,) array of bool, optional
        Samples before the string impact.
    iso : bool
        The ISO-style score costs some milliseconds; without it its scores are NaN.
    """
    nan = float("nan")
    out = dict.fromkeys(SCORES, nan) | {"iso_shift_s": nan}
    whole = score_curve(time, trial, model)
    out["rmse_rad"], out["rmse_over_range"] = whole.rmse, whole.rmse_over_range
    if early is not None:
        out["before_impact_rmse_rad"] = score_curve(time[early], trial[early], model[early]).rmse
    both = np.isfinite(trial) & np.isfinite(model)
    if not both.any():
        return out
    t, m = trial[both], model[both]
    sg = sprague_geers(t, m)
    out |= {"sg_magnitude": sg.magnitude, "sg_phase": sg.phase, "sg_combined": sg.combined}
    if iso and both.mean() >= 1 - MOST_CUT_FOR_ISO:
        out |= _iso(t, m, float(np.median(np.diff(time))))
    return out


def _iso(trial: Array, model: Array, step_s: float) -> dict[str, float]:
    if trial.size < FEWEST_SAMPLES:
        return {}
    s = iso_score(trial, model, step_s)
    return {
        "iso_overall": s.overall,
        "iso_corridor": s.corridor,
        "iso_phase": s.phase,
        "iso_magnitude": s.magnitude,
        "iso_slope": s.slope,
        "iso_shift_s": s.shift_samples * step_s,
    }


def pooled_score(name: str, values: Array) -> float:
    """One number for the scores of several trials or pairs."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return float("nan")
    if SCORES[name].unit == "rad":
        return float(np.sqrt(np.mean(known**2)))
    return float(np.mean(np.abs(known)))
