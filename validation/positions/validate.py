"""The whole job for a session of positions: compare, write the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rig.session import Session
from validation.positions.compare import PositionComparison, compare_positions
from validation.positions.page import write_page
from validation.report.files import check_folder


def validate_positions(
    session: Session | str | Path,
    out: str | Path | None = None,
    *,
    action: str | None = None,
    identified: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> PositionComparison:
    """Compare the hammer of a session without force with models that its measured key moves, and write a page.

    Parameters
    ----------
    session : Session or path
        Trials hold position sensors of key and hammer.
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``curves/*.csv``; by default that of the session.
    action : str, optional
        Built-in action or file; by default that of the identified set, else ``hirschkorn2004-regulated``.
    identified : path, optional
        ``identified.json``, or a session folder that holds one; by default the session's own, where there is one.
    progress : callable, optional
        Called with a line of text per stroke.

    Returns
    -------
    PositionComparison
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        No stroke is usable, the identified set does not fit, or the folder cannot be written.

    Examples
    --------
    >>> import validation
    >>> result = validation.validate_positions("sessions/kawai_kg3c", "real")
    >>> bool(result.scores.query("model == 'identified'").rmse_share.max() < 0.1)
    True
    """
    opened = session if isinstance(session, Session) else Session.open(session)
    folder = Path(out) if out is not None else opened.path
    check_folder(folder)
    say = progress or (lambda text: None)
    result = compare_positions(opened, action, None if identified is None else Path(identified), say)
    say("writing the report")
    return replace(result, files=write_page(result, folder, opened.path))
