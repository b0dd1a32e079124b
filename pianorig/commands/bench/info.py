"""``pianorig info``: what a session holds, what answers at a backend, or which versions are installed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    session: Annotated[Path | None, typer.Argument(help="Session folder; without one: versions.")] = None,
    backend: Annotated[
        str | None, typer.Option("--backend", help="Show what answers at sim://, ni://local or ni-grpc://host:31763.")
    ] = None,
    rig: Annotated[str, typer.Option("--rig", help="Built-in rig or a TOML file, with --backend.")] = "virtual",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show the trials of a session, what answers at a backend, or the versions of everything this tool rests on.

    Example:  pianorig info sessions/2026-11-21_forte_key52
    Example:  pianorig info --backend sim:// --rig pcie6363
    """
    from pianorig.console.output import print_json
    from pianorig.workflows.bench.info import session_facts, versions

    if backend is not None:
        from pianorig.workflows.bench.dry_run import backend_facts

        facts = backend_facts(backend, rig)
    else:
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
