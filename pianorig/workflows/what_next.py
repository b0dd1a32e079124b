"""What to record next after an identification: every shipped profile on the bench of its first session, ranked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pianorig.errors import CommandInputError
from pianorig.workflows.predict_blow import predictor
from rig import Rig, RigError, Session, session_rig
from validation import Identification
from validation.identification.estimates import LACKING
from validation.identification.further import TRIALS, Prospect, best_stroke, prospects, shelf, write_plan
from validation.identification.page import plain_sentences, prospect_words, together
from validation.identification.scatter import lacking

NO_SESSION = (
    "--plan: no session with forces was fitted, so neither bench nor sensors are known; give one beside what was given"
)


def next_strokes(
    found: Identification, rig: Rig | None = None, trials: int = TRIALS
) -> tuple[list[Prospect], list[str]]:
    """Strokes and sensors, ranked by how far they would shrink the intervals.

    Parameters
    ----------
    rig : the bench; by default that of the first session
    trials : how many of each stroke

    Returns
    -------
    prospects, refused : lists
        The second says what cannot be played or predicted, and why.

    Raises
    ------
    rig.errors.RigInputError
        The session's copy of its rig file is missing or was changed.
    pianorig.errors.CommandInputError
        No trial of a session was fitted that a force drives.
    """
    sources = found.details.sources
    if not sources.measured:
        raise CommandInputError(NO_SESSION)
    bench = session_rig(sources.sessions[0]) if rig is None else rig
    like, phases = sources.measured[0], found.details.problem.trials[0].time_s.size
    candidates, refused = shelf(bench.config, predictor(bench, found.action), like, phases)
    ranked, not_run = prospects(found.details.problem, found.details.fitted, candidates, trials)
    return ranked, [*refused, *not_run]


def check_plan(sessions: Sequence[Path], motion_driven: bool) -> None:
    """Refuse, before a fit is made, what nothing can be ranked for: the shelf is of strokes that a force drives.

    Raises
    ------
    rig.errors.RigInputError
        The first session's copy of its rig file is missing or was changed.
    pianorig.errors.CommandInputError
        The key's motion is to drive the model, or there are only tables.
    """
    if motion_driven:
        raise CommandInputError("--plan: ranks strokes by the force on the key; leave out --motion-driven or --plan")
    session_rig(Session.open(sessions[0]))


def ranked_next(found: Identification) -> tuple[list[Prospect], list[str], str]:
    """As `next_strokes`, and why no plan can be written; what hinders it is told, so that the fit is not lost.

    Returns
    -------
    prospects, refused : lists
    why_none : str
        Empty where a stroke can be recommended.
    """
    try:
        ranked, refused = next_strokes(found)
    except (CommandInputError, RigError) as error:
        return [], [], str(error).removeprefix("--plan: ")
    if best_stroke(ranked) is not None:
        return ranked, refused, ""
    return (
        ranked,
        refused,
        "no profile could be predicted within the limits of the rig file"
        + (f" ({'; '.join(together(refused))})" if refused else ""),
    )


def write_next(found: Identification, ranked: list[Prospect], plan: Path) -> Path:
    """Write the best stroke as a trial plan; its path."""
    fitted = found.details.fitted
    doubts = [] if fitted.converged else ["the fit it is predicted from did not settle"]
    if lacking(fitted) > LACKING:
        doubts.append("the model seems to lack something, and these predictions take it as right")
    return write_plan(ranked, plan, doubts)[plan.name]


def reading_lines(found: Identification, ranked: list[Prospect], refused: list[str], most: int = 5) -> list[str]:
    """The plain sentences and the ranking, if there is one, as lines for the terminal."""
    said = plain_sentences(found, ranked)
    if not ranked:
        return said
    lines = [*said, "to record next (u of each parameter after, over u now, as predicted):"]
    for p in ranked[:most]:
        each = ", ".join(f"{name} {x:.2f}" for name, x in sorted(p.shrink.items(), key=lambda pair: pair[1])[:3])
        lines.append(f"  {p.mean:.2f}  {prospect_words(p)} (most: {each})")
    return lines + [f"  not considered: {line}" for line in together(refused)]
