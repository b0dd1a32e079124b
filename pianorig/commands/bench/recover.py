"""``pianorig recover``: make trials out of what a cut-off recording left behind."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import rig
from pianorig.console.options import AsJson
from pianorig.console.output import print_json


def command(
    session: Annotated[Path, typer.Argument(help="Session folder whose recording was cut off.")],
    as_json: AsJson = False,
) -> None:
    """Rebuild unsealed trials from the journals of a recording.

    Each trial is rebuilt up to the last good record of its journal.

    Example:  pianorig recover sessions/2026-11-21_forte
    """
    rows = [asdict(trial) for trial in rig.recover(session)]
    if as_json:
        print_json({"session": session, "trials": rows})
        return
    for row in rows:
        print(f"trial {row['trial']}: {row['status']}, {row['samples']} samples; {row['note']}")
    if not rows:
        print(f"{session}: nothing to recover, every trial is sealed")
