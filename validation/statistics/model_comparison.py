"""Two models on the same trials: is one closer than the other, and how much may so few trials say?

Conventions: paired by trial, difference = second − first; only trials that both models have are used. What cannot be
stated is NaN and ``claim`` says why.
Source: Student's t for the mean of n paired differences (ISO 2854), widened by what errors of force gain, preload and
delay and of the sensors, common to all trials, may make of the difference (draws, the same for both models). p: exact
sign flips of all channels of a trial together, the largest standardised sum over channels (Westfall and Young 1993), so
that correlated or proportional channels cost no evidence; its smallest value is 2^(1−n): five trials cannot reach 5 %.
A claim over the whole window and one before the impact that name different models are shown as a contradiction.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from validation.conventions import LEVEL, Array
from validation.result import ValidationResult
from validation.scores.curve_scores import SCORES
from validation.scores.perfect_model import PAIRED_SCORES
from validation.statistics.sign_flip_test import joint_sign_flip, sign_flip_p

COVERAGE = 2.1  # Student's t of 18 draws
CLAIMED = " closer (5 %, all channels together)"
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
    "u_nuisance",
    "low",
    "high",
    "first_closer",
    "second_closer",
    "p",
    "p_least",
    "p_joint",
    "claim",
]


def compare_pairs(results: Sequence[ValidationResult]) -> pd.DataFrame:
    """Every pair of models of each session: mean paired difference of the trials' scores, and what it allows to say."""
    rows: list[dict[str, object]] = []
    for first, second in combinations(results, 2):
        if first.session_name == second.session_name:
            rows += _compare_pair(first, second)
    return pd.DataFrame(rows, columns=COLUMNS)


def _compare_pair(first: ValidationResult, second: ValidationResult) -> list[dict[str, object]]:
    """Rows, with the columns `COLUMNS`, of a paired comparison of two models on the trials that both have, one for each
    score and channel; differences are second − first."""
    keys = ["trial", "channel"]
    both = first.scores.merge(second.scores, on=keys, suffixes=("_1", "_2"))
    moved = first.nuisance.merge(second.nuisance, on=[*keys, "draw"], suffixes=("_1", "_2"))
    tolerance = sum(float(r.provenance.get("tolerance_rad", 0.0)) for r in (first, second))
    unequal = _describe_unequal(first, second, both)
    out: list[dict[str, object]] = []
    for score in PAIRED_SCORES:
        kind = SCORES[score]
        rows = []
        apart = both.assign(d=both[f"{score}_2"] - both[f"{score}_1"])
        p = adjusted_p(apart.pivot(index="trial", columns="channel", values="d"))
        for channel, part in both.groupby("channel", sort=False):
            pairs = part[[f"{score}_1", f"{score}_2"]].dropna().to_numpy(dtype=float)
            if not len(pairs):
                continue
            drawn = moved[moved["channel"] == channel]
            nuisance = _estimate_common_u(drawn, apart[apart["channel"] == channel], score)
            rows.append(
                {
                    "session": first.session_name,
                    "channel": channel,
                    "score": score,
                    "unit": kind.unit,
                    "better": kind.better,
                    "first": first.action_name,
                    "second": second.action_name,
                    **_summarise_differences(pairs[:, 0], pairs[:, 1], kind.better, nuisance),
                    "p_joint": p[str(channel)],
                }
            )
        for row in rows:
            row["claim"] = unequal or _describe_claim(row, tolerance if kind.unit == "rad" else 0.0)
        out += rows
    _show_contradictions(out)
    return out


def _estimate_common_u(drawn: pd.DataFrame, apart: pd.DataFrame, score: str) -> float:
    """Standard uncertainty of the mean difference of a ``score`` of one channel from what is common to the trials:
    ``drawn`` has a row a draw and trial with both models' scores, ``apart`` the difference ``d`` a trial. NaN where
    nothing was drawn."""
    if not len(drawn):
        return float("nan")
    base = apart.set_index("trial")["d"]
    change = drawn[f"{score}_2"] - drawn[f"{score}_1"] - drawn["trial"].map(base)
    by_draw = change.astype(float).groupby(drawn["draw"]).mean().dropna()
    return float(np.sqrt(np.mean(by_draw**2))) if len(by_draw) else float("nan")


def _summarise_differences(first: Array, second: Array, better: str, u_nuisance: float) -> dict[str, object]:
    """Cells by column for the differences second − first of a score (n,) each, paired by trial: mean, 95 % interval, u,
    p; ``better``: ``lower`` or ``higher``, ``u_nuisance``: u common to the trials, NaN where not drawn."""
    d = second - first
    n = d.size
    mean = float(d.mean())
    u = float(d.std(ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    reach = float(stdtrit(n - 1, 1.0 - LEVEL / 2.0)) * u if n > 1 else float("nan")
    reach = float(np.hypot(reach, COVERAGE * np.nan_to_num(u_nuisance)))
    closer = -d if better == "lower" else d
    return {
        "n_trials": n,
        "first_mean": float(first.mean()),
        "second_mean": float(second.mean()),
        "difference": mean,
        "u_difference": float(np.hypot(u, np.nan_to_num(u_nuisance))),
        "u_nuisance": u_nuisance,
        "low": mean - reach,
        "high": mean + reach,
        "first_closer": int((closer < 0).sum()),
        "second_closer": int((closer > 0).sum()),
        "p": sign_flip_p(d),
        "p_least": 2.0 ** (1 - n),
    }


def adjusted_p(differences: pd.DataFrame) -> dict[str, float]:
    """p of the sign-flip test of zero mean by channel, adjusted for all channels together; ``differences`` has a row a
    trial and a column a channel, NaN where a trial lacks it; channels known in other trials are tested apart.

    A channel known in fewer trials (a film) is tested for itself, with the p of all others added to its own at worst
    (Bonferroni over the groups of channels that share their trials).
    """
    known = differences.notna()
    groups: dict[tuple[bool, ...], list[str]] = {}
    for channel in differences.columns:
        if known[channel].any():
            groups.setdefault(tuple(known[channel]), []).append(str(channel))
    out: dict[str, float] = {}
    testable = {mask: names for mask, names in groups.items() if sum(mask) > 1}
    for mask, names in groups.items():
        values = differences.loc[list(mask), names].to_numpy(dtype=float)
        p = joint_sign_flip(values)
        times = len(testable) if mask in testable else 1
        out |= {name: min(1.0, times * float(v)) for name, v in zip(names, p, strict=True)}
    return out


EVIDENCE_COLUMNS = [
    "session",
    "model",
    "against",
    "log_evidence",
    "u_log_evidence",
    "log_bayes_factor",
    "u_log_bayes_factor",
    "p",
    "reading",
    "right_hand_sides",
    "seconds",
    "cost_ratio",
]
GRADES = ((1.0, "not worth more than a bare mention"), (3.0, "positive"), (5.0, "strong"), (np.inf, "very strong"))
"""Upper end of ln of the Bayes factor, and word. Source: Kass and Raftery 1995, JASA 90, 773, Section 3.2."""


def evidence_table(sessions: Sequence[Sequence[ValidationResult]]) -> pd.DataFrame:
    """Table with the columns `EVIDENCE_COLUMNS`: for each model of a session its evidence and Bayes factor against the
    session's first model, and the cost of a prediction; ``sessions``: results of each, one a model. Sessions of one
    model have no row.

    Conventions: evidence as `validation.verdict.evidence.log_evidence`; the Bayes factor is graded by its
    end nearest to 1 at two standard uncertainties, those of the two evidences taken as independent. NaN, and
    ``reading`` says why, where a model was not judged or the two were judged on other data. Right-hand sides of a blow
    and seconds of processor time, with the run that estimates its error; ``cost_ratio`` is that of the former.

    Parameters
    ----------
    sessions : results of each session, one for each model

    Returns
    -------
    DataFrame
        `EVIDENCE_COLUMNS`; no rows for a session with one model.
    """
    rows = [_make_evidence_row(results[0], r) for results in sessions if len(results) > 1 for r in results]
    return pd.DataFrame(rows, columns=EVIDENCE_COLUMNS)


def _make_evidence_row(first: ValidationResult, other: ValidationResult) -> dict[str, object]:
    """Row by column of the natural logarithm of the Bayes factor of ``other`` against ``first``, positive for
    ``other``, with the cost of both and a reading in words, which says why where the factor is NaN."""
    a, b = first.judgement, other.judgement
    nan = float("nan")
    row: dict[str, object] = {"session": other.session_name, "model": other.action_name, "against": first.action_name}
    row |= {name: b.get(name, nan) for name in ("log_evidence", "u_log_evidence", "p")}
    costs = [r.provenance.get("cost", {}) for r in (first, other)]
    row |= {name: costs[1].get(name, nan) for name in ("right_hand_sides", "seconds")}
    row["cost_ratio"] = costs[1].get("right_hand_sides", nan) / costs[0].get("right_hand_sides", nan)
    row |= {"log_bayes_factor": nan, "u_log_bayes_factor": nan}
    keys = ["trial", "channel"]
    unequal = _describe_unequal(first, other, first.scores.merge(other.scores, on=keys, suffixes=("_1", "_2")))
    if not (a["judged"] and b["judged"]):
        return row | {"reading": f"no claim: {a.get('reason') or b.get('reason')}"}
    if unequal or a["trials"] != b["trials"]:
        return row | {"reading": unequal or "no claim: judged on different trials"}
    if first is other:
        return row | {"log_bayes_factor": 0.0, "u_log_bayes_factor": 0.0, "reading": "the one compared with"}
    factor = b["log_evidence"] - a["log_evidence"]
    u = float(np.hypot(a["u_log_evidence"], b["u_log_evidence"]))
    sure = max(abs(factor) - 2.0 * u, 0.0)
    grade = next(word for most, word in GRADES if sure < most)
    reading = grade if sure < GRADES[0][0] else f"{grade} {'for' if factor > 0 else 'against'} it"
    if a["rejected"] and b["rejected"]:
        reading += "; both are rejected, so this only says which is less far off"
    return row | {"log_bayes_factor": factor, "u_log_bayes_factor": u, "reading": reading}


def _describe_unequal(first: ValidationResult, second: ValidationResult, both: pd.DataFrame) -> str:
    """Reason why the scores of two results may not be compared (other window, other samples left out); empty where they
    may. ``both``: their scores merged by trial and channel, suffixes ``_1`` and ``_2``."""
    a, b = first.window, second.window
    step = min(float(np.median(np.diff(t["time_s"]))) for t in first.traces.values())
    if max(abs(a.start_s - b.start_s), abs(a.end_s - b.end_s)) > 1.5 * step:
        return (
            f"no claim: scored in different windows ({a.start_s:.4f} to {a.end_s:.4f} s, "
            f"{b.start_s:.4f} to {b.end_s:.4f} s)"
        )
    return "no claim: different samples are left out" if (both["n_1"] - both["n_2"]).abs().max() > 2 else ""


def _describe_claim(row: dict[str, object], tolerance: float) -> str:
    """Text on which model of a compared row (columns `COLUMNS`) is closer, or why none is claimed; differences within
    ``tolerance``, in the score's unit, are no claim."""
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
    if not np.isfinite(float(row["u_nuisance"])):  # type: ignore[arg-type]
        return f"{better} closer on average; what errors of force and sensors make of it was not drawn (no budget)"
    if float(row["p_joint"]) > LEVEL:  # type: ignore[arg-type]
        return f"{better} closer on average; not shown at 5 % for all channels together"
    return f"{better}{CLAIMED}"


def _show_contradictions(rows: list[dict[str, object]]) -> None:
    """Replace the claim of rows, in place, where the whole window and the time before the impact claim different
    models."""
    claimed: dict[object, dict[object, str]] = {}
    for row in rows:
        if str(row["claim"]).endswith(CLAIMED):
            claimed.setdefault(row["channel"], {})[row["score"]] = str(row["claim"]).removesuffix(CLAIMED)
    for row in rows:
        found = claimed.get(row["channel"], {})
        whole, early = found.get("rmse_rad"), found.get("before_impact_rmse_rad")
        if whole and early and whole != early and row["score"] in ("rmse_rad", "before_impact_rmse_rad"):
            row["claim"] = (
                f"contradiction: over the whole window {whole} is closer, before the impact {early} (5 % each); "
                "neither model is closer as such"
            )
