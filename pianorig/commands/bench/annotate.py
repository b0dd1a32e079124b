"""``pianorig annotate``: note something about a trial, reject it with a reason, or take it back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    session: Annotated[Path, typer.Argument(help="Session folder.")],
    trial: Annotated[int, typer.Option("--trial", help="Number of the trial; 0 is the whole session (notes).")] = 0,
    note: Annotated[str | None, typer.Option("--note", help="Something to remember.")] = None,
    reject: Annotated[str | None, typer.Option("--reject", help="Reject the trial; the text is the reason.")] = None,
    accept: Annotated[str | None, typer.Option("--accept", help="Take a rejection back; the text says why.")] = None,
    author: Annotated[str, typer.Option("--author", help="Who says so.")] = "unknown",
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list of all annotations.")] = False,
) -> None:
    """Add a line to a session's annotations, or list them; trials are never changed or deleted.

    Example:  pianorig annotate sessions/2026-11-21_forte --trial 3 --reject "cable touched the whippen"
    """
    from dataclasses import asdict

    from pianorig.console.output import print_json
    from pianorig.errors import InputError
    from rig.session import Session
    from rig.session.annotation_file import Kind

    texts: dict[Kind, str | None] = {"note": note, "reject": reject, "accept": accept}
    given: list[tuple[Kind, str]] = [(kind, text) for kind, text in texts.items() if text is not None]
    if len(given) > 1:
        raise InputError("--note, --reject and --accept: allowed is one at a time")
    folder = Session.open(session, require_trials=False)
    for kind, text in given:
        standing = folder.trial(trial).rejected if kind == "accept" and trial else None
        if kind == "accept" and trial and standing is None:
            raise InputError(f"{session}: trial {trial} is not rejected; nothing to take back")
        folder.annotate(trial, kind, text, author=author)
    if as_json:
        print_json({"session": session, "annotations": [asdict(entry) for entry in folder.annotations]})
        return
    for entry in folder.annotations:
        what = f"trial {entry.trial}" if entry.trial else "session"
        print(f"{entry.time_utc}  {what}: {entry.kind}, {entry.reason} ({entry.author})")
    if not folder.annotations:
        print(f"{session}: no annotations")
