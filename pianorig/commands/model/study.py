"""``pianorig study``: the same blow on variants of an action, or the thesis's sensitivity studies checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.column_file import make_folder
from pianorig.console.options import DEFAULT_ACTION, AsJson, Scale, Settings
from pianorig.console.output import print_json
from pianorig.console.overrides import load_changed
from pianorig.errors import CommandInputError

THESIS, LIMIT, STRING, FELT, JOINTS = "thesis", "friction-limit", "string", "felt-law", "joints"


def command(
    action: Annotated[
        str,
        typer.Argument(
            help="Built-in action or a TOML file; or the word thesis: its Figs 4.9-4.11, 4.16-4.19; or the word "
            "friction-limit: threshold speeds beside set-valued friction; or the word string: its bar beside a string; "
            "or the word felt-law: the blow under each law of felt; or the word joints: the blow with joints that give."
        ),
    ],
    force: Annotated[
        Path | None,
        typer.Option(
            "--force", help="CSV of time_s,force_n, or a sealed trial; after one of the words: another forte."
        ),
    ] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option("--variant", help='One variant, "name: --set path=value --scale name=factor"; may be repeated.'),
    ] = None,
    set_: Settings = None,
    scale: Scale = None,
    of: Annotated[
        str | None,
        typer.Option("--of", help=f"With one of the words: the action to study; default {DEFAULT_ACTION}."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the figure and the tables.")] = None,
    as_json: AsJson = False,
) -> None:
    """Ask what if: variants of an action under one blow.

    Example:  pianorig study hirschkorn2004 --force force.csv --variant "dry: --scale damping=0.1" --out dry
    """
    if out is not None:
        make_folder(out)
    if action in (THESIS, LIMIT, STRING, FELT, JOINTS):
        if variant:
            raise CommandInputError(f"study {action}: has its own variants; leave out --variant or name an action")
        chosen = load_changed(of or DEFAULT_ACTION, set_, scale)
        study = {
            THESIS: workflows.study_thesis, LIMIT: workflows.friction_limit, STRING: workflows.study_string,
            FELT: workflows.study_felt_law, JOINTS: workflows.study_joints,
        }[action]  # fmt: skip
        facts = study(chosen, force, out, quiet=as_json)
    else:
        if of is not None:
            raise CommandInputError(
                f"--of {of}: goes with thesis, friction-limit, string, felt-law and joints only; "
                f"name the action instead of {action}"
            )
        if force is None:
            raise CommandInputError(
                "--force: missing; name a CSV file with the columns time_s,force_n, or a sealed trial"
            )
        chosen = load_changed(action, set_, scale)
        facts = workflows.study_variants(chosen, force, variant or [], out, quiet=as_json)
    if as_json:
        print_json(facts)
