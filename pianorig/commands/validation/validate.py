"""``pianorig validate``: compare sessions with models and write one report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from validation import SideBySide

DEFAULT_ACTION = "hirschkorn2004"


def command(
    sessions: Annotated[list[Path], typer.Argument(help="Session folders.", metavar="SESSION…")],
    action: Annotated[
        list[str] | None,
        typer.Option("--action", help=f"Built-in action or a TOML file; may be repeated.  [default: {DEFAULT_ACTION}]"),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Parameter to change in every action, path=value; may be repeated."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the report; default: that of the only session.")
    ] = None,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Largest error of any predicted angle, rad.")] = 1e-5,
    by_motion: Annotated[
        bool, typer.Option("--by-motion/--no-by-motion", help="Also predict the force from the key's motion.")
    ] = True,
    condition: Annotated[
        str | None,
        typer.Option("--condition", help="Condition of the trial plan to keep to; default: each stands for itself."),
    ] = None,
    again: Annotated[
        bool,
        typer.Option(
            "--again", help="Make the report again though nothing has changed; known predictions and scores are used."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Drive every model with each trial's own force and report how well it predicts the angles.

    Several sessions and several models stand side by side in one report; they are never pooled.

    Example:  pianorig validate sessions/2026-11-21_forte_key52 --action hirschkorn2004

    Example:  pianorig validate sessions/forte sessions/piano --action hirschkorn2004 --action mine.toml --out report
    """
    from pianorig.console.output import print_json, print_verdict
    from validation.cache.report_cache import inputs_sha256, report_folder, store_report, stored_report

    folder = report_folder(sessions, out)
    actions = action or [DEFAULT_ACTION]
    options = {"set": set_ or [], "tolerance": tolerance, "by_motion": by_motion, "condition": condition}
    inputs = inputs_sha256(sessions, actions, options)
    kept = None if again else stored_report(folder, inputs)
    refused: tuple[str, ...] = ()
    if kept is not None:
        verdict, files, reused = kept.verdict_lines, kept.files, f"everything, as made {kept.made_utc}"
    else:
        side = _validate(
            sessions, actions, set_ or [], folder, quiet=as_json,
            tolerance=tolerance, by_motion=by_motion, condition=condition,
        )  # fmt: skip
        verdict, files, refused, reused = side.verdict_lines, side.files, side.refused, _reused(side)
        # what could not be read is to be named again, and what changed meanwhile to be read again
        if not refused and inputs_sha256(sessions, actions, options) == inputs:
            note = store_report(folder, inputs, files, verdict, side.results[0].provenance["created_utc"])
            reused += f"; {note}" if note else ""
    if as_json:
        names = {k: str(v) for k, v in files.items()}
        print_json({"verdict": " ".join(verdict), "files": names, "reused": reused, "refused": list(refused)})
    else:
        print_verdict(verdict)
        print(f"reused: {reused}")
        print(f"report: {files['report.html']}")
    if refused:
        raise typer.Exit(2)


def _validate(
    sessions: list[Path], actions: list[str], settings: list[str], folder: Path, *, quiet: bool, **options: Any
) -> SideBySide:
    import model
    import validation
    from pianorig.console.overrides import read_settings
    from pianorig.console.progress import say

    changes = read_settings(settings)
    chosen = [model.load_action(action, changes) for action in actions]
    return validation.validate_sessions(sessions, chosen, folder, progress=None if quiet else say, **options)


def _reused(side: SideBySide) -> str:
    """What was not made again, for every session and model."""
    texts = []
    for result in side.results:
        counts = ", ".join(f"{kind} {count}" for kind, count in result.provenance["reused"].items())
        texts.append(counts if len(side.results) == 1 else f"{result.session_name}, {result.action_name}: {counts}")
    return "; ".join(texts)
