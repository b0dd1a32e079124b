"""Reports that have been written: finding one, and showing it in the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from pianorig.errors import CommandInputError
from pianorig.workflows.session_paths import SESSIONS

REPORT = "report.html"


def find_report(where: Path | None = None) -> Path:
    """The report in a folder, the file itself, or the newest one below ``sessions/``.

    Raises
    ------
    CommandInputError : there is none, with the command that makes it
    """
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


def show_in_browser(report: Path) -> bool:
    """Ask the system's browser to show a file; False where no browser answers."""
    try:
        return webbrowser.open(report.as_uri())
    except webbrowser.Error:
        return False
