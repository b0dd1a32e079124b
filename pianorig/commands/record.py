"""``pianorig record``: play a profile on the bench and record a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    profile: Annotated[str, typer.Option("--profile", help="forte, piano, double, or a TOML file.")] = "forte",
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create; default: sessions/<date>_<profile>.")
    ] = None,
    trials: Annotated[int, typer.Option("--trials", help="Number of trials.")] = 5,
    backend: Annotated[str, typer.Option("--backend", help="sim://, ni://local or ni-grpc://host:31763.")] = "sim://",
    rig: Annotated[str, typer.Option("--rig", help="Built-in rig or a TOML file.")] = "virtual",
    film: Annotated[
        list[int] | None, typer.Option("--film", help="Film this trial (virtual bench); may be repeated.")
    ] = None,
    operator: Annotated[str, typer.Option("--operator", help="Who records.")] = "unknown",
    action: Annotated[str, typer.Option("--action", help="What stands on the bench.")] = "unknown",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Reserve and print every task, predict the blow, move nothing.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="On ni*://: do not ask, where safety.allow_yes of the rig file permits.")
    ] = False,
    selftest: Annotated[
        Path, typer.Option("--selftest", help="On ni*://: record of a self-test, or the folder of them.")
    ] = Path("selftests"),
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Play a motor profile, record force, angles and frame clock; on the virtual bench by default.

    Example:  pianorig record --profile forte --trials 5 --film 1 --out sessions/try
    """
    if dry_run:
        from ..rehearsal import print_rehearsal

        print_rehearsal(profile, rig, backend, as_json=as_json)
        return
    from ..asking import type_answer
    from ..output import print_json
    from ..progress import bar, recording_line
    from ..recording import record
    from ..sessions import new_session_folder

    target = out if out is not None else new_session_folder(profile)
    with bar("filming", quiet=as_json) as film_progress, recording_line(quiet=as_json) as progress:
        session, _, _ = record(
            target,
            profile=profile,
            rig=rig,
            backend=backend,
            trials=trials,
            film=film or (),
            operator=operator,
            action_name=action,
            progress=progress,
            film_progress=film_progress,
            yes=yes,
            ask=type_answer,
            selftests=selftest,
        )
    rows = [{"trial": t.number, "status": t.status, "film": t.film.name if t.film else None} for t in session.trials]
    if as_json:
        print_json({"session": session.path, "trials": rows})
        return
    for row in rows:
        print(f"trial {row['trial']}: {row['status']}" + (f", film {row['film']}" if row["film"] else ""))
    print(f"session: {session.path}")
