"""``pianorig bench``: the bench in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pianorig import page
from pianorig.console.options import AsJson
from pianorig.console.output import print_json
from pianorig.errors import CommandInputError

EXTRA = ("bokeh", "tornado")
"""Packages of the extra ``bench``."""


def command(
    folder: Annotated[Path, typer.Argument(help="Folder of your sessions.", metavar="SESSIONS_DIR")] = Path("sessions"),
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 takes a free one.")] = 0,
    control: Annotated[
        bool,
        typer.Option("--control", help="Let the page write: annotations, outlines, reports."),
    ] = False,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open it, or only say where it is.")] = True,
    as_json: AsJson = False,
) -> None:
    """Show sessions in the browser until Ctrl-C.
    On this computer only; nothing is fetched from the internet. The page watches and reviews; a recording is begun in
    the terminal, with  pianorig record.

    Example:  pianorig bench sessions
    Example:  pianorig bench sessions --control
    """

    def announce(access: page.Access) -> None:
        opened = show and webbrowser.open(access.address)
        if as_json:
            print_json({"address": access.address, "control": control, "opened": opened})
            return
        what = "may write" if control else "looks only"
        print(f"bench at {access.address} ({what}); stop with Ctrl-C", flush=True)

    try:
        page.serve_until_interrupted(page.BenchOptions(folder, port, control), announce)
    except ModuleNotFoundError as error:
        if error.name not in EXTRA:
            raise
        raise CommandInputError(
            f"bench: needs the package {error.name}; install it with  pip install 'piano-action-rig[bench]'"
        ) from error
    except KeyboardInterrupt:
        return
