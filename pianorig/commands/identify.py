"""``pianorig identify``: find parameter values from sessions, and say how well they are known."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rig
import validation
from pianorig import workflows
from pianorig.console.failures import Interrupted
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Scene, Settings
from pianorig.console.output import table_lines, tell, wrap_text
from pianorig.console.overrides import load_model, read_settings
from pianorig.console.progress import say
from pianorig.errors import CommandInputError
from validation.numbers import number, with_u
from validation.report.files import check_target

if TYPE_CHECKING:
    from validation.infer.further import Prospect

CLUSTER_TIMEOUT_S = 10  # for a scheduler to answer
DASK_LOGGERS = ("distributed.client", "distributed.core", "distributed.utils")


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
    budget: Annotated[
        float | None,
        typer.Option(
            "--budget",
            help="Processor time, s; by default 5 s a trial, at least 50. At its end, or at Ctrl-C, the best so far.",
            min=1.0,
            metavar="SECONDS",
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option("--plan", help="Rank what could be recorded next; write the best as a trial plan for record."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find parameter values from strokes; say what is unknown.
    The file written is an action, in place of one that is there: give it to validate or simulate with --action. A page
    of the same name (.html) says what it means.

    All other parameters, and the errors of force and encoders, are fitted beside what is asked for, within their
    uncertainties. What the strokes cannot tell is said, not guessed.

    Example:  pianorig identify sessions/try --parameters hammer.joint_friction --no-profiles --out mine.toml
    """
    check_target(out)
    check_target(out.with_suffix(".html"), ".html")
    if plan is not None:
        check_target(plan)
        check_plan(sessions, motion_driven)
    start = load_model(action, set_ or [], scene)
    with nullcontext() if cluster is None else cluster_executor(cluster) as executor:
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
            budget_s=budget,
            executor=executor,
            profiles=None if profiles else (),
            progress=None if as_json else say,
        )
        ranked, refused, why_none = next_strokes_or_reason(found) if plan is not None else ([], [], "")
    files = validation.write_reading(found, out, ranked, refused)
    if plan is not None and not why_none:
        files |= {"plan": write_best_stroke(found, ranked, plan)}
    shrinks = [{"name": p.name, "trials": p.trials, "shrink": dict(p.shrink)} for p in ranked]
    more = {"file": out, "files": files, "next": shrinks, "no_plan": why_none or None}
    lines = [
        *table_lines(ESTIMATE_HEAD, [*map(_cells, found.estimates)]),
        *(line for text in found.warnings for line in wrap_text(f"note: {text}.")),
        *(line for name, scores in found.scores.items() for line in wrap_text(_scores(name, scores))),
        *(line for text in reading_lines(found, ranked, refused) for line in wrap_text(text)),
        *wrap_text(f"end: {found.end}."),
        *(f"{name}: {path}" for name, path in files.items()),
        *(wrap_text(f"plan: none is written: {why_none}.") if why_none else []),
    ]
    tell(as_json, _plain_facts(found) | more, lines)
    if found.end.by_user:
        raise Interrupted(f"identify stopped by Ctrl-C; the best so far is in {out}")


def _names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _numbers(text: str) -> tuple[int, ...]:
    parts = _names(text)
    if not all(part.isdecimal() for part in parts):
        raise validation.ValidationInputError(f"--hold-out-trials {text!r}: allowed numbers of trials, e.g. 2,5")
    return tuple(map(int, parts))


ESTIMATE_HEAD = ("parameter", "value ± uncertainty", "95 % interval", "verdict")


def _cells(e: Any) -> tuple[str, ...]:
    unit = "" if e.unit == "1" else f" {e.unit}"
    return e.name, with_u(e.value, e.u) + unit, f"{e.low:.4g} to {e.high:.4g}", e.verdict


def _scores(name: str, scores: dict[str, Any]) -> str:
    parts = []
    for what, by_channel in scores.items():
        if by_channel is not None:
            values = ", ".join(f"{channel} {number(math.degrees(v), 2)}" for channel, v in by_channel.items())
            parts.append(f"{what} {values}")
    return f"RMSE (°), {name}: {'; '.join(parts)}"


def _plain_facts(found: Any) -> dict[str, Any]:
    """An identification as a dict of plain lists, tables and texts, as ``--json`` prints it: estimates, correlation,
    undetermined parameters, warnings, scores, and how it ended."""
    supported = found.details.supported
    return {
        "estimates": [asdict(e) for e in found.estimates],
        "correlation": found.correlation.tolist(),
        "undetermined": [d.words for d in found.undetermined],
        "explained": list(found.details.explained),
        "in_spite_of_the_lack": [] if supported is None else [asdict(e) for e in supported.estimates],
        "warnings": list(found.warnings),
        "end": {"kind": found.end.kind, "detail": found.end.detail},
        "starts": list(found.starts),
        "scores": dict(found.scores),
        "provenance": dict(found.provenance),
    }


NO_SESSION = (
    "--plan: no session with forces was fitted, so neither bench nor sensors are known; give one beside what was given"
)


def next_strokes(found: validation.Identification) -> tuple[list[Prospect], list[str]]:
    """Candidate strokes, each with the sensors to add, best first by how far recording it would shrink the parameters'
    intervals; and a text for each that cannot be played or predicted. CommandInputError without a session."""
    from validation.infer.further import list_candidate_strokes, prospects  # start-up: --help needs none of it

    sources = found.details.sources
    if not sources.measured:
        raise CommandInputError(NO_SESSION)
    bench = rig.session_rig(sources.sessions[0])
    like, phases = sources.measured[0], found.details.problem.trials[0].time_s.size
    candidates, refused = list_candidate_strokes(bench.config, workflows.predictor(bench, found.action), like, phases)
    ranked, not_run = prospects(found.details.problem, found.details.fitted, candidates)
    return ranked, [*refused, *not_run]


def check_plan(sessions: Sequence[Path], motion_driven: bool) -> None:
    """Refuse, before a fit is made, what nothing can be ranked for: the shelf is of strokes that a force drives."""
    if motion_driven:
        raise CommandInputError("--plan: ranks strokes by the force on the key; leave out --motion-driven or --plan")
    rig.session_rig(rig.Session.open(sessions[0]))


def next_strokes_or_reason(found: validation.Identification) -> tuple[list[Prospect], list[str], str]:
    """Ranked strokes, texts of refused ones (both as `next_strokes`), and the reason why no plan can be written, empty
    where one can; an error of input or bench becomes that reason, so that the fit is not lost."""
    # start-up: --help needs none of it
    from validation.infer.further import best_stroke
    from validation.infer.sentences import group_by_reason

    try:
        ranked, refused = next_strokes(found)
    except (CommandInputError, rig.RigError) as error:
        return [], [], str(error).removeprefix("--plan: ")
    if best_stroke(ranked) is not None:
        return ranked, refused, ""
    return (
        ranked,
        refused,
        "no profile could be predicted within the limits of the rig file"
        + (f" ({'; '.join(group_by_reason(refused))})" if refused else ""),
    )


def write_best_stroke(found: validation.Identification, ranked: list[Prospect], plan: Path) -> Path:
    """Write the best of the ranked strokes as the trial plan ``plan`` (its profile beside), with remarks where the fit
    it rests on is doubtful; return the plan's path."""
    # start-up: --help needs none of it
    from validation.infer.estimates import LACKING
    from validation.infer.further import write_plan
    from validation.infer.scatter import measure_lack

    fitted = found.details.fitted
    doubts = [] if fitted.converged else ["the fit it is predicted from ran out of its budget"]
    if measure_lack(fitted) > LACKING:
        doubts.append("the model seems to lack something, and these predictions take it as right")
    return write_plan(ranked, plan, doubts)[plan.name]


def reading_lines(
    found: validation.Identification,
    ranked: list[Prospect],
    refused: list[str],
    most: int = 5,  # lines on a screen
) -> list[str]:
    """Lines to print: the identification in sentences, then the ``most`` strokes that would shrink the intervals most,
    best first, and the ``refused`` ones grouped by reason."""
    # start-up: --help needs none of it
    from validation.infer.sentences import group_by_reason, plain_sentences

    said = [*plain_sentences(found, ranked), *found.details.explained]
    if not ranked:
        return said
    lines = [*said, "to record next (standard uncertainty after over now, geometric mean, predicted):"]
    for p in ranked[:most]:
        each = ", ".join(f"{name} {x:.2f}" for name, x in sorted(p.shrink.items(), key=lambda pair: pair[1])[:3])
        lines.append(f"  {p.mean:.2f}  {p.words} (most: {each})")
    return lines + [f"  not considered: {line}" for line in group_by_reason(refused)]


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Context: connect to the Dask scheduler at ``address`` (tcp://host:port), yield an executor that runs on its
    workers, disconnect; CommandInputError where none answers or it has no workers."""
    try:
        import distributed  # start-up: 0.5 s, an extra
    except ImportError:
        raise CommandInputError('--cluster: needs dask; python -m pip install "piano-action-rig[cluster]"') from None
    try:
        client: Any = distributed.Client(address, timeout=CLUSTER_TIMEOUT_S)
    except (OSError, TimeoutError, ValueError) as problem:
        why = " ".join(str(problem).split()) or type(problem).__name__
        raise CommandInputError(
            f"--cluster {address}: no scheduler answers ({why}); start one with dask scheduler, allowed tcp://host:port"
        ) from None
    with _quiet_dask():
        try:
            if not client.scheduler_info()["workers"]:
                raise CommandInputError(f"--cluster {address}: has no workers; start some with dask worker {address}")
            yield client.get_executor()
        finally:
            client.close()


@contextmanager
def _quiet_dask() -> Iterator[None]:
    """Context in which Dask's loggers print nothing below CRITICAL: a lost scheduler is said by the command in one
    line, without Dask's traceback."""
    loggers = [logging.getLogger(name) for name in DASK_LOGGERS]
    levels = [one.level for one in loggers]
    for one in loggers:
        one.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for one, level in zip(loggers, levels, strict=True):
            one.setLevel(level)
