"""``pianorig recover``: make trials out of what a cut-off recording left behind."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import rig
from pianorig.console.options import AsJson
from pianorig.console.output import print_json, tell
from pianorig.errors import CommandInputError


def command(
    session: Annotated[Path | None, typer.Argument(help="Session folder whose recording was cut off.")] = None,
    server: Annotated[
        str | None,
        typer.Option(
            "--reset-server",
            metavar="ADDRESS",
            help="End all sessions of the server at ni-grpc://host:port, of whomever; outputs keep their values.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create for the result; the first is left as it is.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Rebuild unsealed trials from the journals of a recording.
    Each trial is rebuilt up to the last good record of its journal, which is removed then; with --out in a copy.

    On a gRPC server a killed program leaves its
    sessions: the next  record  frees those of its own rig;  --reset-server  is for those of another rig or computer.

    Example:  pianorig recover sessions/try
    """
    if session is None and server is None:
        raise CommandInputError("recover: name a session folder, or give --reset-server ADDRESS")
    if server is not None:
        target = rig.reset_server(server)
        if not as_json:
            print(f"{target}: all sessions ended; check that the outputs are safe")
        elif session is None:
            print_json({"server": target, "reset": True})
    if session is None:
        if out is not None:
            raise CommandInputError("--out: goes with a session folder to recover")
        return
    rows = [asdict(trial) for trial in rig.recover(session, out)]
    lines = [f"trial {row['trial']}: {row['status']}, {row['samples']} samples; {row['note']}" for row in rows]
    facts = {"session": session if out is None else out, "trials": rows}
    tell(as_json, facts, lines or [f"{session}: nothing to recover, every trial is sealed"])
