"""``pianorig open``: show the report of a session in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import print_json


def command(
    session: Annotated[
        Path | None,
        typer.Argument(help="Session, folder of a report, or the file; default: the newest report below sessions/."),
    ] = None,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open it, or only say where it is.")] = True,
    as_json: AsJson = False,
) -> None:
    """Open a session's report in the browser.

    Example:  pianorig open sessions/try
    """
    report = workflows.find_report(session)
    opened = show and workflows.show_in_browser(report)
    if as_json:
        print_json({"report": report, "opened": opened})
    else:
        print(f"report: {report}" + ("" if opened or not show else "; no browser answered, open this file yourself"))
