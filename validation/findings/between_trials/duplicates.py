"""Copies of a trial: two trials whose encoders gave the same counts at every sample. No two strokes do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

FEWEST_MOVED = 50  # samples that differ from the one before: two records of rest may well agree


def duplicates(trials: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """Trials that repeat an earlier one, in counts or in force."""
    out = []
    for first, second in combinations(trials, 2):
        same = [
            words
            for words, a, b in (
                ("counts", _counts(first), _counts(second)),
                ("force readings", first.raw_force_n, second.raw_force_n),
            )
            if a.shape == b.shape and np.array_equal(a, b) and np.count_nonzero(np.diff(a, axis=0)) >= FEWEST_MOVED
        ]
        if not same:
            continue
        text = (
            f"trial {second.number}: the same {' and '.join(same)} as in trial {first.number} at every sample: it is "
            f"a copy, "
            "and makes the scatter look smaller; reject one (pianorig annotate)"
        )
        out.append(SessionFinding("duplicated trial", second.number, "", float(first.number), 0.0, text))
    return out


def _counts(m: MeasuredTrial) -> np.ndarray:
    return np.rint((m.change_rad - m.change_rad[0]) / m.resolution_rad)
