"""What to do after a comparison: at most three sentences of a closed list, the first the most urgent.

Order: a fault of the session comes first, and while there is one that spoils the comparison nothing is advised about
the model. Then what explains the difference, then strokes outside of what was fitted, then a rival that is nearer.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from validation.findings.find_faults import order_kinds
from validation.findings.finding import RIG, SessionFinding, Source
from validation.findings.unusable import list_unusable_data, name_unusable
from validation.infer.causes.explain import CompatibleChange, Explained, group_by_set
from validation.infer.hypotheses import ALL
from validation.measurement.trial import trials_in_words
from validation.result import AGREES
from validation.statistics.rivals import Rivals
from validation.statistics.skill import CALLED, Skill

MOST = 3  # pieces of advice, and causes in one: choice, more are not read
NOTHING = "Nothing: no difference beyond the stated uncertainty is shown."
MEND = {name: kind.mend for name, kind in order_kinds().items() if kind.mend}
"""What to do about each kind of finding, `Kind.mend`; of a key that lifts nothing, its samples are left out."""
SPOIL = {name for name, kind in order_kinds().items() if kind.spoils}
TRAINING = {"repetition": "repetitions", "strike": "strokes that strike", "release": "strokes that are let go"}
"""What to record where no fitted stroke has a phase."""


def what_to_do(
    findings: Sequence[SessionFinding], explained: Explained, rivals: Rivals, outcome: str, source: Source = RIG
) -> tuple[str, ...]:
    """At most three sentences on what to do, the most urgent first: about ``findings``; unless these spoil the
    comparison, then about causes, training domain and nearer rivals. ``outcome``: one of `OUTCOMES`, ``source``: who
    recorded.

    Parameters
    ----------
    findings : all faults of the session
    explained : the answer of the search for causes
    rivals : domain and skill
    outcome : one of `validation.result.OUTCOMES`
    source : who made the recording
    """
    unusable = name_unusable(list_unusable_data(findings))
    said = [f"Record again or reject (pianorig annotate): {unusable}."] if unusable else []
    said += advise_on_findings(findings, source)
    if not any(f.kind in SPOIL for f in findings):
        said += advise_on_causes(explained)
        held = rivals.places[~rivals.places["fitted"].astype(bool)]
        said += advise_on_domain(dict(zip(held["trial"], held["why_outside"], strict=True)))
        said += advise_on_rivals(rivals.skill)
    if not said and outcome == AGREES:
        said = [NOTHING]
    return tuple(said[:MOST])


def advise_on_findings(findings: Sequence[SessionFinding], source: Source = RIG) -> list[str]:
    """What to do about each kind of finding, the most urgent first, in the words of the recording's ``source``."""
    kinds = {f.kind for f in findings}
    return list(dict.fromkeys(words.format(**source._asdict()) for kind, words in MEND.items() if kind in kinds))


def advise_on_causes(explained: Explained) -> list[str]:
    """One sentence, in a list, on what to measure or calibrate, from the causes that explain the difference in all
    trials; empty where there is none."""
    if all(change.profile != ALL for change in explained.changes):
        return []
    first: dict[tuple[str, str, int], CompatibleChange] = {}
    for change in explained.changes:
        first.setdefault(change.identity, change)
    rows = list(first.values())
    sets = [{change.identity for change in one} for one in group_by_set(explained.changes)]
    common = [row for row in rows if all(row.identity in one for one in sets)]
    others = list(dict.fromkeys(row.cause for row in rows if row not in common))
    shared = [row.cause for row in common if row.profile == ALL]
    if others:
        more = f" or {len(others) - MOST} more" if len(others) > MOST else ""
        which = f"{' or '.join(others[:MOST])}{more}: the trials cannot tell which of them"
        if shared:
            return [f"Measure {' and '.join(shared)}, and {which} goes with it."]
        return [f"Measure {which} makes the difference."]
    verb, partial = "explain" if len(shared) > 1 else "explains", [row.cause for row in common if row.profile != ALL]
    explains = (
        f"with {partial[0]} {verb} the difference" if partial else f"alone of the causes compared {verb} the difference"
    )
    if len(common) < common[0].changes:
        explains = "is a part of what makes the difference"
    elif all(row.of_session for row in common):
        return [f"Calibrate the bench: {' with '.join(shared)} {explains}; loosen nothing in the action."]
    return [f"Measure {' and '.join(shared)}, which {explains}."]


def advise_on_domain(outside: Mapping[int, str]) -> list[str]:
    """One sentence, in a list, on what to record before predictions outside the training domain are trusted, or none;
    ``outside``: number of a trial that was not fitted → why it lies outside, empty for one that lies inside."""
    far = {number: why for number, why in outside.items() if why}
    if not far:
        return []
    new = [word for phase, word in TRAINING.items() if any(_phase_missing(why, phase) for why in far.values())]
    what = " and ".join(new) if new else f"strokes like {trials_in_words(sorted(far))}"
    return [f"Record {what} and identify again before you trust the model there."]


def _phase_missing(why: str, phase: str) -> bool:
    names, _, said = why.partition(":")
    return said.endswith("no fitted stroke has it") and phase in names.split(", ")


def advise_on_rivals(skill: Mapping[str, Skill]) -> list[str]:
    """One sentence, in a list, against relying on the model in channels where a rival is nearer beyond the 95 %
    interval of the skill; empty where none is. ``skill``: by channel."""
    lost = {channel: one for channel, one in skill.items() if one.high < 0.0}
    if not lost:
        return []
    rivals = dict.fromkeys(CALLED.get(one.rival, one.rival) for one in lost.values())
    return [
        f"Do not rely on this model for {_join_words(lost)} on such strokes before it is identified on them: "
        f"{_join_words(rivals)} {'is' if len(rivals) == 1 else 'are'} nearer."
    ]


def _join_words(words: Collection[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last
