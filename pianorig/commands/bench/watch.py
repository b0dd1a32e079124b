"""``pianorig watch``: see a recording from a second process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rig.session.journal.live_reader import LiveView


def command(
    session: Annotated[Path, typer.Argument(help="Session folder that is being recorded, or a finished one.")],
    png: Annotated[
        Path | None, typer.Option("--out", "--png", help="Refresh this picture instead of drawing text.")
    ] = None,
    every: Annotated[float, typer.Option("--every", help="Time between looks, s.")] = 0.5,
    once: Annotated[bool, typer.Option("--once", help="Look once and end.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per look.")] = False,
) -> None:
    """Show force and angles of the trial at work; only reads, so that the recording is not disturbed.

    Example:  pianorig watch sessions/2026-11-21_forte
    """
    import sys

    from pianorig.console.output import check_writable, print_json
    from pianorig.errors import InputError
    from pianorig.workflows.bench.watch import as_text, draw, facts, watch

    if not 0.05 <= every <= 60:
        raise InputError(f"--every {every:g}: allowed 0.05 to 60 s")
    if png is not None:
        check_writable(png)

    def show(view: LiveView) -> None:
        if png is not None:
            draw(png, view)
        if as_json:
            print_json(facts(view))
        elif png is None:
            print("\x1b[2J\x1b[H" if sys.stdout.isatty() else "", end="")
            print(as_text(view), flush=True)

    try:
        last = watch(session, show, every_s=every, once=once)
    except KeyboardInterrupt:
        return  # the recording goes on; only the watching ends
    if last is None:
        raise InputError(f"{session}: nothing has been recorded yet")
    if png is not None and not as_json:
        print(f"trial {last.trial} of {last.trials}, {last.state}: {png}")
