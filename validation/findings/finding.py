"""One fault of a session in words and numbers, and what is said of all faults together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WIRING = ("sign flip", "swapped channels", "dead channel")  # the channel is no measurement of what it is named after
DISTORTING = ("camera offset", "outlying trial")


@dataclass(frozen=True)
class SessionFinding:
    """One fault: its kind, the trial and channel (NaN and empty for the whole session), value, limit, and words."""

    kind: str
    trial: float
    channel: str
    value: float
    limit: float
    text: str


def distorted_trials(findings: Sequence[SessionFinding]) -> list[int]:
    """Trials whose curves are not what happened, or not the others' blow: they widen what is called repeatability."""
    return sorted({int(f.trial) for f in findings if f.kind in DISTORTING and np.isfinite(f.trial)})


def summary_line(findings: Sequence[SessionFinding]) -> str:
    """All kinds of finding with their trials in one sentence; empty when there is none."""
    kinds: dict[str, list[int]] = {}
    for f in findings:
        trials = kinds.setdefault(f.kind, [])
        if np.isfinite(f.trial) and int(f.trial) not in trials:
            trials.append(int(f.trial))
    if not kinds:
        return ""
    parts = []
    for kind, trials in kinds.items():
        where = f"trial{'' if len(trials) == 1 else 's'} {', '.join(map(str, trials))}" if trials else "model"
        parts.append(f"{kind} ({where})")
    return f"Faults found: {', '.join(parts)}; read the warnings before the scores."
