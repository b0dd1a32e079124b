"""Mixed strokes: the forces of a session fall into two kinds, compared within each.

Conventions: force held for 20 ms and impulse of each stroke, on a logarithmic scale. Two kinds are named when the
widest gap between neighbours is more than 25 % and four times the spread within either kind, with two trials or more
in each; a single odd trial is left to `validation.findings.outlier_trials`. Not detectable with fewer than four
trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.findings.between_trials.stroke_strength import impulse_n_s, sustained_force_n
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

APART = 1.25
ALSO = 1.05
OVER_SPREAD = 4.0
FEWEST = 2


@dataclass(frozen=True)
class TwoKinds:
    """Numbers of the weaker and of the stronger trials, and by what they are told apart: medians, unit."""

    weak: tuple[int, ...]
    strong: tuple[int, ...]
    words: str
    unit: str
    low: float
    high: float


def two_kinds(trials: Sequence[MeasuredTrial]) -> TwoKinds | None:
    """The two kinds of stroke of a session; None where there is one."""
    if len(trials) < 2 * FEWEST:
        return None
    numbers = [m.number for m in trials]
    impulse = np.array([impulse_n_s(m) for m in trials])
    held = np.array([sustained_force_n(m) for m in trials])
    for words, unit, values, other in (
        ("force held for 20 ms", "N", held, impulse),
        ("impulse", "N s", impulse, held),
    ):
        split = _split(values)
        if split is None:
            continue
        weak = values < split
        # the action has a part in the one quantity or the other, a stroke of another kind in both
        if abs(np.log(np.median(other[weak]) / np.median(other[~weak]))) < np.log(ALSO):
            continue
        low, high = float(np.median(values[weak])), float(np.median(values[~weak]))
        lower, upper = (tuple(numbers[i] for i in np.flatnonzero(part)) for part in (weak, ~weak))
        return TwoKinds(lower, upper, words, unit, low, high)
    return None


def mixed_strokes(trials: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """What is said of two kinds of stroke, if there are two."""
    kinds = two_kinds(trials)
    if kinds is None:
        return []
    weak, strong = (", ".join(map(str, part)) for part in (kinds.weak, kinds.strong))
    text = (
        f"two kinds of stroke: {kinds.words} {kinds.low:.3g} {kinds.unit} in trials {weak} and {kinds.high:.3g} "
        f"{kinds.unit} in trials {strong}; repeatability and odd trials are those within each kind, and there is no "
        "band of their mean; for all else validate them apart (conditions of the trial plan, or pianorig annotate)"
    )
    return [SessionFinding("mixed strokes", float("nan"), "force", kinds.high / kinds.low, APART, text)]


def _split(values: Array) -> float | None:
    """The value in the widest gap, when it parts two kinds."""
    if not np.all(values > 0):
        return None
    at = np.sort(np.log(values))
    gaps = np.diff(at)[FEWEST - 1 : at.size - FEWEST]
    i = int(gaps.argmax()) + FEWEST - 1
    within = max(float(at[i] - at[0]), float(at[-1] - at[i + 1]))
    gap = float(at[i + 1] - at[i])
    return float(np.exp((at[i] + at[i + 1]) / 2)) if gap > max(np.log(APART), OVER_SPREAD * within) else None
