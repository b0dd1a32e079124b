"""Which part of the model explains the difference of the fitted strokes: the answer of a report, session by session.

The question and the rule are those of `validate` (`validation.identification.difference`), so that page and report say
the same of the same strokes. What the fit held or moved plays no part: everything that may be wrong is a candidate
(docs/explanation/differences.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import model
from validation.identification.difference.explain import (
    ABOUT,
    MOST_TRIALS,
    Explained,
    explain_difference,
    explain_observed,
)
from validation.identification.observations import ObservedTrial
from validation.identification.sources import Sources
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

TITLE = "Which part of the model explains the difference"
NOT_LOOKED_FOR = "nothing was looked for, the difference is a few thousandths of the motion or the model cannot run"
SAMPLES = 2.5
BY_MOTION = f"{TITLE} is not asked where the key's motion drives the model; strokes with a recorded force tell."


def explained_lines(action: model.Action, sources: Sources) -> tuple[str, ...]:
    """One sentence for each session whose trials a force drives; one alone where none does.

    Parameters
    ----------
    action : values before the fit
    sources : what was fitted
    """
    tested = ModelUnderTest(action)
    found = [
        (_name(observed[0]), _explained(tested, observed, measured)) for observed, measured in driven_by_force(sources)
    ]
    lines = tuple(f"{TITLE}, {name}: {e.sentence.removeprefix(ABOUT) or NOT_LOOKED_FOR}." for name, e in found)
    return lines or (BY_MOTION,)


def driven_by_force(sources: Sources) -> list[tuple[list[ObservedTrial], list[MeasuredTrial]]]:
    """Trials of each session that a force drives, as they are compared and as measured; tables are not measured."""
    observed = [t for t in sources.fitted if t.key is None]
    first = len(observed) - len(sources.measured)  # those of tables come first
    out: dict[int, tuple[list[ObservedTrial], list[MeasuredTrial]]] = {}
    for i, t in enumerate(observed):
        trials, measured = out.setdefault(t.session, ([], []))
        trials.append(t)
        if i >= first:
            measured.append(sources.measured[i - first])
    return list(out.values())


def _explained(
    tested: ModelUnderTest, observed: Sequence[ObservedTrial], measured: Sequence[MeasuredTrial]
) -> Explained:
    if measured:
        return explain_difference(tested, measured)
    return explain_observed(tested, [t for t in observed if _same_phases(t, observed[0])][:MOST_TRIALS])


def _same_phases(a: ObservedTrial, b: ObservedTrial) -> bool:
    """Whether two trials are compared at the same phases, each at the nearest of its samples."""
    sample_s = float(np.median(np.diff(b.force_time_s)))
    return a.time_s.size == b.time_s.size and float(np.ptp(a.time_s - b.time_s)) < SAMPLES * sample_s


def _name(trial: ObservedTrial) -> str:
    return trial.label.rpartition(", trial")[0] or trial.label
