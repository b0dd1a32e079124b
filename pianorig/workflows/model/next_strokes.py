"""What to record next after an identification: every shipped profile on the bench of its first session, ranked."""

from __future__ import annotations

from pathlib import Path

from pianorig.errors import CommandInputError
from pianorig.workflows.model.predict_blow import predictor
from rig import Rig, session_rig
from validation import Identification
from validation.identification.estimates import LACKING
from validation.identification.further.plan_file import write_plan
from validation.identification.further.shelf import shelf
from validation.identification.further.shrink import TRIALS, Prospect, prospects
from validation.identification.page.sentences import plain_sentences
from validation.identification.scatter import lacking


def next_strokes(
    found: Identification, rig: Rig | None = None, trials: int = TRIALS
) -> tuple[list[Prospect], list[str]]:
    """Strokes and sensors, ranked by how far they would shrink the intervals.

    Parameters
    ----------
    found : Identification
    rig : Rig, optional
        The bench; by default that of the first session.
    trials : int
        How many of each stroke.

    Returns
    -------
    prospects, refused : lists
        The second says what cannot be played or predicted, and why.

    Raises
    ------
    rig.errors.RigInputError
        The session's copy of its rig file is missing or was changed.
    pianorig.errors.CommandInputError
        Only tables were fitted.
    """
    sources = found.details.sources
    if not sources.measured:
        raise CommandInputError("--plan: no session was fitted, so the bench is not known; give one beside the tables")
    bench = session_rig(sources.sessions[0]) if rig is None else rig
    like, phases = sources.measured[0], found.details.problem.trials[0].time_s.size
    candidates, refused = shelf(bench.config, predictor(bench, found.action), like, phases)
    ranked, not_run = prospects(found.details.problem, found.details.fitted, candidates, trials)
    return ranked, [*refused, *not_run]


def write_next(found: Identification, ranked: list[Prospect], plan: Path) -> Path:
    """Write the best stroke as a trial plan; its path."""
    fitted = found.details.fitted
    doubts = [] if fitted.converged else ["the fit it is predicted from did not settle"]
    if lacking(fitted) > LACKING:
        doubts.append("the model lacks something; where it seems to, few predictions came true within 20 %")
    return write_plan(ranked, plan, doubts)[plan.name]


def reading_lines(found: Identification, ranked: list[Prospect], refused: list[str], most: int = 5) -> list[str]:
    """The plain sentences and the ranking, if there is one, as lines for the terminal."""
    said = plain_sentences(found, ranked)
    if not ranked:
        return said
    lines = [*said, "to record next (u of each parameter after, over u now, as predicted):"]
    for p in ranked[:most]:
        each = ", ".join(f"{name} {x:.2f}" for name, x in sorted(p.shrink.items(), key=lambda pair: pair[1])[:3])
        what = f"{p.trials} x {p.name}" if p.trials else p.name
        lines.append(f"  {p.mean:.2f}  {what} (most: {each})")
    return lines + [f"  not considered: {line}" for line in refused]
