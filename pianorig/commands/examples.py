"""``pianorig examples``: small files to try the other commands with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import print_json
from pianorig.console.progress import working


def command(
    folder: Annotated[Path, typer.Argument(help="Folder to write into.", metavar="DIR")],
    as_json: AsJson = False,
) -> None:
    """Write small files to try every command with.

    Force, key motion, felt, film, target, plan and rig: computed, not measured.

    Example:  pianorig examples try
    """
    with working("writing examples", quiet=as_json) as words:
        paths = workflows.write_examples(folder, words)
    if as_json:
        print_json({"files": paths})
        return
    for name, path in paths.items():
        print(f"{path!s:<28} {workflows.EXAMPLES[name]}")
