"""What an identification says, in plain sentences, the most important first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from validation.identification.further.shrink import Prospect
from validation.identification.outcome.held_out import CEILING, NULL, event_words
from validation.identification.outcome.result import FITTED, IDENTIFIED, Identification
from validation.report.tables.formatting import number

SPEED = "hammer_speed"


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
    trials = len(found.details.problem.trials)
    sessions = len(found.details.problem.seen)
    made = f"{len(found.estimates)} parameters were asked of {trials} trials of {_count(sessions, 'session')}: "
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
    title, factor, unit = event_words(SPEED)
    said = []
    for name in held:
        by = found.events.get(name)
        if by is None:  # the key drives: it has no events of its own
            said.append(
                f"Predicted under the measured motion of the key, not fitted, {name}.{_curve(found.scores[name])}"
            )
            continue
        parts = []
        for who, words in (("identified", "identified"), ("before", "before"), (NULL, "null model")):
            score = by[who][SPEED]
            if math.isfinite(score.rms):
                parts.append(f"{words} {number(factor * score.rms, 2)} {unit} in {score.both} of {score.trials}")
        ceiling = by[CEILING][SPEED].rms
        if math.isfinite(ceiling):
            parts.append(f"the trials themselves scatter by {number(factor * ceiling, 2)} {unit}")
        speed = f"{title.lower()} off by (RMS) {'; '.join(parts)}" if parts else f"{title.lower()} is not known there"
        said.append(f"Predicted, not fitted, {name}: {speed}.{_curve(found.scores[name])}")
    return said


def _curve(scores: Mapping[str, Mapping[str, float] | None]) -> str:
    """The same of the hammer's curve, as a sentence."""
    parts = [
        f"{who} {number(1e3 * by['hammer'], 2)} mrad"
        for who in ("identified", "before", "null model", "scatter of trials")
        if (by := scores.get(who)) is not None
    ]
    return f" Hammer curve off by (RMS) {', '.join(parts)}." if parts else ""


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


def together(refused: Sequence[str]) -> list[str]:
    """Lines ``name: reason`` with the names of one reason in one line."""
    names: dict[str, list[str]] = {}
    for line in refused:
        name, _, reason = line.partition(": ")
        names.setdefault(reason, []).append(name)
    return [f"{', '.join(of)}: {reason}" for reason, of in names.items()]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"
