"""``pianorig validate``: compare sessions with models and write one report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import model
import validation
from model.tolerance import DEFAULT_TOLERANCE
from pianorig import workflows
from pianorig.console.options import (
    DEFAULT_ACTION,
    AsJson,
    Scene,
    Settings,
    Tolerance,
    complete_file,
)
from pianorig.console.output import tell
from pianorig.console.overrides import load_model, split_model
from pianorig.console.progress import say
from pianorig.errors import CommandInputError
from validation.cache.report_cache import StoredReport, inputs_sha256, report_folder, store_report, stored_report


def command(
    sessions: Annotated[list[Path], typer.Argument(help="Session folders.", metavar="SESSION")],
    action: Annotated[
        list[str] | None,
        typer.Option(
            "--action",
            help='Built-in action or a TOML file, changed as in "hirschkorn2004: --scene string --set '
            f'contact04.friction.A=0.3 --scale damping=0.5"; may be repeated.  [default: {DEFAULT_ACTION}]',
            autocompletion=complete_file("model/actions"),
        ),
    ] = None,
    set_: Settings = None,
    scene: Scene = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the report; default: that of the only session.")
    ] = None,
    tolerance: Tolerance = DEFAULT_TOLERANCE,
    by_motion: Annotated[
        bool,
        typer.Option(
            "--by-motion/--no-by-motion",
            help="The measured key drives the models instead of the force; where no force was recorded it always does.",
        ),
    ] = False,
    condition: Annotated[
        str | None,
        typer.Option("--condition", help="Compare only this condition of the trial plan; default: each on its own."),
    ] = None,
    relevant: Annotated[
        list[str] | None,
        typer.Option(
            "--relevant",
            help="Limit from which a difference matters: travel=5 (% of a channel's travel), check_height=2 (mm), "
            "let_off=0.5 (mm), time=2 (ms), speed=5 (%); may be repeated.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    identified: Annotated[Path | None, typer.Option("--identified", hidden=True)] = None,
    explain: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Look for the causes of a difference although the verdict resolves none; else only where it does.",
        ),
    ] = False,
    again: Annotated[
        bool,
        typer.Option(
            "--again",
            help="Make the report again although nothing has changed; stored predictions and scores are used.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Report how well models predict the measured angles.
    Every model is driven with each trial's own force, or with the measured motion of its key (--by-motion, and where no
    force was recorded). The report is written into --out, by default into the session.

    Several sessions and several models stand side by side in one report; they are never pooled.

    Example:  pianorig validate sessions/try --action hirschkorn2004
    Example:  pianorig validate sessions/try --explain
    Example:  pianorig validate sessions/try --relevant check_height=1 --relevant travel=3
    Example:  pianorig validate sessions/kawai_kg3c --action sessions/kawai_kg3c/identified.toml --out real
    Example:  pianorig validate sessions/try --action hirschkorn2004 --action hirschkorn2004-regulated --out compared
    Example:  pianorig validate sessions/try --action hirschkorn2004 --action "hirschkorn2004: --set hammer.mass=0.01"
    Example:  pianorig validate sessions/try --action hirschkorn2004 --action "hirschkorn2004: --scene string"
    """
    if identified is not None:
        raise CommandInputError(f"--identified is gone: an identified set is an action; give --action {identified}")
    folder = report_folder(sessions, out)
    actions = action or [DEFAULT_ACTION]
    options = {"set": set_ or [], "tolerance": tolerance, "by_motion": by_motion, "condition": condition}
    if scene is not None:
        options["scene"] = scene
    if explain:
        options["explain"] = True
    limits = _parse_limits(relevant or [])
    if limits:
        options["relevant"] = limits
    # a changed action depends on its file and on that of its scene, too
    files_of = [word for text in actions for word in (split_model(text)[0], *split_model(text)[1].split())]
    named = [word for word in (*files_of, scene or "") if word.endswith(".toml")]
    read = list(dict.fromkeys([*actions, *(split_model(text)[0] for text in actions), *named]))
    inputs = inputs_sha256(sessions, read, options)
    stored = None if again else stored_report(folder, inputs)
    refused: tuple[str, ...] = ()
    if stored is not None:
        verdict, files, reused = stored.verdict_lines, stored.files, f"everything, as made {stored.made_utc}"
        printed = stored.printed
    else:
        models = [load_model(name, set_ or [], scene) for name in actions]
        model.compile_ahead([model.choice_of(one) for one in models], lanes=True)  # while the step loop compiles here
        side = validation.validate_sessions(
            sessions,
            models,
            folder,
            progress=None if as_json else say,
            tolerance=tolerance,
            by_motion=by_motion,
            condition=condition,
            relevant=limits,
            explain=explain or None,
        )
        verdict, files, refused, reused = side.verdict_lines, side.files, side.refused, _reused_stages(side)
        printed = workflows.comparison_lines(side)
        # a report is not stored when a session could not be read, or when an input changed while it was made
        if not refused and inputs_sha256(sessions, read, options) == inputs:
            made_utc = side.results[0].provenance["created_utc"]
            note = store_report(folder, inputs, StoredReport(verdict, printed, files, made_utc))
            reused += f"; {note}" if note else ""
            printed += [note] if note else []
    facts = {"verdict": " ".join(verdict), "files": files, "reused": reused, "refused": refused}
    tell(as_json, facts, [*printed, f"report: {files['report.html']}"])
    if refused:
        raise typer.Exit(2)


def _parse_limits(given: list[str]) -> dict[str, float]:
    """Smallest relevant difference by name, in SI units or as a share, from texts NAME=VALUE of ``--relevant``, VALUE
    in the unit that is shown for it; CommandInputError for another name or no number above 0."""
    out = {}
    for text in given:
        name, _, value = text.partition("=")
        if name not in validation.RELEVANT:
            raise CommandInputError(
                f"--relevant {text}: {name!r} is no limit; allowed {', '.join(validation.RELEVANT)}"
            )
        kind = validation.RELEVANT[name]
        try:
            number = float(value)
        except ValueError:
            number = 0.0
        if not 0.0 < number < float("inf"):
            raise CommandInputError(f"--relevant {text}: {value!r} is no number above 0; give {name} in {kind.unit}")
        out[name] = number / kind.factor
    return out


def _reused_stages(side: validation.SideBySide) -> str:
    """What was not made again, for every session and model."""
    texts = []
    for result in side.results:
        counts = ", ".join(f"{kind} {count}" for kind, count in result.provenance["reused"].items())
        texts.append(counts if len(side.results) == 1 else f"{result.session_name}, {result.action_name}: {counts}")
    return "; ".join(texts)
