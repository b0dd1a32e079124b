"""``pianorig record``: play a profile on the bench and record a session."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

import typer

import model
import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import (
    SELFTESTS,
    AsJson,
    Backend,
    Figure,
    Operator,
    Profile,
    Rig,
    Selftests,
    Yes,
    refuse_beside,
)
from pianorig.console.output import file_lines, table_lines, tell
from pianorig.console.progress import bar, recording_line
from pianorig.console.terminal import operator as operator_at_terminal
from pianorig.errors import CommandInputError

if TYPE_CHECKING:
    from rig.recording.options import RecordingKeywords

SIMULATED = "sim://"
BLOCK = "block"
RIG_NAME = "rig_with_compliance.toml"
RECORDED = ("out", "trials", "backend", "rig_name", "operator", "action", "temperature", "humidity")
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
    rig_name: Rig = "virtual",
    film: Annotated[
        list[int] | None, typer.Option("--film", help="Film this trial (virtual bench); may be repeated.")
    ] = None,
    operator: Operator = "unknown",
    action: Annotated[
        str,
        typer.Option(
            "--action",
            help="The action on the bench, in words; or its model, a built-in name or a TOML file: each trial is then "
            "compared with it as soon as it is recorded, in a process of its own.",
        ),
    ] = "unknown",
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
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Play a motor profile; record force, angles, frame clock.
    Trials go into a new session folder (--resume: the session's own), each sealed when it ends. On the virtual bench by
    default; hardware asks for a self-test and a confirmation first, except with --passive, where nothing moves.

    With --felt each press becomes a trial and a loading curve for calibrate felt.

    Example:  pianorig record --profile forte --trials 5 --film 1 --out sessions/try
    Example:  pianorig record --profile forte --trials 5 --action hirschkorn2004 --out sessions/judged
    """
    check_writable(figure, *FIGURE_ENDINGS)
    if dry_run and figure is not None:
        raise CommandInputError("--figure: draws what was recorded; not with --dry-run")
    if dry_run and felt is not None:
        raise CommandInputError("--felt: a press is shaped from the ramp before it; not with --dry-run")
    if plan is not None:
        refuse_beside(ctx, "--plan", "has its own profiles and trials", *(ctx.params.keys() - {"profile", "trials"}))
    if dry_run and resume is not None:
        raise CommandInputError("--dry-run: rehearses --profile or --plan; --resume rehearses what is left by itself")
    if dry_run and not passive:
        found = workflows.rehearse(profile, rig_name, backend, plan)
        tell(as_json, found, workflows.rehearsal_lines(found))
        return
    if duration is not None and not passive:
        raise CommandInputError("--for: goes with --passive; a profile has its own duration")
    access = workflows.BenchAccess(rig_name, backend, yes, operator_at_terminal(), selftest)
    if felt is None and (speed or peak):
        raise CommandInputError("--speed, --peak: go with --felt; a profile has its own forces")
    if felt is not None:
        refuse_beside(ctx, "--felt", "presses no key", "felt", "speed", "peak", "yes", "selftest", *RECORDED)
        order = felt_order(felt, speed, peak, trials)
        _press_felt(out, order, access, as_json, (operator, action), workflows.room_conditions(temperature, humidity))
        return
    if passive:
        refuse_beside(
            ctx, "--passive", "plays no profile", "passive", "duration", "yes", "selftest", "figure", *RECORDED
        )
        target, count = out or workflows.new_session_folder("passive"), ""
        title = f"waiting for strokes on {backend}, into {target}; Ctrl-C ends"
        with (
            workflows.report_interrupt(target),
            workflows.judge_during_recording(target, action, as_json),
            recording_line(as_json, title) as progress,
        ):
            session = rig.record_passive(
                target,
                rig_config=rig_name,
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
        refuse_beside(ctx, "--resume", own, "resume", "backend", "yes", "selftest", "figure")
        with workflows.report_interrupt(resume, resumed=True), recording_line(quiet=as_json) as progress:
            session, new = workflows.resume(resume, access, progress)
        rows = [{"trial": n, "status": (t := session.trial(n)).status, "condition": t.read().condition} for n in new]
        target, count = resume, f", {len(session.trials)} trials"
    else:
        target, count = out or workflows.new_session_folder(profile if plan is None else plan.stem), ""
        title = f"recording {profile if plan is None else plan} on {backend} into {target}"
        with (
            workflows.report_interrupt(target),
            workflows.judge_during_recording(target, action, as_json),
            bar("filming", quiet=as_json) as film_progress,
            recording_line(as_json, title) as progress,
        ):
            session, _ = workflows.record(
                target,
                access,
                profile=profile,
                trials=5 if trials is None else trials,  # as rig.record
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
    shown = [
        (f"trial {row['trial']}", str(row["status"]), str(row.get("condition") or row.get("film") or ""))
        for row in rows
    ]
    complete = sum(row["status"] == "complete" for row in rows)
    lines = [
        *(table_lines(("recorded", "status", "condition, film"), shown) if shown else []),
        f"{complete} of {len(rows)} complete",
    ]
    if figure is not None:
        workflows.draw_session(rig.Session.open(target), figure)
    facts = {"session": target, "trials": rows} | ({"figure": figure} if figure is not None else {})
    tell(as_json, facts, [*lines, *file_lines([figure]), f"session: {target}{count}"])


def _press_felt(
    out: Path | None,
    order: rig.FeltOrder,
    access: workflows.BenchAccess,
    as_json: bool,
    operator_and_action: tuple[str, str],
    room: rig.RoomInfo | None,
) -> None:
    """Record the ordered presses of a felt into ``out`` (None: a new folder below ``sessions/``) and print what was
    found; ``operator_and_action``: their names, in this order."""
    target = out or workflows.new_session_folder(f"felt_{order.contact}")
    title = f"pressing {order.contact} on {access.backend} into {target}"
    with workflows.report_interrupt(target), recording_line(as_json, title) as progress:
        _, facts = press_felt(
            target,
            order,
            access,
            operator=operator_and_action[0],
            action_name=operator_and_action[1],
            progress=progress,
            room=room,
        )
    tell(as_json, {"session": target, **facts}, [*felt_lines(order, facts), f"session: {target}"])


def press_felt(
    out: Path, order: rig.FeltOrder, access: workflows.BenchAccess, **keywords: Unpack[RecordingKeywords]
) -> tuple[rig.FeltSession, dict[str, Any]]:
    """Record the ordered presses of a felt, or of the steel block, into the session ``out``; return the session and the
    facts to print: of each press, or the compliance of arm and cell, with which a rig file is then written."""
    # start-up: 0.5 s of NumPy and h5py, which --help does not need
    from rig.atomic_write import write_text
    from rig.felt.order import check_order
    from rig.recording.options import RecordingKeywords

    rig_file = rig.load_rig(access.rig)
    felt = check_order(order, rig_file.config, rig_file.source)
    address = access.backend
    if address.startswith(SIMULATED) and "felt=" not in address:
        address += f"{'&' if '?' in address else '?'}felt={order.contact}"
    with closing(rig.open_backend(address, rig_file.config)) as bench:
        if bench.capabilities.hardware:
            what = "a block of steel" if order.contact == BLOCK else f"the felt of {order.contact}"
            question = f"Clamp {what} under the arm, the {felt.encoder}'s scale on the motor's shaft. Press Enter: "
            if access.ask is None or access.ask(question) is None:
                raise rig.NotPermitted(f"{access.backend}: nobody to mount {what}; run it in a terminal")
        on_bench = RecordingKeywords(rig_config=rig_file, backend=bench, permission=access.permission(rig_file, bench))
        done = rig.record_felt(out, order, **(keywords | on_bench))
    if done.compliance is not None:
        write_text(out / RIG_NAME, done.rig_text)
        found = done.compliance
        return done, {
            "compliance_m_per_n": found.m_per_n,
            "u_compliance_m_per_n": found.u_m_per_n,
            "largest_deviation_m": found.crooked_m,
            "rig": out / RIG_NAME,
        }
    rows = [_press_facts(press) for press in done.presses]
    return done, {"presses": rows, **_fit_loop(rows)}


def _press_facts(press: rig.FeltPress) -> dict[str, Any]:
    """Facts of a press by name: trial, file, peak force (N), depth (m), speed (m/s), coefficients a, b, c of the felt's
    cubic with their uncertainties; D where loading lies above unloading."""
    curve, fit = press.curve, model.calibration.fit_felt(model.calibration.read_curve(press.file))
    row: dict[str, Any] = {
        "trial": press.trial,
        "file": press.file,
        "peak_n": curve.peak_n,
        "deepest_m": curve.deepest_m,
        "speed_m_per_s": curve.speed_m_per_s,
        "u_speed_m_per_s": curve.u_speed_m_per_s,
        "abc": fit.abc,
        "u_abc": fit.u_abc,
        "law_fits": fit.law_fits,
    }
    above = fit.loading.force_n(fit.mid_m) - fit.force_n(fit.mid_m)
    if above.max() > 0:
        one = model.calibration.damping_factor(fit, curve.speed_m_per_s, curve.u_speed_m_per_s)
        row |= {"D": one.d, "u_D": one.u_d}
    return row


def _fit_loop(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Fit a line over speed to the loop of presses (D times speed): ``{"loop": …}`` with its value at no speed, which
    eq. 2.7 lacks, its slope, s/m, and their uncertainties; empty with fewer than three presses, or speeds too alike."""
    import numpy as np  # start-up: 0.1 s that --help does not need

    known = [row for row in rows if "D" in row and row["u_D"] > 0]
    speeds = np.array([row["speed_m_per_s"] for row in known])
    if len(known) < 3 or np.ptp(speeds) < 0.5 * speeds.max():
        return {}
    share = np.array([row["D"] for row in known]) * speeds
    u = np.array([row["u_D"] for row in known]) * speeds
    columns = np.column_stack([np.ones(speeds.size), speeds]) / u[:, None]
    covariance = np.linalg.inv(columns.T @ columns)
    rest, slope = covariance @ columns.T @ (share / u)
    left = share / u - columns @ np.array([rest, slope])
    widened = max(float(left @ left) / max(speeds.size - 2, 1), 1.0)
    u_rest, u_slope = np.sqrt(np.diag(covariance) * widened)
    return {"loop": {"at_rest": rest, "u_at_rest": u_rest, "per_speed_s_per_m": slope, "u_per_speed_s_per_m": u_slope}}


def felt_lines(order: rig.FeltOrder, facts: dict[str, Any]) -> list[str]:
    """Lines printed of a session of presses: each press, the fitted loop, the command to use next; of the block the
    compliance of arm and cell."""
    if order.contact == BLOCK:
        return [
            f"compliance of arm and cell {1e6 * facts['compliance_m_per_n']:.4g} um/N (standard uncertainty "
            f"{1e6 * facts['u_compliance_m_per_n']:.2g} um/N)",
            f"  up to {1e6 * facts['largest_deviation_m']:.2g} um off a line",
            f"{facts['rig']}: the rig file with it",
        ]
    lines = []
    for row in facts["presses"]:
        damping = f"D = {row['D']:.3g} s/m (standard uncertainty {row['u_D']:.2g})" if "D" in row else "no loop"
        lines.append(
            f"trial {row['trial']}: {row['peak_n']:.1f} N, {1e3 * row['deepest_m']:.3f} mm, "
            f"{1e3 * row['speed_m_per_s']:.3g} mm/s, {damping}" + ("" if row["law_fits"] else ", the law does not fit")
        )
    if loop := facts.get("loop"):
        certain = abs(loop["at_rest"]) > 3 * loop["u_at_rest"]
        lines.append(
            f"loop, as a share of the force (standard uncertainty): {loop['at_rest']:.2g} ({loop['u_at_rest']:.1g}) "
            f"at no speed, {loop['per_speed_s_per_m']:.3g} ({loop['u_per_speed_s_per_m']:.2g}) s/m more with it: "
            + ("eq. 2.7 leaves out what stays at no speed" if certain else "grows with the speed as eq. 2.7 has it")
        )
    last = facts["presses"][-1]
    lines.append(
        f"next: pianorig calibrate felt {last['file'].as_posix()} --contact {order.contact} "
        f"--speed {last['speed_m_per_s']:.4g}+-{last['u_speed_m_per_s']:.1g} --out mine.toml"
    )
    return lines


def felt_order(
    contact: str, speeds: Sequence[float] | None, peaks: Sequence[float] | None, repeats: int | None
) -> rig.FeltOrder:
    """The order of presses of ``contact`` (contact01 to contact13, or the block): speeds, m/s, and peak forces, N,
    where None the built-in ones, ``repeats`` (None: 1); CommandInputError for another contact."""
    if contact != BLOCK and not (contact.startswith("contact") and contact[7:].isdigit()):
        raise CommandInputError(f"--felt {contact}: allowed contact01 to contact13, or {BLOCK}")
    usual = rig.FeltOrder(contact)
    return rig.FeltOrder(
        contact,
        usual.speeds_m_per_s if speeds is None else speeds,
        usual.peaks_n if peaks is None else peaks,
        1 if repeats is None else repeats,
    )
