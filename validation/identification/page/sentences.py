"""What an identification says, in plain sentences, the most important first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from validation.identification.further.shrink import Prospect
from validation.identification.outcome.held_out import CEILING, NULL, EventScore, event_words
from validation.identification.outcome.result import FITTED, IDENTIFIED, Identification
from validation.report.tables.formatting import number

SPEED = "hammer_speed"
EVEN = 0.05  # of a ratio of two scores: closer than that is as good
WHO = (("identified", "with the identified values"), ("before", "with those before"), (NULL, "by the null model"))


def plain_sentences(found: Identification, ranked: Sequence[Prospect] = ()) -> list[str]:
    """The sentences at the head of the page.

    Parameters
    ----------
    found : Identification
    ranked : what could be recorded next; empty where it was not asked for
    """
    said = [_what_was_found(found), *found.details.explained]
    said += [
        f"These strokes cannot tell the size of {d.words}: {100 * d.left:.0f} % of its prior u is left."
        for d in found.undetermined
    ][:3]
    said += _held_out(found)
    said.append(_next(ranked, found.details.fitted.converged))
    return said


def _what_was_found(found: Identification) -> str:
    n, trials = len(found.estimates), len(found.details.problem.trials)
    of = f"{_count(trials, 'trial')} of {_count(len(found.details.problem.seen), 'session')}"
    made = f"{_count(n, 'parameter')} {'was' if n == 1 else 'were'} asked of {of}: "
    known = [e for e in found.estimates if e.verdict == IDENTIFIED]
    if not known:
        return made + "no value is called identified; the table says why for each."
    named = ", ".join(f"{e.name} {number(e.value, 3)} (u {number(e.u, 2)})" for e in known)
    rest = len(found.estimates) - len(known)
    return made + f"{len(known)} called identified ({named})" + (f", {rest} not." if rest else ".")


def _held_out(found: Identification) -> list[str]:
    held = [name for name in found.scores if name != FITTED]
    if not held:
        return ["Nothing was held out: how well the fitted strokes are met is no prediction. Use --hold-out."]
    said = []
    for name in held:
        by = found.events.get(name)
        curve = _curve(found.scores[name])
        if by is None:  # the key drives: it has no events of its own
            said.append(f"Predicted under the measured motion of the key, not fitted, {name}:{curve}")
        else:
            said.append(f"Predicted, not fitted, {name}: {_speed(by)}{curve}")
    return said


def _speed(by: Mapping[str, Mapping[str, EventScore]]) -> str:
    """How far the hammer's speed is off, as a sentence."""
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


def _curve(scores: Mapping[str, Mapping[str, float] | None]) -> str:
    """The same of the hammer's curve, and whether the values identified are better than those before."""
    parts = [
        f"{number(1e3 * by['hammer'], 2)} mrad {words}"
        for who, words in (*WHO, ("scatter of trials", "is the scatter of the trials"))
        if (by := scores.get(who)) is not None
    ]
    before, after = scores.get("before"), scores.get("identified")
    judged = ""
    if before is not None and after is not None:
        ratio = after["hammer"] / before["hammer"]
        what = "no better than" if abs(ratio - 1.0) < EVEN else "better than" if ratio < 1.0 else "worse than"
        judged = f" The identified values predict the curve {what} those before."
    return f" Hammer curve off by (RMS) {', '.join(parts)}.{judged}" if parts else ""


def _next(ranked: Sequence[Prospect], settled: bool) -> str:
    if not ranked:
        return "What to record next was not asked for; --plan plan.toml ranks the strokes on the shelf."
    best = ranked[0]
    doubt = "" if settled else "; but the fit it is predicted from did not settle"
    most = min(best.shrink, key=lambda name: best.shrink[name])
    return (
        f"Next: {prospect_words(best)} would shrink u to {100 * best.mean:.0f} % on average, that of {most} to "
        f"{100 * best.shrink[most]:.0f} % (predicted{doubt})."
    )


def prospect_words(p: Prospect) -> str:
    """What could be done next, in words: so many trials of a stroke, so many more of a session, a sensor."""
    if p.candidate is None:
        return p.name
    return f"{p.trials} {p.name}" if p.candidate.profile is None else f"{p.trials} trials of {p.name}"


def as_sentence(line: str) -> str:
    """A line with a full stop, and with a capital where it does not begin with a name or a number."""
    first = line.split(" ")[0]
    head = line[0].upper() if first.isalpha() else line[0]
    return f"{head}{line[1:]}{'' if line.endswith('.') else '.'}"


def together(refused: Sequence[str]) -> list[str]:
    """Lines ``name: reason`` with the names of one reason in one line."""
    names: dict[str, list[str]] = {}
    for line in refused:
        name, _, reason = line.partition(": ")
        names.setdefault(reason, []).append(name)
    return [f"{', '.join(of)}: {reason}" for reason, of in names.items()]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"
