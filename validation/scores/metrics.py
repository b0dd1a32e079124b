"""Differences of two curves in numbers: RMSE, bias, scatter, range, magnitude and phase; pairs of trials.

Conventions: difference = model − trial; samples lost in either are left out and counted; nothing is aligned
or scaled first. No common sample gives NaN scores and n = 0.
Source: plain definitions; Sprague and Geers (2003) for magnitude, phase and combined error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from validation.conventions import Array

MOST_PAIRS = 200
PAIR_SEED = 20260101


@dataclass(frozen=True)
class CurveScore:
    """Scores of one curve, in the unit of the curve unless said otherwise."""

    rmse: float
    bias: float
    scatter: float
    largest: float
    largest_at_s: float
    rmse_over_range: float
    n: int
    n_lost: int


def score_curve(time_s: Array, trial: Array, model: Array) -> CurveScore:
    """Score a prediction against a measurement on the same time base.

    Parameters
    ----------
    time_s, trial, model : (n,) arrays
        The evaluation window only; NaN where lost.

    Returns
    -------
    CurveScore
        ``scatter`` is the standard deviation of the difference about its bias (divisor n), so that rmse² =
        bias² + scatter²;
        ``rmse_over_range`` divides by the range of the trial within the window.
    """
    both = np.isfinite(trial) & np.isfinite(model)
    n = int(both.sum())
    nan = float("nan")
    if n == 0:
        return CurveScore(nan, nan, nan, nan, nan, nan, 0, int(both.size))
    difference = model[both] - trial[both]
    worst = int(np.argmax(np.abs(difference)))
    rmse = float(np.sqrt(np.mean(difference**2)))
    extent = float(np.ptp(trial[both]))
    return CurveScore(
        rmse=rmse,
        bias=float(difference.mean()),
        scatter=float(difference.std()),
        largest=float(np.abs(difference[worst])),
        largest_at_s=float(time_s[both][worst]),
        rmse_over_range=rmse / extent if extent > 0 else nan,
        n=n,
        n_lost=int(both.size) - n,
    )


def trial_pairs(
    n: int, most: int = MOST_PAIRS, seed: int = PAIR_SEED, kinds: Sequence[int] | None = None
) -> list[tuple[int, int]]:
    """Pairs of n trials of one kind of stroke, all of them or a seeded sample of `most`."""
    pairs = [(i, j) for i, j in combinations(range(n), 2) if kinds is None or kinds[i] == kinds[j]]
    if len(pairs) <= most:
        return pairs
    chosen = np.random.default_rng(seed).choice(len(pairs), most, replace=False)
    return [pairs[i] for i in sorted(chosen)]


def pair_rmse(
    curves: Array, *, most_pairs: int = MOST_PAIRS, seed: int = PAIR_SEED, kinds: Sequence[int] | None = None
) -> tuple[float, int]:
    """Repeatability ceiling of the RMSE: root mean square difference of one trial against another.

    Parameters
    ----------
    curves : (n_samples, n_trials) array
    most_pairs : int
        With more pairs than this a seeded sample of them is used.
    kinds : sequence of int, optional
        Number of the kind of stroke of each trial; trials of different kinds are no pair.

    Returns
    -------
    rmse : float
        NaN with fewer than two trials.
    pairs : int
        Number of pairs used.
    """
    pairs = np.array(trial_pairs(curves.shape[1], most_pairs, seed, kinds), dtype=int).reshape(-1, 2)
    difference = curves[:, pairs[:, 0]] - curves[:, pairs[:, 1]]
    if not np.isfinite(difference).any():
        return float("nan"), 0
    return float(np.sqrt(np.nanmean(difference**2))), len(pairs)


@dataclass(frozen=True)
class MagnitudePhase:
    """Magnitude, phase and combined error of a computed against a measured curve (dimensionless)."""

    magnitude: float
    phase: float
    combined: float


def sprague_geers(measured: Array, computed: Array) -> MagnitudePhase:
    """Sprague–Geers errors on a uniform time base: M = √(I_cc/I_mm) − 1, P = acos(I_mc/√(I_mm I_cc))/π, C = √(M² + P²).

    NaN when either curve is zero throughout.
    """
    m, c = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    mm, cc, mc = float(m @ m), float(c @ c), float(m @ c)
    if mm == 0 or cc == 0:
        return MagnitudePhase(float("nan"), float("nan"), float("nan"))
    magnitude = float(np.sqrt(cc / mm) - 1)
    # rounding can push the cosine past one for equal curves
    phase = float(np.arccos(np.clip(mc / np.sqrt(mm * cc), -1.0, 1.0)) / np.pi)
    return MagnitudePhase(magnitude, phase, float(np.hypot(magnitude, phase)))
