"""Two models on the same trials: is one closer than the other, and how much may so few trials say?

Conventions: paired by trial, difference = second − first; only trials that both models have are used. What cannot be
stated is NaN and ``claim`` says why.
Source: Student's t for the mean of n paired differences (ISO 2854); exact two-sided sign-flip test (Fisher), whose
smallest p is 2^(1−n): with five trials 0.0625, so that no five trials can reach 5 %; Holm's correction over the rows of
one pair of models and one score.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from validation.conventions import Array
from validation.result import ValidationResult
from validation.scores.curve_scores import SCORES

LEVEL = 0.05
PAIRED_SCORES = ("rmse_rad", "before_impact_rmse_rad", "iso_overall")
EXACT_UP_TO = 14  # trials; beyond that signs are drawn
DRAWS = 20_000
SEED = 20260102
COLUMNS = [
    "session",
    "channel",
    "score",
    "unit",
    "better",
    "first",
    "second",
    "n_trials",
    "first_mean",
    "second_mean",
    "difference",
    "u_difference",
    "low",
    "high",
    "first_closer",
    "second_closer",
    "p",
    "p_least",
    "p_holm",
    "claim",
]


def paired_models(results: Sequence[ValidationResult]) -> pd.DataFrame:
    """Every pair of models of each session: mean paired difference of the trials' scores, and what it allows to say."""
    rows: list[dict[str, object]] = []
    for first, second in combinations(results, 2):
        if first.session_name == second.session_name:
            rows += _pair(first, second)
    return pd.DataFrame(rows, columns=COLUMNS)


def _pair(first: ValidationResult, second: ValidationResult) -> list[dict[str, object]]:
    keys = ["trial", "channel"]
    both = first.scores.merge(second.scores, on=keys, suffixes=("_1", "_2"))
    tolerance = sum(float(r.provenance.get("tolerance_rad", 0.0)) for r in (first, second))
    unequal = _unequal(first, second, both)
    out: list[dict[str, object]] = []
    for score in PAIRED_SCORES:
        kind = SCORES[score]
        rows = []
        for channel, part in both.groupby("channel", sort=False):
            pairs = part[[f"{score}_1", f"{score}_2"]].dropna().to_numpy(dtype=float)
            if not len(pairs):
                continue
            rows.append(
                {
                    "session": first.session_name,
                    "channel": channel,
                    "score": score,
                    "unit": kind.unit,
                    "better": kind.better,
                    "first": first.action_name,
                    "second": second.action_name,
                    **_statistics(pairs[:, 0], pairs[:, 1], kind.better),
                }
            )
        # one trial is no test, and takes no part in the correction
        tested = [r for r in rows if int(r["n_trials"]) > 1]  # type: ignore[call-overload]
        for row, p in zip(tested, holm([float(r["p"]) for r in tested]), strict=True):  # type: ignore[arg-type]
            row["p_holm"] = p
        for row in rows:
            row.setdefault("p_holm", 1.0)
            row["claim"] = unequal or _claim(row, tolerance if kind.unit == "rad" else 0.0)
        out += rows
    return out


def _statistics(first: Array, second: Array, better: str) -> dict[str, object]:
    d = second - first
    n = d.size
    mean = float(d.mean())
    u = float(d.std(ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    reach = float(stdtrit(n - 1, 0.975)) * u if n > 1 else float("nan")
    closer = -d if better == "lower" else d
    return {
        "n_trials": n,
        "first_mean": float(first.mean()),
        "second_mean": float(second.mean()),
        "difference": mean,
        "u_difference": u,
        "low": mean - reach,
        "high": mean + reach,
        "first_closer": int((closer < 0).sum()),
        "second_closer": int((closer > 0).sum()),
        "p": sign_flip_p(d),
        "p_least": 2.0 ** (1 - n),
    }


def sign_flip_p(differences: Array) -> float:
    """Two-sided p of the mean under random signs of the differences; exact up to `EXACT_UP_TO`, then drawn.

    1 when there is one difference or all are zero.
    """
    d = np.asarray(differences, dtype=float)
    n = d.size
    size = float(np.abs(d).sum())
    if n < 2 or size == 0:
        return 1.0
    if n <= EXACT_UP_TO:
        # the first sign is kept: a sum and its negative are equally far from zero
        bits = np.arange(2 ** (n - 1))[:, None] >> np.arange(n - 1) & 1
        signs = np.column_stack([np.ones(len(bits)), 1 - 2 * bits])
        extra = 0
    else:
        signs = np.random.default_rng(SEED).choice((-1.0, 1.0), size=(DRAWS, n))
        extra = 1  # the arrangement found counts as one of the draws
    # sums that are equal but for rounding count as equal
    as_far = int((np.abs(signs @ d) >= abs(d.sum()) - 1e-12 * size).sum())
    return (as_far + extra) / (len(signs) + extra)


def holm(p: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values, in the order given."""
    order = np.argsort(p, kind="stable")
    out = np.empty(len(p))
    largest = 0.0
    for rank, i in enumerate(order):
        largest = max(largest, min(1.0, (len(p) - rank) * p[i]))
        out[i] = largest
    return [float(v) for v in out]


def _unequal(first: ValidationResult, second: ValidationResult, both: pd.DataFrame) -> str:
    """Why the scores of two results may not be set against each other, or an empty text."""
    a, b = first.window, second.window
    step = min(float(np.median(np.diff(t["time_s"]))) for t in first.traces.values())
    if max(abs(a.start_s - b.start_s), abs(a.end_s - b.end_s)) > 1.5 * step:
        return (
            f"no claim: scored in different windows ({a.start_s:.4f} to {a.end_s:.4f} s, "
            f"{b.start_s:.4f} to {b.end_s:.4f} s)"
        )
    return "no claim: different samples are left out" if (both["n_1"] - both["n_2"]).abs().max() > 2 else ""


def _claim(row: dict[str, object], tolerance: float) -> str:
    n, difference = int(row["n_trials"]), float(row["difference"])  # type: ignore[call-overload,arg-type]
    if difference == 0:
        return "no difference"
    if abs(difference) <= tolerance:
        return "no claim: within the tolerance of the predictions"
    if n < 2:
        return "no claim: one trial"
    low, high = float(row["low"]), float(row["high"])  # type: ignore[arg-type]
    better = row["second"] if (difference < 0) == (row["better"] == "lower") else row["first"]
    if low <= 0 <= high:
        return "no claim: the 95 % interval holds zero"
    if float(row["p_least"]) > LEVEL:  # type: ignore[arg-type]
        return f"{better} closer on average; {n} trials cannot show it at 5 % (smallest p {row['p_least']:.4g})"
    if float(row["p_holm"]) > LEVEL:  # type: ignore[arg-type]
        return f"{better} closer on average; not shown at 5 % for all channels together"
    return f"{better} closer (5 %, all channels together)"
