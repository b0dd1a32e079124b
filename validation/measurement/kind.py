"""Whether a session is one of positions alone: said by its ``session.toml``, so that nothing heavy need be imported."""

from __future__ import annotations

import tomllib
from pathlib import Path

FORCE, NOT_RECORDED = "force", "not recorded"
"""Note of a session that was imported without a force."""


def has_positions_only(session: str | Path) -> bool:
    """Whether no force was recorded in a session.

    Parameters
    ----------
    session : path

    Returns
    -------
    bool
        False also for what is no session, which the comparison names.

    Examples
    --------
    >>> import validation
    >>> validation.has_positions_only("sessions/kawai_kg3c"), validation.has_positions_only("sessions/example_forte")
    (True, False)
    """
    try:
        text = (Path(session) / "session.toml").read_text(encoding="utf-8-sig")
        notes = tomllib.loads(text).get("notes", {})
    except (OSError, ValueError):
        return False
    return isinstance(notes, dict) and notes.get(FORCE) == NOT_RECORDED
