"""``pianorig record``: play a profile on the bench and record a session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pianorig import workflows
from pianorig.console.options import SELFTESTS, AsJson, Backend, Operator, Profile, Rig, Selftests, Yes, refuse_beside
from pianorig.console.output import tell
from pianorig.console.progress import bar, recording_line
from pianorig.console.terminal import operator as operator_at_terminal
from pianorig.errors import CommandInputError

if TYPE_CHECKING:
    from rig import FeltOrder, RoomInfo


RECORDED = ("out", "trials", "backend", "rig", "operator", "action", "temperature", "humidity")
"""What counts wherever no profile is played."""


def command(
    ctx: typer.Context,
    profile: Profile = "forte",
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create; default: sessions/<date>_<profile>.")
    ] = None,
    trials: Annotated[
        int | None, typer.Option("--trials", help="Number of trials; 5, with --passive until Ctrl-C.")
    ] = None,
    backend: Backend = "sim://",
    rig: Rig = "virtual",
    film: Annotated[
        list[int] | None, typer.Option("--film", help="Film this trial (virtual bench); may be repeated.")
    ] = None,
    operator: Operator = "unknown",
    action: Annotated[str, typer.Option("--action", help="The action on the bench, in words.")] = "unknown",
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Trial plan (TOML) in place of --profile and --trials.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option("--resume", help="Go on with this session: record what its plan still lacks.")
    ] = None,
    temperature: Annotated[float | None, typer.Option("--temperature", help="Of the room, degrees Celsius.")] = None,
    humidity: Annotated[float | None, typer.Option("--humidity", help="Of the room, relative, percent.")] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Reserve and print every task, predict the blow, move nothing.")
    ] = False,
    passive: Annotated[
        bool, typer.Option("--passive", help="Somebody plays: the motor is off, each stroke becomes a trial.")
    ] = False,
    duration: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", help="With --passive: end after so long.")
    ] = None,
    felt: Annotated[
        str | None, typer.Option("--felt", help="The arm presses the felt of this contact, or a steel `block`; no key.")
    ] = None,
    speed: Annotated[
        list[float] | None, typer.Option("--speed", help="With --felt: of the press, m/s; may be repeated.")
    ] = None,
    peak: Annotated[
        list[float] | None, typer.Option("--peak", help="With --felt: largest force, N; may be repeated.")
    ] = None,
    yes: Yes = False,
    selftest: Selftests = SELFTESTS,
    as_json: AsJson = False,
) -> None:
    """Play a motor profile; record force, angles, frame clock.

    On the virtual bench by default; hardware asks for a self-test and a confirmation first, except with --passive,
    where nothing moves. With --felt each press becomes a trial and a loading curve for calibrate felt.

    Example:  pianorig record --profile forte --trials 5 --film 1 --out sessions/try
    """
    if dry_run and felt is not None:
        raise CommandInputError("--felt: a press is shaped from the ramp before it; not with --dry-run")
    if plan is not None:
        refuse_beside(ctx, "--plan", "has its own profiles and trials", *(ctx.params.keys() - {"profile", "trials"}))
    if dry_run and resume is not None:
        raise CommandInputError("--dry-run: rehearses --profile or --plan; --resume rehearses what is left by itself")
    if dry_run and not passive:
        found = workflows.rehearse(profile, rig, backend, plan)
        tell(as_json, found, workflows.rehearsal_lines(found))
        return
    if duration is not None and not passive:
        raise CommandInputError("--for: goes with --passive; a profile has its own duration")
    access = workflows.BenchAccess(rig, backend, yes, operator_at_terminal(), selftest)
    if felt is None and (speed or peak):
        raise CommandInputError("--speed, --peak: go with --felt; a profile has its own forces")
    if felt is not None:
        refuse_beside(ctx, "--felt", "presses no key", "felt", "speed", "peak", "yes", "selftest", *RECORDED)
        order = workflows.felt_order(felt, speed, peak, trials)
        _press_felt(out, order, access, as_json, (operator, action), workflows.room_conditions(temperature, humidity))
        return
    if passive:
        refuse_beside(ctx, "--passive", "plays no profile", "passive", "duration", "yes", "selftest", *RECORDED)
        target, count = out or workflows.new_session_folder("passive"), ""
        title = f"waiting for strokes on {backend}, into {target}; Ctrl-C ends"
        from rig import record_passive  # start-up: 0.5 s of h5py and pandas, which --help does not need

        with workflows.interrupts_told(target), recording_line(as_json, title) as progress:
            session = record_passive(
                target,
                rig_config=rig,
                backend=backend,
                strokes=trials,
                duration_s=duration,
                operator=operator,
                action_name=action,
                progress=progress,
                room=workflows.room_conditions(temperature, humidity),
            )
        rows = [{"trial": t.number, "status": t.status} for t in session.trials]
    elif resume is not None:
        own = "rig, profiles, plan, operator, action and room are the session's own"
        refuse_beside(ctx, "--resume", own, "resume", "backend", "yes", "selftest")
        with workflows.interrupts_told(resume, resumed=True), recording_line(quiet=as_json) as progress:
            session, new = workflows.resume(resume, access, progress)
        rows = [{"trial": n, "status": (t := session.trial(n)).status, "condition": t.read().condition} for n in new]
        target, count = resume, f", {len(session.trials)} trials"
    else:
        target, count = out or workflows.new_session_folder(profile if plan is None else plan.stem), ""
        title = f"recording {profile if plan is None else plan} on {backend} into {target}"
        with (
            workflows.interrupts_told(target),
            bar("filming", quiet=as_json) as film_progress,
            recording_line(as_json, title) as progress,
        ):
            session, _ = workflows.record(
                target,
                access,
                profile=profile,
                trials=5 if trials is None else trials,
                plan_file=plan,
                film=film or (),
                film_progress=film_progress,
                operator=operator,
                action_name=action,
                progress=progress,
                room=workflows.room_conditions(temperature, humidity),
            )
        rows = [
            {"trial": t.number, "status": t.status, "film": t.film.name if t.film else None} for t in session.trials
        ]
    lines = []
    for row in rows:
        more = f", {row['condition']}" if row.get("condition") else f", film {row['film']}" if row.get("film") else ""
        lines.append(f"trial {row['trial']}: {row['status']}{more}")
    tell(as_json, {"session": target, "trials": rows}, [*lines, f"session: {target}{count}"])


def _press_felt(
    out: Path | None,
    order: FeltOrder,
    access: workflows.BenchAccess,
    as_json: bool,
    named: tuple[str, str],
    room: RoomInfo | None,
) -> None:
    target = out or workflows.new_session_folder(f"felt_{order.contact}")
    title = f"pressing {order.contact} on {access.backend} into {target}"
    with workflows.interrupts_told(target), recording_line(as_json, title) as progress:
        _, facts = workflows.press_felt(
            target, order, access, operator=named[0], action_name=named[1], progress=progress, room=room
        )
    tell(as_json, {"session": target, **facts}, [*workflows.felt_lines(order, facts), f"session: {target}"])
