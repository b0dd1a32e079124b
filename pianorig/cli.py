"""Entry point of ``pianorig``: the list of commands and what happens to their errors.

A command's module is imported when the command runs or its own help is asked for, so that ``--help`` starts fast. An
error that a package raises on purpose carries ``exit_code`` (2 bad input, 3 hardware or safety, 1 defect) and is
printed in one line; with ``--debug`` its traceback is shown. Ctrl-C ends with 130.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from pianorig import commands

STYLE: dict[str, Any] = {
    "add_completion": False, "pretty_exceptions_enable": False, "rich_markup_mode": None,
}  # fmt: skip


class LazyGroup(TyperGroup):
    """The commands of the table, each imported when it is run or its own help is asked for."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands: Any = dict.fromkeys(commands.COMMANDS)  # the names, also for "Did you mean …?"

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name, its module imported now; None where there is none."""
        if cmd_name not in commands.COMMANDS:
            return None
        single = typer.Typer(**STYLE)
        single.command(cmd_name)(commands.load(cmd_name))
        return get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with their first lines, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, listed.help) for name, listed in commands.COMMANDS.items()])


app = typer.Typer(
    name="pianorig",
    cls=LazyGroup,
    help="Play a piano action with a motor, measure and film it, and see how well a model predicts it.",
    no_args_is_help=True,
    **STYLE,
)


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
) -> None:
    if debug:
        os.environ["PIANORIG_DEBUG"] = "1"


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exits the process."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a Windows pipe may lack a character: replace it, do not fail
            stream.reconfigure(errors="replace")
    # a command keeps most of what it allocates until it ends: passes of the collector, the last one above all, find
    # nothing and would take a fifth of the time (docs/decisions/0054-start-up-collector.md)
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
