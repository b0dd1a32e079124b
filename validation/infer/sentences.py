"""Plain sentences on an identification, for its page and the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from validation.infer.estimates import IDENTIFIED
from validation.infer.further import Prospect
from validation.infer.lacks import measure_separation
from validation.infer.result import FITTED, Identification
from validation.infer.scores import CEILING, NULL, EventScore, event_words
from validation.numbers import number, with_u
from validation.part_names import part_name

SPEED = "hammer_speed"
EVEN = 0.05  # of a ratio of two scores: closer than that is as good
WHO = (("identified", "with the identified values"), ("before", "with those before"), (NULL, "by the null model"))


def plain_sentences(found: Identification, ranked: Sequence[Prospect] = ()) -> list[str]:
    """Sentences of an identification for the head of its page; ``ranked``: what could be recorded next, empty where it
    was not asked for."""
    said = [_describe_estimates(found)]
    said += [
        f"These strokes cannot tell the size of {d.words}: {100 * d.left:.0f} % of its uncertainty before is left."
        for d in found.undetermined
    ][:3]
    return said + _describe_held_out(found) + (_describe_next(found, ranked) if ranked else [])


def _describe_estimates(found: Identification) -> str:
    """Sentence on the identified parameters with their uncertainties, or on why none is."""
    n, trials = len(found.estimates), _count(len(found.details.problem.trials), "trial")
    known = [e for e in found.estimates if e.verdict == IDENTIFIED]
    if not known:
        why = dict.fromkeys(e.verdict.partition(": ")[2] or e.verdict for e in found.estimates)
        return f"No value of {_count(n, 'parameter')} is identified from {trials}: {'; '.join(why)}."
    named = "; ".join(
        f"{part_name(e.name, found.action)} {with_u(e.value, e.u)}{'' if e.unit == '1' else ' ' + e.unit}"
        for e in known
    )
    return f"Identified from {trials}: {len(known)} of {_count(n, 'parameter')}: {named}."


def _describe_held_out(found: Identification) -> list[str]:
    """Sentences on how well held-out trials are predicted."""
    held = [name for name in found.scores if name != FITTED]
    if not held:
        return ["No trial was held out, so how well the values predict other strokes is not known (`hold_out`)."]
    said = []
    for name in held:
        by = found.events.get(name)
        name = name.removesuffix(", held out")
        curve = _curve_words(found.scores[f"{name}, held out" if f"{name}, held out" in found.scores else name])
        if by is None:  # the key drives: it has no events of its own
            said.append(f"Held out, {name}, under the measured motion of the key:{curve}")
        else:
            said.append(f"Held out, {name}: {_describe_speed_error(by)}{curve}")
    return said


def _describe_speed_error(by: Mapping[str, Mapping[str, EventScore]]) -> str:
    """Sentence on the RMS errors of predicted hammer speed by each model of `WHO`, beside the trials' own scatter, or
    that it is not known; ``by``: name in `WHO` or `CEILING` → event → `EventScore`."""
    title, factor, unit = event_words(SPEED)
    parts = []
    for who, words in WHO:
        score = by[who][SPEED]
        if math.isfinite(score.rms):
            seen = "" if score.both == score.trials else f" (where it strikes: {score.both} of {score.trials} trials)"
            parts.append(f"{number(factor * score.rms, 2)} {unit} {words}{seen}")
    ceiling = by[CEILING][SPEED].rms
    if math.isfinite(ceiling):
        parts.append(f"the trials themselves scatter by {number(factor * ceiling, 2)} {unit}")
    return f"{title.lower()} off by (RMS) {', '.join(parts)}." if parts else f"{title.lower()} is not known there."


def _curve_words(scores: Mapping[str, Mapping[str, float] | None]) -> str:
    """Text on the root mean square errors, degrees, of the hammer's angle, and whether the identified values are better
    than those before; ``scores``: model or scatter → channel → rad, None where it cannot run."""
    parts = [
        f"{number(math.degrees(by['hammer']), 2)}° {words}"
        for who, words in (*WHO, (CEILING, "is the scatter of the trials"))
        if (by := scores.get(who)) is not None
    ]
    before, after = scores.get("before"), scores.get("identified")
    judged = ""
    if before is not None and after is not None:
        ratio = after["hammer"] / before["hammer"]
        what = "no better than" if abs(ratio - 1.0) < EVEN else "better than" if ratio < 1.0 else "worse than"
        judged = f" The identified values predict the angle {what} those before."
    return f" Hammer angle off by (RMS) {', '.join(parts)}.{judged}" if parts else ""


def _describe_next(found: Identification, ranked: Sequence[Prospect]) -> list[str]:
    """Sentences on what to record next, the first of ``ranked`` (at least one, the best first), and on the stroke that
    best separates the changes that explain these strokes, where there are several."""
    best = ranked[0]
    doubt = "" if found.details.fitted.converged else "; but the fit it is predicted from ran out of its budget"
    most = min(best.shrink, key=lambda name: best.shrink[name])
    return [
        f"Next: {best.words} would leave {100 * best.mean:.0f} % of the uncertainties on average and "
        f"{100 * best.shrink[most]:.0f} % of that of {part_name(most, found.action)} (predicted{doubt}).",
        *describe_separating_stroke(found, ranked),
    ]


def describe_separating_stroke(found: Identification, ranked: Sequence[Prospect]) -> list[str]:
    """Sentence, in a list, on the ``ranked`` stroke in which the fits that explain these strokes alike differ most;
    empty where fewer than two fits do, or no stroke is ranked."""
    known = found.details.supported
    strokes = [(p, p.candidate.trial) for p in ranked if p.candidate is not None]
    if known is None or len(known.let_in) < 2 or not strokes:
        return []
    apart = measure_separation(known.let_in, [trial for _, trial in strokes])
    k = int(np.argmax(apart))
    return [
        f"What is lacking is told best by {strokes[k][0].words}: the fits that explain these strokes alike differ "
        f"there by {apart[k]:.0f} times the sensors' noise.",
    ]


def group_by_reason(refused: Sequence[str]) -> list[str]:
    """Lines ``name: reason`` with the names of one reason in one line."""
    names: dict[str, list[str]] = {}
    for line in refused:
        name, _, reason = line.partition(": ")
        names.setdefault(reason, []).append(name)
    return [f"{', '.join(of)}: {reason}" for reason, of in names.items()]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"
