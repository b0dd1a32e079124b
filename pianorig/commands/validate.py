"""``pianorig validate``: compare a session with the model and write the report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    session: Annotated[Path, typer.Argument(help="Session folder.")],
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the report; default: the session's.")] = None,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Largest error of any predicted angle, rad.")] = 1e-5,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Drive the model with each trial's own force and report how well it predicts the angles.

    Example:  pianorig validate sessions/2026-11-21_forte_key52 --action hirschkorn2004
    """
    import model
    import validation

    from ..output import print_json, print_verdict
    from ..progress import say
    from ..settings import read_settings

    chosen = model.load_action(action, read_settings(set_ or []))
    result = validation.validate_session(session, chosen, out, tolerance=tolerance, progress=None if as_json else say)
    if as_json:
        print_json({"verdict": result.verdict, "files": {k: str(v) for k, v in result.files.items()}})
        return
    print_verdict(result.verdict_lines)
    print(f"report: {result.files['report.html']}")
