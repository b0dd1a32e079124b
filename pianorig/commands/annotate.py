"""``pianorig annotate``: note something about a trial, reject it with a reason, or accept it again."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

import rig
from pianorig.console.options import AsJson
from pianorig.console.output import tell
from pianorig.errors import CommandInputError


def command(
    session: Annotated[Path, typer.Argument(help="Session folder.")],
    trial: Annotated[int, typer.Option("--trial", help="Number of the trial; 0 is the whole session (notes).")] = 0,
    note: Annotated[str | None, typer.Option("--note", help="Something to remember.")] = None,
    reject: Annotated[str | None, typer.Option("--reject", help="Reject the trial; the text is the reason.")] = None,
    accept: Annotated[str | None, typer.Option("--accept", help="Take a rejection back; the text says why.")] = None,
    author: Annotated[str, typer.Option("--author", help="Who writes this.")] = "unknown",
    as_json: AsJson = False,
) -> None:
    """Add a line to a session's annotations, or list them.
    With --note, --reject or --accept a line is added; all are printed in any case. Trials are never changed or deleted.

    Example:  pianorig annotate sessions/try --trial 3 --reject "cable touched the whippen"
    """
    texts: dict[Literal["note", "reject", "accept"], str | None] = {"note": note, "reject": reject, "accept": accept}
    given = [(kind, text) for kind, text in texts.items() if text is not None]
    if len(given) > 1:
        raise CommandInputError("--note, --reject and --accept: allowed is one at a time")
    opened = rig.Session.open(session, require_trials=False)
    for kind, text in given:
        if kind == "accept" and trial and opened.trial(trial).rejected is None:
            raise CommandInputError(f"{session}: trial {trial} is not rejected; nothing to accept")
        opened.annotate(trial, kind, text, author=author)
    facts = {"session": session, "annotations": [asdict(entry) for entry in opened.annotations]}
    lines = [
        f"{e.time_utc}  {f'trial {e.trial}' if e.trial else 'session'}: {e.kind}, {e.reason} ({e.author})"
        for e in opened.annotations
    ]
    tell(as_json, facts, lines or [f"{session}: no annotations"])
