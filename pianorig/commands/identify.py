"""``pianorig identify``: find parameter values from sessions, and say how well they are known."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

import validation
from pianorig import workflows
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Scene, Settings
from pianorig.console.output import tell
from pianorig.console.overrides import load_model, read_settings
from pianorig.console.progress import say
from validation.report.files import check_target


def command(
    sessions: Annotated[
        list[Path],
        typer.Argument(help="Session folders, one kind of stroke each.", metavar="SESSION"),
    ],
    parameters: Annotated[
        str,
        typer.Option(
            "--parameters",
            help="What to identify: names as --set and --scale know them, felt:contact02, or groups (friction, "
            "joint_friction, damping, stiffness, springs), separated by commas.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Action file to write.")] = Path("identified.toml"),
    action: Action = DEFAULT_ACTION,
    set_: Settings = None,
    scene: Scene = None,
    fix: Annotated[
        str, typer.Option("--fix", help='Held at the action\'s values; names separated by commas, "*" for all others.')
    ] = "",
    prior: Annotated[
        list[str] | None,
        typer.Option(
            "--prior",
            help="Standard uncertainty before the strokes, name=u; relative for laws of friction, felt and springs; "
            "may be repeated.",
        ),
    ] = None,
    hold_out: Annotated[
        list[Path] | None, typer.Option("--hold-out", help="Session to predict only; may be repeated.")
    ] = None,
    hold_out_trials: Annotated[
        str, typer.Option("--hold-out-trials", help="Numbers of trials to predict only, in every session: 2,5.")
    ] = "",
    motion_driven: Annotated[
        bool,
        typer.Option(
            "--motion-driven", help="The measured key drives the model in all trials, not only where no force is."
        ),
    ] = False,
    film: Annotated[
        bool, typer.Option("--film", help="Fit jack and repetition lever too, as tracked on the trials' films.")
    ] = False,
    starts: Annotated[int, typer.Option("--starts", min=1, help="Points the fit starts from.")] = 1,
    condition: Annotated[
        str | None, typer.Option("--condition", help="Use only this condition of the trial plan.")
    ] = None,
    profiles: Annotated[
        bool, typer.Option("--profiles/--no-profiles", help="Make a profile of each parameter.")
    ] = True,
    cluster: Annotated[
        str | None, typer.Option("--cluster", help="Dask scheduler to run the model on, tcp://host:8786.")
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option("--plan", help="Rank what could be recorded next; write the best as a trial plan for record."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find parameter values from strokes; say what is unknown.

    All other parameters, and the errors of force and encoders, are fitted beside what is asked for, within their
    uncertainties. What the strokes cannot tell is said, not guessed. The file written is an action: give it to
    validate or simulate with --action. A page of the same name (.html) says what it means.

    Example:  pianorig identify sessions/try --parameters hammer.joint_friction --no-profiles --out mine.toml
    """
    check_target(out)
    check_target(out.with_suffix(".html"), ".html")
    if plan is not None:
        check_target(plan)
        workflows.check_plan(sessions, motion_driven)
    start = load_model(action, set_ or [], scene)
    with nullcontext() if cluster is None else workflows.cluster_executor(cluster) as executor:
        found = validation.identify(
            sessions,
            _names(parameters),
            start,
            fixed=tuple(_names(fix)),
            priors=read_settings(prior or [], "--prior"),
            hold_out=tuple(hold_out or ()),
            hold_out_trials=_numbers(hold_out_trials),
            starts=starts,
            condition=condition,
            motion_driven=motion_driven,
            film=film,
            executor=executor,
            profiles=None if profiles else (),
            progress=None if as_json else say,
        )
        ranked, refused, why_none = workflows.ranked_next(found) if plan is not None else ([], [], "")
    files = validation.write_reading(found, out, ranked, refused)
    if plan is not None and not why_none:
        files |= {"plan": workflows.write_next(found, ranked, plan)}
    shrinks = [{"name": p.name, "trials": p.trials, "shrink": dict(p.shrink)} for p in ranked]
    more = {"file": out, "files": files, "next": shrinks, "no_plan": why_none or None}
    lines = [
        *(f"note: {line}." for line in found.warnings),
        *map(_line, found.estimates),
        *(_scores(name, scores) for name, scores in found.scores.items()),
        *workflows.reading_lines(found, ranked, refused),
        *(f"{name}: {path}" for name, path in files.items()),
        *([f"plan: none is written: {why_none}."] if why_none else []),
    ]
    tell(as_json, _as_plain(found) | more, lines)


def _names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _numbers(text: str) -> tuple[int, ...]:
    parts = _names(text)
    if not all(part.isdecimal() for part in parts):
        raise validation.ValidationInputError(f"--hold-out-trials {text!r}: allowed numbers of trials, e.g. 2,5")
    return tuple(map(int, parts))


def _line(e: Any) -> str:
    unit = "" if e.unit == "1" else f" {e.unit}"
    interval = "" if e.interval == "two-sided" else f"; the strokes alone leave it {e.interval}"
    jack = "" if math.isnan(e.u_jackknife) else f", trials left out one by one {e.u_jackknife:.2f}"
    jack += "" if math.isnan(e.u_strokes) else f", kinds of stroke {e.u_strokes:.2f}"
    return (
        f"{e.name}: {e.value:.4g}{unit} (u {e.u:.2g}; 95 % {e.low:.4g} to {e.high:.4g}; before {e.prior:.4g}; "
        f"of the prior u left {e.z_u:.2f}{jack}{interval}): {e.verdict}"
    )


def _scores(name: str, scores: dict[str, Any]) -> str:
    parts = []
    for what, by_channel in scores.items():
        if by_channel is not None:
            values = ", ".join(f"{channel} {1e3 * v:.2g}" for channel, v in by_channel.items())
            parts.append(f"{what} {values}")
    return f"RMSE, mrad, {name}: {'; '.join(parts)}"


def _as_plain(found: Any) -> dict[str, Any]:
    supported = found.details.supported
    return {
        "estimates": [asdict(e) for e in found.estimates],
        "correlation": found.correlation.tolist(),
        "undetermined": [d.words for d in found.undetermined],
        "explained": list(found.details.explained),
        "in_spite_of_the_lack": [] if supported is None else [asdict(e) for e in supported.estimates],
        "warnings": list(found.warnings),
        "starts": list(found.starts),
        "scores": dict(found.scores),
        "provenance": dict(found.provenance),
    }
