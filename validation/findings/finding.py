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
    """Finding: its kind, trial (NaN for several) and channel, value, limit, sentence, and all trials that have it."""

    kind: str
    trial: float
    channel: str
    value: float
    limit: float
    text: str
    trials: tuple[int, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of all trials that have it; empty for a finding of the whole session."""
        return self.trials or ((int(self.trial),) if np.isfinite(self.trial) else ())


CHANGED_CONDITION = "changed condition"
CONDITIONS = ("mixed strokes", CHANGED_CONDITION)
"""Findings of a session that is several: said before all that spoil nothing, since the others are of one part."""
CHANNEL, CURVES, BLOW, PREDICTION = "channel", "curves", "blow", "prediction"
"""What a finding may spoil: its channel is no measurement of what it is named after; its trial's curves are not what
happened; they are not of the others' blow; its trial's prediction is wrong. The first is the most urgent."""


class Source(NamedTuple):
    """Who made a recording: the file that states its channels, and how it is made again."""

    settings: str
    remake: str


RIG, OTHER_PROGRAM = Source("rig file", "record again"), Source("mapping", "import again")


class Kind(NamedTuple):
    """What a kind of finding spoils, and a sentence of what to do about it; either may be empty."""

    spoils: str
    mend: str  # with the fields of a `Source` in braces


KINDS = {
    "force gain": Kind(
        PREDICTION, "Calibrate the load cell (pianorig calibrate force); loosen nothing in the action for this."
    ),
    "force delay": Kind(
        "", "Measure the delay of the force channel against the encoders and state it in the {settings}."
    ),
    "encoder scale": Kind("", "Check the scale of the encoder."),
    "encoder delay": Kind("", "Check the filter and the sample clock of the encoder's channel."),
    "encoder zero": Kind("", "Wait until the action rests before each stroke; check the encoder's mounting."),
    "force level": Kind(PREDICTION, "Zero the load cell, check its mounting; loosen nothing in the action for this."),
}
"""Every kind of finding: what is seen, and causes that the search names among those it compared. Those above are of the
search (`validation.infer.causes`); the checks of this folder enter theirs by `register_kinds`."""
Check = TypeVar("Check", bound=Callable[..., Any])
OF_TRIAL: list[Callable[[MeasuredTrial], list[SessionFinding]]] = []
OF_TRIALS: list[Callable[[Sequence[MeasuredTrial]], list[SessionFinding]]] = []
"""Checks that rest on nothing but the recording, of each trial and of all, in the order in which they are entered:
`validation.findings.find_faults` asks them before all others, which depend on each other and which it calls by name."""


def register_kinds(
    kinds: Mapping[str, str], spoils: str = "", among: list[Callable[[Any], list[SessionFinding]]] | None = None
) -> Callable[[Check], Check]:
    """Decorator of a check: enters its kinds of finding in `KINDS` (``kinds``: name → what to do, ``spoils``: what each
    of them invalidates, `CHANNEL`, `CURVES`, `BLOW`, `PREDICTION` or nothing) and appends the check to ``among``, if
    given.

    What is to be done names no trial and no channel: `validation.findings.unusable` names them all.
    """

    def enter_kinds(check: Check) -> Check:
        KINDS.update({kind: Kind(spoils, mend) for kind, mend in kinds.items()})
        if among is not None:
            among.append(check)
        return check

    return enter_kinds


def make_finding(kind: str, channel: str, by_trial: Mapping[int, float], limit: float, text: str) -> SessionFinding:
    numbers = tuple(sorted(by_trial))
    mean = float(np.mean([by_trial[number] for number in numbers]))
    trial = float(numbers[0]) if len(numbers) == 1 else float("nan")
    return SessionFinding(kind, trial, channel, mean, limit, text, numbers)


def uncertainty_of_mean(values: Collection[float]) -> float:
    """Standard uncertainty of a mean by the scatter of its values; NaN for one."""
    return float(np.std(list(values), ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


def name_trials(numbers: Collection[int], among: Collection[int]) -> str:
    """Text that names the trials ``numbers`` among all, such as ``from trial 3 on (5 of 7 trials)``."""
    own, every = sorted(numbers), sorted(among)
    n = len(every)
    if len(own) == n:
        return f"in all {n} trials" if n > 1 else f"in trial {own[0]}, the only one"
    if len(own) > 1 and own == every[-len(own) :]:
        return f"from trial {own[0]} on ({len(own)} of {n} trials)"
    return f"in {trials_in_words(own)} ({len(own)} of {n} trials)"


def summary_line(findings: Sequence[SessionFinding]) -> str:
    """All kinds of finding with their trials in one sentence; empty when there is none."""
    kinds: dict[str, list[int]] = {}
    for f in findings:
        trials = kinds.setdefault(f.kind, [])
        trials.extend(number for number in f.numbers if number not in trials)
    if not kinds:
        return ""
    parts = []
    for kind, trials in kinds.items():
        where = trials_in_words(sorted(trials)) if trials else "session"
        where = f"from {where} on" if kind == CHANGED_CONDITION and trials else where
        parts.append(f"{kind} ({where})")
    return f"Findings: {', '.join(parts)}; read the warnings before the scores."


T = TypeVar("T")
LeftOut = Collection[tuple[int, str]]


def select_counted(trials: Mapping[int, T], channel: str, without: LeftOut) -> dict[int, T]:
    return {number: x for number, x in trials.items() if (number, channel) not in without}


def select_counted_events(events: Mapping[int, dict[str, Event]], without: LeftOut) -> dict[int, dict[str, Event]]:
    """Events by trial number and name, but for those read from an encoder in ``without``, pairs of trial number and
    channel."""
    return {
        number: {
            name: event
            for name, event in found.items()
            if not any((number, body) in without for body in EVENTS[name].bodies)
        }
        for number, found in events.items()
    }


def describe_left_out(numbers: Collection[int], channel: str, without: LeftOut) -> str:
    """How many trials of a channel count and which do not, ``without`` being pairs of trial number and channel; empty
    when all do."""
    missing = sorted(number for number in numbers if (number, channel) in without)
    if not missing:
        return ""
    which = trials_in_words(missing)
    return f"{len(numbers) - len(missing)} of {len(numbers)}: {which} left out"


def select_sound_trials(
    trials: Sequence[MeasuredTrial], findings: Iterable[SessionFinding], ignored_kind: str = ""
) -> list[MeasuredTrial]:
    """Trials without a fault that spoils the comparison of one trial with the model; faults of ``ignored_kind`` do not
    count."""
    broken = {number for f in findings if KINDS[f.kind].spoils and f.kind != ignored_kind for number in f.numbers}
    return [m for m in trials if m.number not in broken]
