"""``pianorig validate``: compare a session with the model and write the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from validation import ValidationResult


def command(
    session: Annotated[Path, typer.Argument(help="Session folder.")],
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the report; default: the session's.")] = None,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Largest error of any predicted angle, rad.")] = 1e-5,
    by_motion: Annotated[
        bool, typer.Option("--by-motion/--no-by-motion", help="Also predict the force from the key's motion.")
    ] = True,
    condition: Annotated[
        str | None, typer.Option("--condition", help="Condition of the trial plan; needed where there are several.")
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="Make the report again though nothing has changed.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Drive the model with each trial's own force and report how well it predicts the angles.

    Example:  pianorig validate sessions/2026-11-21_forte_key52 --action hirschkorn2004
    """
    from validation.reuse import inputs_sha256, keep_report, kept_report

    from ..output import print_json, print_verdict

    folder = out or session
    options = {"set": set_ or [], "tolerance": tolerance, "by_motion": by_motion, "condition": condition}
    inputs = inputs_sha256(session, action, options)
    kept = None if again else kept_report(folder, inputs)
    if kept is not None:
        verdict, files, reused = kept.verdict_lines, kept.files, f"everything, as made {kept.made_utc}"
    else:
        result = _validate(session, action, set_ or [], out, tolerance, by_motion, condition, quiet=as_json)
        verdict, files = result.verdict_lines, result.files
        keep_report(folder, inputs, files, verdict, result.provenance["created_utc"])
        used = result.trials[result.trials["used"]]
        reused = f"predictions of {int(used['reused'].sum())} of {len(used)} trials"
    if as_json:
        names = {k: str(v) for k, v in files.items()}
        print_json({"verdict": " ".join(verdict), "files": names, "reused": reused})
        return
    print_verdict(verdict)
    print(f"reused: {reused}")
    print(f"report: {files['report.html']}")


def _validate(
    session: Path,
    action: str,
    settings: list[str],
    out: Path | None,
    tolerance: float,
    by_motion: bool,
    condition: str | None,
    *,
    quiet: bool,
) -> ValidationResult:
    import model
    import validation

    from ..progress import say
    from ..settings import read_settings

    chosen = model.load_action(action, read_settings(settings))
    progress = None if quiet else say
    return validation.validate_session(
        session, chosen, out, tolerance=tolerance, progress=progress, by_motion=by_motion, condition=condition
    )
