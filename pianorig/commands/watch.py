"""``pianorig watch``: see a recording from a second process."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.column_file import check_writable
from pianorig.console.options import AsJson
from pianorig.console.output import print_json
from pianorig.console.terminal import can_print, clear_screen, drawing_width
from pianorig.errors import CommandInputError

BLANK = chr(0x2800)
"""A braille character; what prints one prints all."""


def command(
    session: Annotated[Path, typer.Argument(help="Session folder that is being recorded, or a finished one.")],
    png: Annotated[Path | None, typer.Option("--out", help="Refresh this picture instead of drawing text.")] = None,
    every: Annotated[float, typer.Option("--every", help="Time between updates, s.")] = 0.5,
    once: Annotated[bool, typer.Option("--once", help="Show the present state and end.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show force and angles of the trial being recorded.

    Only reads, so that the recording is not disturbed.

    Example:  pianorig watch sessions/try
    """
    if not 0.05 <= every <= 60:
        raise CommandInputError(f"--every {every:g}: allowed 0.05 to 60 s")
    if png is not None:
        check_writable(png)

    def show(view: workflows.LiveView) -> None:
        if png is not None:
            workflows.draw_view(png, view)
        if as_json:
            print_json(workflows.view_facts(view))
        elif png is None:
            clear_screen()
            print(workflows.view_as_text(view, drawing_width(), braille=can_print(BLANK)), flush=True)

    try:
        last = workflows.watch(session, show, every_s=every, once=once)
    except KeyboardInterrupt:
        return  # the recording goes on; only the watching ends
    if last is None:
        raise CommandInputError(f"{session}: nothing has been recorded yet")
    if png is not None and not as_json:
        print(f"trial {last.trial} of {last.trials}, {last.state}: {png}")
