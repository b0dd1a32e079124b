"""All scores of one curve against another, by name: one function for model, null model and trial against trial.

Conventions: SI and rad; difference = second − first; nothing is aligned. Samples that are left out (NaN in either) are
cut out of both curves; the ISO-style score then sees what is left as one curve. A score that cannot be stated is NaN.
Source: plain definitions; Sprague and Geers (2003) for magnitude, phase and combined error;
`validation.scores.iso18571`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array, rms
from validation.scores.iso18571 import FEWEST_SAMPLES, iso_score

MOST_PAIRS = 200  # of trials: choice, their mean score is known to a fourteenth of its scatter
PAIR_SEED = 20260101


def score_curve(time_s: Array, trial: Array, model: Array) -> dict[str, float]:
    """RMSE, bias, scatter and largest difference, rad, its time, RMSE over the trial's range and numbers of samples, by
    name, of ``model`` − ``trial`` (n,), rad, at times (n,), s; samples that are NaN in either do not count; NaN where
    none is left.

    Parameters
    ----------
    time_s, trial, model : (n,), the evaluation window only, rad; NaN where lost

    Returns
    -------
    dict
        ``rmse_rad``, ``bias_rad``, ``scatter_rad`` (standard deviation of the difference about its bias, divisor n, so
        that rmse² = bias² + scatter²), ``largest_rad`` (magnitude) ``largest_at_s``, ``rmse_over_range`` (of the
        trial within the window), ``n`` and ``n_lost`` samples. No common sample gives NaN scores and n = 0.
    """
    both = np.isfinite(trial) & np.isfinite(model)
    n = int(both.sum())
    lost = {"n": n, "n_lost": int(both.size) - n}
    if n == 0:
        names = ("rmse_rad", "bias_rad", "scatter_rad", "largest_rad", "largest_at_s", "rmse_over_range")
        return dict.fromkeys(names, float("nan")) | lost
    difference = model[both] - trial[both]
    worst = int(np.argmax(np.abs(difference)))
    rmse, extent = float(np.sqrt(np.mean(difference**2))), float(np.ptp(trial[both]))
    return {
        "rmse_rad": rmse,
        "bias_rad": float(difference.mean()),
        "scatter_rad": float(difference.std()),
        "largest_rad": float(np.abs(difference[worst])),
        "largest_at_s": float(time_s[both][worst]),
        "rmse_over_range": rmse / extent if extent > 0 else float("nan"),
        **lost,
    }


def choose_trial_pairs(n: int, seed: int = PAIR_SEED, kinds: Sequence[int] | None = None) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of the indices of ``n`` trials, both of one kind of stroke (``kinds``: number of each
    trial's kind; all alike if None): all of them, or 200 drawn with ``seed``, in order."""
    pairs = [(i, j) for i, j in combinations(range(n), 2) if kinds is None or kinds[i] == kinds[j]]
    if len(pairs) <= MOST_PAIRS:
        return pairs
    chosen = np.random.default_rng(seed).choice(len(pairs), MOST_PAIRS, replace=False)
    return [pairs[i] for i in sorted(chosen)]


def compute_pair_rmse(curves: Array, *, kinds: Sequence[int] | None = None) -> tuple[float, int]:
    """Root mean square difference between two trials, over all pairs of one kind or 200 of them, and the number of
    pairs; ``curves``: (n_samples, n_trials), NaN where lost, ``kinds``: number of each trial's kind. NaN and 0 without
    a pair."""
    pairs = np.array(choose_trial_pairs(curves.shape[1], kinds=kinds), dtype=int).reshape(-1, 2)
    difference = curves[:, pairs[:, 0]] - curves[:, pairs[:, 1]]
    if not np.isfinite(difference).any():
        return float("nan"), 0
    return float(np.sqrt(np.nanmean(difference**2))), len(pairs)


def sprague_geers(measured: Array, computed: Array) -> tuple[float, float, float]:
    """Sprague–Geers errors of magnitude (signed) and phase, and both combined, dimensionless, of a ``computed`` curve
    against a ``measured`` one, (n,) each, at even times; NaN where either is zero throughout.

    M = √(I_cc/I_mm) − 1, P = acos(I_mc/√(I_mm I_cc))/π, C = √(M² + P²).
    """
    m, c = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    mm, cc, mc = float(m @ m), float(c @ c), float(m @ c)
    if mm == 0 or cc == 0:
        return float("nan"), float("nan"), float("nan")
    magnitude = float(np.sqrt(cc / mm) - 1)
    # rounding can push the cosine past one for equal curves
    phase = float(np.arccos(np.clip(mc / np.sqrt(mm * cc), -1.0, 1.0)) / np.pi)
    return magnitude, phase, float(np.hypot(magnitude, phase))


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


def compute_scores(
    time: Array, trial: Array, model: Array, early: NDArray[np.bool_] | None = None, *, iso: bool = True
) -> dict[str, float]:
    """Every score of `SCORES` and ``iso_shift_s`` by name, of a curve ``model`` against ``trial``, (n,) rad, NaN where
    lost; ``early`` (n,): mask of the samples before the impact. NaN where it cannot be stated, the ISO-style ones also
    without ``iso``.

    Parameters
    ----------
    time, trial, model : (n,), NaN where lost or marked
    early : (n,) array of bool, optional, samples before the string impact
    iso : the ISO-style score costs some milliseconds; without it its scores are NaN
    """
    nan = float("nan")
    out = dict.fromkeys(SCORES, nan) | {"iso_shift_s": nan}
    whole = score_curve(time, trial, model)
    out |= {name: whole[name] for name in ("rmse_rad", "rmse_over_range")}
    if early is not None:
        out["before_impact_rmse_rad"] = score_curve(time[early], trial[early], model[early])["rmse_rad"]
    both = np.isfinite(trial) & np.isfinite(model)
    if not both.any():
        return out
    t, m = trial[both], model[both]
    out["sg_magnitude"], out["sg_phase"], out["sg_combined"] = sprague_geers(t, m)
    if iso and t.size >= FEWEST_SAMPLES and both.mean() >= 1 - MOST_CUT_FOR_ISO:
        step_s = float(np.median(np.diff(time)))
        s = iso_score(t, m, step_s)
        out |= {
            "iso_overall": s.overall,
            "iso_corridor": s.corridor,
            "iso_phase": s.phase,
            "iso_magnitude": s.magnitude,
            "iso_slope": s.slope,
            "iso_shift_s": s.shift_samples * step_s,
        }
    return out


def pool_score(name: str, values: Array) -> float:
    """One number for a score of several trials or pairs: the root mean square of one in rad, else the mean
    magnitude."""
    if SCORES[name].unit == "rad":
        return rms(values)
    known = values[np.isfinite(values)]
    return float(np.mean(np.abs(known))) if known.size else float("nan")
