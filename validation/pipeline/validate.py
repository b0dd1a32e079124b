"""The whole job: compare sessions with models and write one report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import model
from rig.session import Session
from validation.cache.report_cache import report_folder
from validation.options import CompareOptions, ComparisonOptions
from validation.pipeline.compare_sessions import compare_many
from validation.report.files import check_folder
from validation.report.write import write_side_by_side
from validation.result import ValidationResult
from validation.side_by_side import SideBySide


def validate_sessions(
    sessions: Sequence[Session | str | Path],
    actions: Sequence[model.Action | str | Path] = ("hirschkorn2004",),
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> SideBySide:
    """Compare every session with every model and write one report.

    Parameters
    ----------
    sessions : sequence of Session or path
    actions : sequence of name, path or model.Action
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``tables/*.csv``; by default that of the session, if it is one.
    **options
        Those of `validation.compare`.

    Returns
    -------
    SideBySide
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        No session can be compared, a session or model is given twice, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> side = validation.validate_sessions(["sessions/example_forte"], out="report", budget=False, suspect=False)
    >>> side.files["report.html"].name
    'report.html'
    """
    chosen = ComparisonOptions.of(options)
    folder = report_folder([s.path if isinstance(s, Session) else s for s in sessions], out)
    check_folder(folder)  # before any work is done
    side = compare_many(sessions, actions, **options)
    chosen.say("writing the report")
    return write_side_by_side(side, folder)


def validate_session(
    session: Session | str | Path,
    action: model.Action | str | Path = "hirschkorn2004",
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> ValidationResult:
    """Compare one session with one model and write the report: `validate_sessions` for one of each.

    Parameters
    ----------
    session : Session or path
    action : name, path or model.Action
    out : path, optional
        Folder for the report; by default that of the session.
    **options
        Those of `validation.compare`.

    Returns
    -------
    ValidationResult
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        The session cannot be compared, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> result = validation.validate_session("sessions/example_forte", out="one", budget=False, suspect=False)
    >>> "report.html" in result.files
    True
    """
    return validate_sessions([session], [action], out, **options).results[0]
