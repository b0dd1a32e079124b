"""``pianorig record``: play a profile on the bench and record a session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pianorig.console.options import Backend, Rig, Selftests, Yes
from pianorig.errors import InputError

if TYPE_CHECKING:
    from rig.session.info import RoomInfo


def command(
    profile: Annotated[str, typer.Option("--profile", help="forte, piano, double, or a TOML file.")] = "forte",
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create; default: sessions/<date>_<profile>.")
    ] = None,
    trials: Annotated[int, typer.Option("--trials", help="Number of trials.")] = 5,
    backend: Backend = "sim://",
    rig: Rig = "virtual",
    film: Annotated[
        list[int] | None, typer.Option("--film", help="Film this trial (virtual bench); may be repeated.")
    ] = None,
    operator: Annotated[str, typer.Option("--operator", help="Who records.")] = "unknown",
    action: Annotated[str, typer.Option("--action", help="What stands on the bench.")] = "unknown",
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Trial plan (TOML) in place of --profile and --trials.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option("--resume", help="Go on with this session: what its plan still lacks.")
    ] = None,
    temperature: Annotated[float | None, typer.Option("--temperature", help="Of the room, degrees Celsius.")] = None,
    humidity: Annotated[float | None, typer.Option("--humidity", help="Of the room, relative, percent.")] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Reserve and print every task, predict the blow, move nothing.")
    ] = False,
    yes: Yes = False,
    selftest: Selftests = Path("selftests"),
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Play a motor profile, record force, angles and frame clock; on the virtual bench by default.

    Example:  pianorig record --profile forte --trials 5 --film 1 --out sessions/try
    """
    if dry_run:
        from pianorig.workflows.bench.dry_run import print_rehearsal

        print_rehearsal(profile, rig, backend, as_json=as_json)
        return
    if resume is not None:
        if plan is not None or out is not None or film:
            raise InputError("--resume: rig, profiles and plan are the session's own; not with --plan, --out or --film")
        _resume(resume, backend, yes, selftest, as_json)
        return
    from pianorig.console.output import print_json
    from pianorig.console.progress import bar, recording_line
    from pianorig.console.prompt import operator as asked
    from pianorig.workflows.bench.record import record
    from pianorig.workflows.session_paths import new_session_folder

    target = out if out is not None else new_session_folder(profile if plan is None else plan.stem)
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
            ask=asked(),
            selftests=selftest,
            plan=plan,
            room=None if temperature is None and humidity is None else _room(temperature, humidity),
        )
    rows = [{"trial": t.number, "status": t.status, "film": t.film.name if t.film else None} for t in session.trials]
    if as_json:
        print_json({"session": session.path, "trials": rows})
        return
    for row in rows:
        print(f"trial {row['trial']}: {row['status']}" + (f", film {row['film']}" if row["film"] else ""))
    print(f"session: {session.path}")


def _room(temperature_c: float | None, humidity_percent: float | None) -> RoomInfo:
    from rig.configuration.toml_file import check
    from rig.session.info import RoomInfo

    named = {"temperature_c": temperature_c, "relative_humidity_percent": humidity_percent}
    return check(RoomInfo, {key: v for key, v in named.items() if v is not None}, "--temperature, --humidity")


def _resume(session: Path, backend: str, yes: bool, selftest: Path, as_json: bool) -> None:
    from pianorig.console.output import print_json
    from pianorig.console.progress import recording_line
    from pianorig.console.prompt import operator as asked
    from pianorig.workflows.bench.resume import resume

    with recording_line(quiet=as_json) as progress:
        opened, new = resume(session, backend=backend, progress=progress, yes=yes, ask=asked(), selftests=selftest)
    rows = [{"trial": n, "status": (t := opened.trial(n)).status, "condition": t.read().condition} for n in new]
    if as_json:
        print_json({"session": session, "trials": rows})
        return
    for row in rows:
        print(f"trial {row['trial']}: {row['status']}" + (f", {row['condition']}" if row["condition"] else ""))
    print(f"session: {session}, {len(opened.trials)} trials")
