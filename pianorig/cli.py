"""Entry point of ``pianorig``: the list of commands and what happens to their errors.

Commands import what they need when they run, so that ``--help`` starts fast. An error that a package raises on
purpose carries ``exit_code`` (2 bad input, 3 hardware or safety, 1 defect) and is printed in one line; with
``--debug`` its traceback is shown. Ctrl-C ends with 130.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys

import typer

from pianorig import commands

app = typer.Typer(
    name="pianorig",
    help="Play a piano action with a motor, measure and film it, and see how well a model predicts it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
) -> None:
    if debug:
        os.environ["PIANORIG_DEBUG"] = "1"


for _name in commands.HOME:
    app.command(_name)(commands.load(_name))


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exits the process."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a Windows pipe may not know every sign; never die of that
            stream.reconfigure(errors="replace")
    # a command keeps most of what it makes until it ends: walks of the collector through it, the last one above all,
    # find nothing and would take a fifth of the time
    gc.set_threshold(20_000, 20, 50)
    atexit.register(gc.freeze)
    try:
        app(args=arguments, standalone_mode=True)
    except KeyboardInterrupt:
        print("pianorig: stopped by Ctrl-C; what was recorded is kept", file=sys.stderr)
        raise SystemExit(130) from None
    except Exception as problem:
        code = getattr(problem, "exit_code", None)
        if os.environ.get("PIANORIG_DEBUG"):
            raise
        if code is None:
            print(f"pianorig: defect: {type(problem).__name__}: {problem} (run again with --debug)", file=sys.stderr)
            raise SystemExit(1) from None
        print(f"pianorig: {' '.join(str(problem).split())}", file=sys.stderr)
        raise SystemExit(code) from None


if __name__ == "__main__":
    main()
