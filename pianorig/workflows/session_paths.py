"""Where sessions go, and which is meant, when no folder is named."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from pianorig.console.options import SESSIONS
from pianorig.errors import CommandInputError


def new_session_folder(profile: str, today: date | None = None, root: Path = SESSIONS) -> Path:
    """``sessions/<date>_<profile>``, with ``_2``, ``_3`` … where that is taken."""
    stem = f"{today or date.today():%Y-%m-%d}_{Path(profile).stem}"
    folder = root / stem
    number = 2
    while folder.exists():
        folder = root / f"{stem}_{number}"
        number += 1
    return folder


def session_folder(named: Path | None, sessions: Path = SESSIONS) -> Path:
    """The session named, else the working folder if it is one, else the newest below ``sessions/``."""
    if named is not None:
        return named
    if Path("session.toml").is_file():
        return Path()
    found = [file.parent for file in sessions.glob("*/session.toml")]
    if not found:
        raise CommandInputError(f"no session named, and none in {sessions}; name the session folder")
    return max(found, key=lambda folder: (folder / "session.toml").stat().st_mtime)
