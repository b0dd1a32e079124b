"""``pianorig open``: show the report of a session in the browser."""

from __future__ import annotations

import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import SESSIONS, AsJson
from pianorig.console.output import tell
from pianorig.errors import CommandInputError

REPORT = "report.html"


def command(
    session: Annotated[
        Path | None,
        typer.Argument(help="Session, folder of a report, or the file; default: the newest report below sessions/."),
    ] = None,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open it, or only say where it is.")] = True,
    as_json: AsJson = False,
) -> None:
    """Open a session's report in the browser.
    No report is made; its path is printed, too.

    Example:  pianorig open sessions/try
    """
    report = find_report(session)
    opened = False
    if show:
        with suppress(webbrowser.Error):
            opened = webbrowser.open(report.as_uri())
    unseen = "; no browser answered, open this file yourself" if show and not opened else ""
    tell(as_json, {"report": report, "opened": opened}, [f"report: {report}{unseen}"])


def find_report(where: Path | None = None) -> Path:
    """Path of the report's HTML file: in the folder ``where`` (a session or a report's), the file itself, or for None
    the newest below ``sessions/``; CommandInputError where there is none."""
    if where is None:
        reports = sorted(SESSIONS.glob(f"*/{REPORT}"), key=lambda path: path.stat().st_mtime)
        if not reports:
            raise CommandInputError(f"{SESSIONS}: no report below it; name a session, or make one with  pianorig demo")
        return reports[-1].resolve()
    if where.is_file() and where.suffix == ".html":
        return where.resolve()
    if not where.is_dir():
        raise CommandInputError(
            f"{where}: no such folder; allowed a session, a folder with a report, or its .html file"
        )
    report = where / REPORT
    if not report.is_file():
        raise CommandInputError(f"{where}: has no {REPORT} yet; make it with  pianorig validate {where}")
    return report.resolve()
