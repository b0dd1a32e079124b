"""Mixed strokes: the forces of a session fall into two kinds, which have no common repeatability.

Conventions: force held for 20 ms and impulse of each stroke, on a logarithmic scale. Two kinds are named when the
widest gap between neighbours is more than 25 % and four times the spread within either kind, with two trials or more
in each; a single odd trial is left to `validation.findings.outlier_trials`. Not detectable with fewer than four
trials.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from validation.conventions import Array
from validation.findings.between_trials.stroke_strength import impulse_n_s, sustained_force_n
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

APART = 1.25
ALSO = 1.05
OVER_SPREAD = 4.0
FEWEST = 2


def mixed_strokes(trials: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """The two kinds of stroke of a session, if there are two."""
    if len(trials) < 2 * FEWEST:
        return []
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
        named = [", ".join(str(numbers[i]) for i in np.flatnonzero(part)) for part in (weak, ~weak)]
        text = (
            f"two kinds of stroke: {words} {low:.3g} {unit} in trials {named[0]} and {high:.3g} {unit} in trials "
            f"{named[1]}; they have no common repeatability, validate them apart (conditions of the trial plan, or "
            "pianorig annotate)"
        )
        return [SessionFinding("mixed strokes", float("nan"), "force", high / low, APART, text)]
    return []


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
