"""A session in which nothing was recorded leaves no folder behind."""

from __future__ import annotations

import shutil

from rig.safety.interrupts import deferred
from rig.session.folder import Session


def discard_empty(session: Session, existed: bool) -> None:
    """Remove a session that has neither trials nor journals; a folder that was there before stays, empty."""
    with deferred():
        if session.trials or session.journals:
            return
        if not existed:
            shutil.rmtree(session.path, ignore_errors=True)
        elif session.path.is_dir():
            for path in session.path.iterdir():
                path.unlink()
