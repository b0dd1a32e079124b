"""``pianorig examples``: small files to try the other commands with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import tell
from pianorig.console.progress import working


def command(
    folder: Annotated[Path, typer.Argument(help="Folder to write into.", metavar="DIR")],
    as_json: AsJson = False,
) -> None:
    """Write small files to try every command with.
    A folder that has one of them already is refused before anything is written.

    Force, key motion, felt, film, target, plan and rig: computed, not measured.

    Example:  pianorig examples try
    """
    with working("writing examples", quiet=as_json) as words:
        paths = workflows.write_examples(folder, words)
    tell(as_json, {"files": paths}, (f"{path!s:<28} {workflows.EXAMPLES[name]}" for name, path in paths.items()))
