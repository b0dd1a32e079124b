"""One fault of a session in words and numbers, and what is said of all faults together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# the channel is no measurement of what it is named after
WIRING = ("sign flip", "swapped channels", "dead channel", "encoder scale")
# the trial's curves are not what happened, or not the others' blow
DISTORTING = ("camera offset", "film clock", "outlying trial", "encoder return", "stuck bit", "duplicated trial")
FORCE = ("force sign", "force unit", "force drift", "force saturation", "outlying residual")  # its prediction is wrong
KINDS = (
    *WIRING,
    *DISTORTING,
    *FORCE,
    "force delay",
    "hum",
    "key lift",
    "sample rate",
    "short record",
    "film mirrored",
    "film bodies swapped",
    "film body reversed",
    "film or encoder scale",
    "encoder scale or stops",
    "stops not reached",
    "mixed strokes",
    "changed condition",
    "regulation",
    "check height",
)
"""Every kind of finding: faults of the session and causes that nothing else the toolkit knows explains as well."""


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
    """Trials whose curves are not what happened, or not the others' blow: they distort what is called repeatability."""
    return sorted({int(f.trial) for f in findings if f.kind in DISTORTING and np.isfinite(f.trial)})


def are_faulty(numbers: Sequence[int]) -> str:
    """That trials are faulty, in words."""
    verb = "are" if numbers[1:] else "is"
    return f"trial{'s' if numbers[1:] else ''} {', '.join(map(str, numbers))} {verb} faulty"


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
        where = f"trial{'' if len(trials) == 1 else 's'} {', '.join(map(str, trials))}" if trials else "session"
        parts.append(f"{kind} ({where})")
    return f"Faults found: {', '.join(parts)}; read the warnings before the scores."
