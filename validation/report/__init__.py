"""The report of a comparison: ``report.html``, ``results.json`` and a CSV per table, written whole or not at
all.

Place in the data flow: `SideBySide` → figures, page and tables on disk.
Conventions: SI and radians in files, degrees and millimetres on the page; one report whether one session and model
are compared or several.
Failure: a path that cannot be written is an `InputError`, and nothing new is left behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from validation.cache.report_cache import report_folder
from validation.pipeline.compare_sessions import SideBySide, alone, compare_sessions
from validation.report.files import check_folder, write_files
from validation.result import ValidationResult

__all__ = ["validate_session", "validate_sessions", "write_report"]


def validate_sessions(
    sessions: Sequence[str | Path | Any],
    actions: Sequence[Any] = ("hirschkorn2004",),
    out: str | Path | None = None,
    *,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> SideBySide:
    """Compare every session with every model and write one report.

    Parameters
    ----------
    sessions : sequence of path or rig.session.Session
    actions : sequence of name, path or model action
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``tables/*.csv``; by default that of the session, if it is one.
    progress : callable, optional
        Called with a line of text per step.
    **options
        Passed to `validation.pipeline.compare_sessions.compare_sessions` and on to
        `validation.pipeline.compare_session.compare_session`.

    Returns
    -------
    SideBySide
        With ``files`` naming what was written.

    Raises
    ------
    InputError
        No session can be compared, a session or model is given twice, or the folder cannot be written.
    """
    folder = report_folder(sessions, out)
    check_folder(folder)  # before any work is done
    side = compare_sessions(sessions, actions, progress=progress, **options)
    if progress is not None:
        progress("writing the report")
    return _write(side, folder)


def validate_session(
    session: str | Path | Any, action: Any = "hirschkorn2004", out: str | Path | None = None, **options: Any
) -> ValidationResult:
    """Compare one session with one model and write the report: `validate_sessions` for one of each.

    Returns
    -------
    ValidationResult
        With ``files`` naming what was written.
    """
    return validate_sessions([session], [action], out, **options).results[0]


def write_report(result: ValidationResult | SideBySide, folder: str | Path) -> ValidationResult | SideBySide:
    """Write the report of one result, or of several, into a folder and return it with its file names."""
    if isinstance(result, SideBySide):
        return _write(result, Path(folder))
    return _write(alone(result), Path(folder)).results[0]


def _write(side: SideBySide, folder: Path) -> SideBySide:
    from validation.report.render import render_html
    from validation.report.results import results_json, table_csv

    check_folder(folder)
    texts = {f"tables/{name}.csv": table_csv(table) for name, table in side.tables.items()}
    texts["results.json"] = results_json(side)
    texts["report.html"] = render_html(side)  # last: a page never points at tables that are not there yet
    return side.with_files(write_files(folder, texts))
