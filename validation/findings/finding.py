"""One fault of a session in words and numbers, and what is said of all faults together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from validation.events.definitions import EVENTS, Event
from validation.measurement.trial import MeasuredTrial, trials_in_words


@dataclass(frozen=True)
class SessionFinding:
    """One fault: its kind, the trial and channel (NaN and empty for the whole session), value, limit, and words."""

    kind: str
    trial: float
    channel: str
    value: float
    limit: float
    text: str


CHANNEL, CURVES, BLOW, PREDICTION = "channel", "curves", "blow", "prediction"
"""What a finding may spoil: its channel is no measurement of what it is named after; its trial's curves are not what
happened; they are not of the others' blow; its trial's prediction is wrong. The first is the most urgent."""


class Kind(NamedTuple):
    """What a kind of finding spoils, and a sentence of what to do about it; either may be empty."""

    spoils: str
    mend: str


KINDS = {
    "force gain": Kind(
        PREDICTION, "Calibrate the load cell (pianorig calibrate-force); loosen nothing in the action for this."
    ),
    "force level": Kind(PREDICTION, "Zero the load cell, check its mounting; loosen nothing in the action for this."),
}
"""Every kind of finding: faults of the session and causes that nothing else the toolkit knows explains as well. These
two are of the search for causes (`validation.identification.difference`); the checks of this folder enter theirs by
`finds`."""
Check = TypeVar("Check", bound=Callable[..., Any])
OF_TRIAL: list[Callable[[MeasuredTrial], list[SessionFinding]]] = []
OF_TRIALS: list[Callable[[Sequence[MeasuredTrial]], list[SessionFinding]]] = []
"""Checks that rest on nothing but the recording, of each trial and of all, in the order in which they are entered:
`validation.findings.find_faults` asks them before all others, which depend on each other and which it calls by name."""


def finds(
    kinds: Mapping[str, str], spoils: str = "", among: list[Callable[[Any], list[SessionFinding]]] | None = None
) -> Callable[[Check], Check]:
    """Enter the kinds that a check finds, with what is to be done about each and what all of them spoil, and the check
    ``among`` those of one sort.

    What is to be done names no trial and no channel: `validation.findings.unusable` names them all.
    """

    def entered(check: Check) -> Check:
        KINDS.update({kind: Kind(spoils, mend) for kind, mend in kinds.items()})
        if among is not None:
            among.append(check)
        return check

    return entered


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
        where = trials_in_words(trials) if trials else "session"
        parts.append(f"{kind} ({where})")
    return f"Faults found: {', '.join(parts)}; read the warnings before the scores."


T = TypeVar("T")
LeftOut = Collection[tuple[int, str]]


def pooled(trials: Mapping[int, T], channel: str, without: LeftOut) -> dict[int, T]:
    """The trials that count for a channel."""
    return {number: x for number, x in trials.items() if (number, channel) not in without}


def counting_events(events: Mapping[int, dict[str, Event]], without: LeftOut) -> dict[int, dict[str, Event]]:
    """The events of each trial that count: those of which every encoder they are read from is sound."""
    return {
        number: {
            name: event
            for name, event in found.items()
            if not any((number, body) in without for body in EVENTS[name].bodies)
        }
        for number, found in events.items()
    }


def state_of(numbers: Collection[int], channel: str, without: LeftOut) -> str:
    """How many trials of a channel count and which do not; empty when all do."""
    missing = sorted(number for number in numbers if (number, channel) in without)
    if not missing:
        return ""
    which = trials_in_words(missing)
    return f"{len(numbers) - len(missing)} of {len(numbers)}: {which} left out"


def sound_trials(
    trials: Sequence[MeasuredTrial], findings: Iterable[SessionFinding], but: str = ""
) -> list[MeasuredTrial]:
    """Trials without a fault that spoils the comparison of one trial with the model; one kind may be let pass."""
    broken = {f.trial for f in findings if KINDS[f.kind].spoils and f.kind != but}
    return [m for m in trials if m.number not in broken]
