"""``pianorig recover``: make trials out of what a cut-off recording left behind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    session: Annotated[Path, typer.Argument(help="Session folder whose recording was cut off.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Rebuild the trials of a session that were never sealed, from their journals, up to the last good record.

    Example:  pianorig recover sessions/2026-11-21_forte
    """
    from dataclasses import asdict

    from pianorig.console.output import print_json
    from rig.recording.recover import recover_session

    found = recover_session(session)
    if as_json:
        print_json({"session": session, "trials": [asdict(entry) for entry in found]})
        return
    for entry in found:
        print(f"trial {entry.trial}: {entry.status}, {entry.samples} samples; {entry.note}")
    if not found:
        print(f"{session}: nothing to recover, every trial is sealed")
