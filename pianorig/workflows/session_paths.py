"""Where sessions go when no folder is named."""

from __future__ import annotations

from datetime import date
from pathlib import Path

SESSIONS = Path("sessions")


def new_session_folder(profile: str, today: date | None = None, root: Path = SESSIONS) -> Path:
    """``sessions/<date>_<profile>``, with ``_2``, ``_3`` … where that is taken."""
    stem = f"{today or date.today():%Y-%m-%d}_{Path(profile).stem}"
    folder = root / stem
    number = 2
    while folder.exists():
        folder = root / f"{stem}_{number}"
        number += 1
    return folder
