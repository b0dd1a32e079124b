"""``pianorig demo``: the main job on the virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson, Profile
from pianorig.console.output import paragraphs, tell, verdict_lines


def command(
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create; default: sessions/<date>_demo.")
    ] = None,
    profile: Profile = "forte",
    trials: Annotated[int, typer.Option("--trials", help="Number of trials.")] = 5,
    as_json: AsJson = False,
) -> None:
    """Record five virtual blows, film and track one, report.

    Example:  pianorig demo --out sessions/demo
    """
    target = out or workflows.new_session_folder("demo")
    demo = workflows.run_demo(target, trials=trials, profile=profile, quiet=as_json)
    report = demo.result.files["report.html"]
    facts = {"session": demo.session.path, "report": report, "verdict": demo.result.verdict}
    lines = [
        *("\nVerdict", *verdict_lines(demo.result.verdict_lines)),
        *("\nMeasured in this run", *workflows.figure_lines(demo.figures)),
        *("\nWhat you just saw", *paragraphs(workflows.seen_in_words(demo))),
        "\nWhat to do next",
        *(f"  {line}\n      {what}" for line, what in workflows.next_commands(demo.session.path)),
        f"\nreport: {report}",
    ]
    tell(as_json, facts | demo.figures.facts(), lines)
