"""``pianorig demo``: the main job on the virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson, Profile
from pianorig.console.output import print_json, print_paragraphs, print_verdict
from pianorig.console.progress import bar, recording_line, say, working


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
    show = workflows.DemoProgress() if as_json else workflows.DemoProgress(say, working, recording_line, bar)
    demo = workflows.run_demo(target, trials=trials, profile=profile, show=show)
    report = demo.result.files["report.html"]
    if as_json:
        figures = demo.figures
        print_json(
            {
                "session": demo.session.path,
                "report": report,
                "verdict": demo.result.verdict,
                "simulation_ms": figures.simulation_s * 1e3,
                "simulation_error_rad": figures.simulation_error_rad,
                "tracking_frames_per_s": figures.tracking_frames_per_s,
                "tracking_ratio_to_bound": {t.body: t.ratio for t in figures.tracking},
                "seconds": figures.seconds,
                "peak_memory_mib": figures.peak_memory_mib,
            }
        )
        return
    print("\nVerdict")
    print_verdict(demo.result.verdict_lines)
    print("\nMeasured in this run")
    for line in workflows.figure_lines(demo.figures):
        print(line)
    print("\nWhat you just saw")
    print_paragraphs(workflows.seen_in_words(demo))
    print("\nWhat to do next")
    for line, what in workflows.next_commands(demo.session.path):
        print(f"  {line}\n      {what}")
    print(f"\nreport: {report}")
