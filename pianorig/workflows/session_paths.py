"""Where sessions go, and which is meant, when no folder is named."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from pianorig.console.options import SESSIONS
from pianorig.errors import CommandInputError


def new_session_folder(profile: str, today: date | None = None, root: Path = SESSIONS) -> Path:
    """Path ``<root>/<date>_<profile>`` that does not exist yet, with ``_2``, ``_3``, … where it does; nothing is
    created. Of a profile's path the name counts; ``today`` None: the date of the computer."""
    stem = f"{today or date.today():%Y-%m-%d}_{Path(profile).stem}"
    folder = root / stem
    number = 2
    while folder.exists():
        folder = root / f"{stem}_{number}"
        number += 1
    return folder


def session_folder(named: Path | None, sessions: Path = SESSIONS) -> Path:
    """Folder of the session: ``named`` as it is, else the working folder if it is one, else the one changed last below
    ``sessions``; CommandInputError where there is none."""
    if named is not None:
        return named
    if Path("session.toml").is_file():
        return Path()
    found = [file.parent for file in sessions.glob("*/session.toml")]
    if not found:
        raise CommandInputError(f"no session named, and none in {sessions}; name the session folder")
    return max(found, key=lambda folder: (folder / "session.toml").stat().st_mtime)
