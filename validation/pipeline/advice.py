"""What to do after a comparison: at most three sentences of a closed list, the first the most urgent.

Order: a fault of the session comes first, and while there is one that spoils the comparison nothing is advised about
the model. Then what explains the difference, then strokes outside of what was fitted, then a rival that is nearer.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from validation.events.definitions import EVENTS
from validation.findings.finding import DISTORTING, FORCE, KINDS, WIRING, SessionFinding
from validation.identification.difference.explain import CompatibleChange, Explained
from validation.identification.difference.responses import ALL
from validation.result import AGREES
from validation.statistics.rivals import CALLED, Rivals, Skill

MOST = 3
MOST_CAUSES = 3
NOTHING = "Nothing: no difference beyond the stated uncertainty is shown."
USE = "Use the identified set for strokes like those it was fitted to; record and fit others before it is used there."
IDENTIFY = "Identify a set on some of these strokes (pianorig identify) before the hammer is predicted for others."
MEND = {
    "sign flip": "Turn the sign of {channel} in the rig file and record {trials} again.",
    "swapped channels": "Exchange the channels {channel} in the rig file and record {trials} again.",
    "dead channel": "Check scale, cable and counter of {channel}, which stands still in {trials}.",
    "encoder scale": "Check decoding and lines per revolution of {channel} in the rig file.",
    "camera offset": "Check trigger frame, exposure and delay of the camera ({trials}).",
    "film clock": "Check the camera's rate and look for lost frames ({trials}).",
    "outlying trial": "Look at {trials}, unlike the others: annotate what was no such blow (pianorig annotate).",
    "encoder return": "Check signal level and largest count rate of {channel}, then record {trials} again.",
    "stuck bit": "Check cable and counter of {channel}, then record {trials} again.",
    "duplicated trial": "Reject {trials}: a copy (pianorig annotate).",
    "force sign": "Turn the sign of the load cell in the rig file and record {trials} again.",
    "force unit": "Check unit and sensitivity of the load cell in the rig file.",
    "force gain": "Calibrate the load cell (pianorig calibrate-force); loosen nothing in the action for this.",
    "force level": "Zero the load cell, check its mounting; loosen nothing in the action for this.",
    "force drift": "Let the load cell warm up, check its cable and mounting; loosen nothing in the action for this.",
    "force saturation": "Widen the range of the force channel and record {trials} again.",
    "outlying residual": "Look at force and encoders of {trials}; annotate a disturbed blow (pianorig annotate).",
    "force delay": "Measure the delay of the force channel and state it in the rig file.",
    "hum": "Check shield and ground of the load cell.",
    "sample rate": "Record all trials at one rate.",
    "short record": "Annotate {trials}, which ends early, or record it again: no score looks further.",
    "film mirrored": "Mirror the film of {trials} and track it again.",
    "film bodies swapped": "Correct the names of the outlines of {trials} and track again.",
    "film body reversed": "Check the outlines of {trials} and track again.",
    "film or encoder scale": "Check the scale of the whippen's encoder, and whether the film was seen at an angle.",
    "encoder scale or stops": "Measure key dip and blow distance: is it the stops or the scale of {channel}?.",
    "stops not reached": "Look at the action: in {trials} key and whippen end elsewhere than at its stops.",
    "mixed strokes": "Validate the two kinds of stroke apart (conditions of the plan, or pianorig annotate).",
    "changed condition": "Look for what changed in action, motor or force channel, and validate both parts apart.",
    "regulation": "Measure the let-off, {value_mm:.1f} mm {side} the string than the model's, and regulate the "
    "action or the model (pianorig regulate).",
    "check height": "Measure the height of check, {value_mm:.1f} mm {side} the string than the model's, and regulate "
    "the action or the model (pianorig regulate), or look at the back check's friction.",
}
"""What to do about each kind of finding; of a key that lifts nothing, its samples are left out."""
SPOIL = {*WIRING, *DISTORTING, *FORCE}
TRAINING = {"repetition": "repetitions", "strike": "strokes that strike", "release": "strokes that are let go"}
"""What to record where no fitted stroke has a phase."""


def what_to_do(
    findings: Sequence[SessionFinding], explained: Explained, rivals: Rivals, outcome: str
) -> tuple[str, ...]:
    """Sentences for the head of a report.

    Parameters
    ----------
    findings : sequence of SessionFinding
        All faults of the session.
    explained : Explained
        The answer of the search for causes.
    rivals : Rivals
        Domain and skill.
    outcome : str
        One of `validation.result.OUTCOMES`.

    Returns
    -------
    tuple of str
        At most `MOST`; empty where nothing can be advised.
    """
    said = mend(findings)
    if not any(f.kind in SPOIL for f in findings):
        said += about_the_causes(explained)
        held = rivals.places[~rivals.places["fitted"].astype(bool)]
        said += beyond(dict(zip(held["trial"], held["why_outside"], strict=True)))
        said += nearer(rivals.skill)
    if not said and outcome == AGREES:
        said = [NOTHING]
    return tuple(said[:MOST])


def mend(findings: Sequence[SessionFinding]) -> list[str]:
    """One sentence for each kind of finding, in the order of `KINDS`."""
    said = []
    for kind in KINDS:
        own = [f for f in findings if f.kind == kind]
        if not own or kind not in MEND:
            continue
        numbers = sorted({int(f.trial) for f in own if math.isfinite(f.trial)})
        channels = dict.fromkeys(EVENTS[f.channel].title if f.channel in EVENTS else f.channel for f in own)
        value = own[0].value
        said.append(
            MEND[kind].format(
                trials=_trials(numbers) if numbers else "the session",
                channel=" and ".join(channels) or "the channel",
                value_mm=1e3 * abs(value),
                side="further from" if value > 0 else "closer to",
            )
        )
    return said


def about_the_causes(explained: Explained) -> list[str]:
    """What to measure, by the sets that explain what all trials share."""
    sets: dict[int, list[CompatibleChange]] = {}
    for change in (c for c in explained.changes if c.profile == ALL):
        sets.setdefault(change.set, []).append(change)
    if not sets:
        return []
    causes = list(dict.fromkeys(change.cause for one in sets.values() for change in one))
    more = f" or {len(causes) - MOST_CAUSES} more" if len(causes) > MOST_CAUSES else ""
    if len(sets) > 1:
        return [
            f"Measure {' or '.join(causes[:MOST_CAUSES])}{more}: the trials cannot tell which of them makes the "
            "difference."
        ]
    (only,) = sets.values()
    if all(change.of_session for change in only):
        return [f"Calibrate the bench: {' with '.join(causes)} explains the difference; loosen nothing in the action."]
    return [f"Measure {' and '.join(causes)}, which explain{'s' if len(causes) == 1 else ''} the difference."]


def beyond(outside: Mapping[int, str]) -> list[str]:
    """What to record before strokes are trusted that lie outside of what was fitted.

    Parameters
    ----------
    outside : dict
        Trial that was not fitted → why it lies outside, empty for one that does not.
    """
    far = {number: why for number, why in outside.items() if why}
    if not far:
        return []
    new = [word for phase, word in TRAINING.items() if any(_phase_missing(why, phase) for why in far.values())]
    what = " and ".join(new) if new else f"strokes like {_trials(sorted(far))}"
    return [f"Record {what} and identify again before you trust the model there."]


def _phase_missing(why: str, phase: str) -> bool:
    names, _, said = why.partition(":")
    return said.endswith("no fitted stroke has it") and phase in names.split(", ")


def nearer(skill: Mapping[str, Skill]) -> list[str]:
    """What to do where a rival is nearer on strokes that were not fitted, beyond the interval of the skill."""
    lost = {channel: one for channel, one in skill.items() if one.high < 0.0}
    if not lost:
        return []
    rivals = dict.fromkeys(CALLED.get(one.rival, one.rival) for one in lost.values())
    return [
        f"Do not rely on this model for {_and(lost)} on such strokes before it is identified on them: "
        f"{_and(rivals)} {'is' if len(rivals) == 1 else 'are'} nearer."
    ]


def _and(words: Collection[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _trials(numbers: Sequence[int]) -> str:
    return f"trial{'' if len(numbers) == 1 else 's'} {', '.join(map(str, numbers))}"
