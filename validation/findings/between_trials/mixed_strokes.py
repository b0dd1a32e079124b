"""Mixed strokes: the forces of a session fall into two kinds, which have no common repeatability.

Conventions: largest force and impulse of each stroke, on a logarithmic scale. Two kinds are named when the widest gap
between neighbours is more than 25 % and four times the spread within either kind, with two trials or more in each; a
single odd trial is left to `validation.findings.outlier_trials`. Not detectable with fewer than four trials.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from validation.conventions import Array
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

APART = 1.25
OVER_SPREAD = 4.0
FEWEST = 2


def mixed_strokes(trials: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """The two kinds of stroke of a session, if there are two."""
    if len(trials) < 2 * FEWEST:
        return []
    numbers = [m.number for m in trials]
    for words, unit, values in (
        ("largest force", "N", np.array([float(m.force.force_n.max()) for m in trials])),
        ("impulse", "N s", np.array([_impulse(m) for m in trials])),
    ):
        split = _split(values)
        if split is None:
            continue
        weak, strong = ([numbers[i] for i in np.flatnonzero(values < split)] for values in (values, -values))
        strong = [n for n in numbers if n not in weak]
        ratio = float(np.median(values[values >= split]) / np.median(values[values < split]))
        text = (
            f"two kinds of stroke: {words} {np.median(values[values < split]):.3g} {unit} in trials "
            f"{', '.join(map(str, weak))} and {np.median(values[values >= split]):.3g} {unit} in trials "
            f"{', '.join(map(str, strong))}; they have no common repeatability, validate them apart (conditions of "
            f"the trial "
            "plan, or pianorig annotate)"
        )
        return [SessionFinding("mixed strokes", float("nan"), "force", ratio, APART, text)]
    return []


def _impulse(m: MeasuredTrial) -> float:
    step = np.gradient(m.force.time_s)
    return float(np.sum(step * np.maximum(m.force.force_n - m.force.preload_n, 0.0)))


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
