"""``pianorig bench``: the bench in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pianorig import page
from pianorig.console.options import SELFTESTS, AsJson, Backend, Rig, Selftests
from pianorig.console.output import print_json
from pianorig.errors import CommandInputError

EXTRA = ("bokeh", "tornado")
"""Packages of the extra ``bench``."""


def command(
    folder: Annotated[Path, typer.Argument(help="Folder of your sessions.", metavar="SESSIONS_DIR")] = Path("sessions"),
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 takes a free one.")] = 0,
    control: Annotated[
        bool,
        typer.Option("--control", help="Let the page write, and play plans on --rig and --backend."),
    ] = False,
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    selftest: Selftests = SELFTESTS,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open it, or only say where it is.")] = True,
    as_json: AsJson = False,
) -> None:
    """Show sessions in the browser until Ctrl-C.

    On this computer only; nothing is fetched from the internet. With --control the address holds a token that works
    once. A plan begun on the page needs what  pianorig record  needs: on hardware a self-test and the rig's name typed.

    Example:  pianorig bench sessions
    Example:  pianorig bench sessions --control
    """

    def announce(access: page.Access) -> None:
        opened = show and webbrowser.open(access.first_address)
        if as_json:
            print_json({"address": access.first_address, "control": control, "opened": opened})
            return
        what = f"may write and play plans on {backend}, for who opens it first" if control else "looks only"
        print(f"bench at {access.first_address} ({what}); stop with Ctrl-C", flush=True)

    bench = page.Bench(rig, backend, str(selftest))
    try:
        page.serve_until_interrupted(page.BenchOptions(folder, port, control, bench), announce)
    except ModuleNotFoundError as error:
        if error.name not in EXTRA:
            raise
        raise CommandInputError(
            f"bench: needs the package {error.name}; install it with  pip install 'piano-action-rig[bench]'"
        ) from error
    except KeyboardInterrupt:
        return
