"""``pianorig info``: what a session holds, or which versions are installed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    session: Annotated[Path | None, typer.Argument(help="Session folder; without one: versions.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show the trials of a session, or the versions of everything this tool rests on.

    Example:  pianorig info sessions/2026-11-21_forte_key52
    """
    from ..inspection import session_facts, versions
    from ..output import print_json

    facts = versions() if session is None else session_facts(session)
    if as_json:
        print_json(facts)
        return
    for key, value in facts.items():
        if isinstance(value, list):
            for row in value:
                print("  " + "  ".join(f"{k} {v}" for k, v in row.items()))
        else:
            print(f"{key:<16} {value}")
