"""The report of a comparison: ``report.html``, ``results.json`` and a CSV per table, written whole or not at
all.

Place in the data flow: `ValidationResult` → figures, page and tables on disk.
Conventions: SI and radians in files, degrees and millimetres on the page.
Failure: a path that cannot be written is an `InputError`, and nothing new is left behind.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from validation.report.files import check_folder, write_files
from validation.result import ValidationResult

__all__ = ["validate_session", "write_report"]


def validate_session(
    session_path: str | Path | Any,
    action: Any = "hirschkorn2004",
    out: str | Path | None = None,
    *,
    tolerance: float = 1e-5,
    predict: Callable[..., Any] | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> ValidationResult:
    """Compare a session with a model and write the report.

    Parameters
    ----------
    session_path : path or rig.session.Session
    action : name, path or model action
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``tables/*.csv``; by default the session's own
        folder.
    tolerance : float
        Requested largest error of any predicted angle, rad.
    predict : callable, optional
        Stand-in for ``model.simulate``.
    progress : callable, optional
        Called with a line of text per step.
    **options
        Passed to `validation.comparison.compare_session`.

    Returns
    -------
    ValidationResult
        With ``files`` naming what was written.

    Raises
    ------
    InputError
        When the session cannot be read, no trial is usable, or the folder cannot be written.
    """
    from validation.comparison import compare_session, open_session

    if out is not None:
        check_folder(Path(out))  # before any work is done
    session = open_session(session_path)
    folder = Path(out) if out is not None else Path(session.path)
    check_folder(folder)
    result = compare_session(session, action, tolerance=tolerance, predict=predict, progress=progress, **options)
    if progress is not None:
        progress("writing the report")
    return write_report(result, folder)


def write_report(result: ValidationResult, folder: str | Path) -> ValidationResult:
    """Write the report of a result into a folder and return the result with its file names."""
    from validation.report.render import render_html
    from validation.report.results import results_json, table_csv

    target = Path(folder)
    check_folder(target)
    texts = {f"tables/{name}.csv": table_csv(table) for name, table in result.tables.items()}
    texts["results.json"] = results_json(result)
    texts["report.html"] = render_html(result)  # last: a page never points at tables that are not there yet
    return result.with_files(write_files(target, texts))
