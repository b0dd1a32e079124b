"""Entry point of ``pianorig``: the list of commands and what happens to their errors."""

from __future__ import annotations

import atexit
import difflib
import gc
import importlib.util
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperArgument, TyperGroup
from typer.main import get_command

from pianorig import commands
from pianorig.console.failures import Interrupted, how_stopped, tell_failure
from pianorig.console.progress import say, tell_when_compiling
from pianorig.console.terminal import write_what_the_terminal_can
from pianorig.errors import CommandInputError

OLD_SPELLINGS = {"figures": "figure", "plot": "figure", "png": "out"}
"""Options that were called otherwise once: still understood, no longer listed."""
OLD_SPELLINGS_OF_GROUPS = {"study": {"of": "action"}}
"""The same in the commands of a group."""

HOUSE = Path(__file__).resolve().parents[1]
PACKAGES = ("model", "vision", "rig", "validation")

STYLE: dict[str, Any] = {
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


class LazyGroup(TyperGroup):
    """The commands of a table, each imported when it is run or its own help is asked for."""

    prefix = ""

    def __init__(self, prefix: str = "", **attributes: Any) -> None:
        super().__init__(**attributes)
        self.prefix = prefix
        self.table = commands.GROUPED[prefix] if prefix else commands.COMMANDS
        self.commands: Any = dict.fromkeys(self.table)  # the names, also for "Did you mean …?"

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command or group of this name for typer, with its old spellings; its module is imported only now. None
        where there is none."""
        if cmd_name not in self.table:
            return None
        if cmd_name in commands.GROUPED:
            return _group(cmd_name)
        single = typer.Typer(add_completion=False, **STYLE)
        single.command(cmd_name)(commands.load(f"{self.prefix} {cmd_name}".strip()))
        command = get_command(single)
        old = OLD_SPELLINGS | OLD_SPELLINGS_OF_GROUPS.get(self.prefix, {})
        command.context_settings["token_normalize_func"] = lambda name: old.get(name, name)
        command.help = _keep_example_lines(command.help or "")
        for parameter in command.params:
            if isinstance(parameter, TyperArgument):
                parameter.metavar = parameter.metavar or (parameter.name or "").upper()
                parameter.get_usage_pieces = _usage_piece(parameter)  # type: ignore[method-assign]
        return command

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the group; without any it prints its help."""
        return super().parse_args(ctx, args or ["--help"])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that ``args[0]`` names, for typer; a retired or misspelt one ends with a usage error that
        says what replaced it or comes near."""
        name = f"{self.prefix} {args[0]}".strip() if args else ""
        if name in commands.RETIRED_COMMANDS:
            ctx.fail(f"There is no command {name!r} any more: {commands.RETIRED_COMMANDS[name]}.")
        near = difflib.get_close_matches(args[0], self.table, n=1) if args else []
        if self.prefix == "study" and args and not near:  # `study ACTION`, as it was typed once
            args = ["variants", "--action", *args]
        if args and args[0] not in self.table:
            hint = f" Did you mean {near[0]!r}?" if near else ""
            ctx.fail(f"No such command {name!r}.{hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands into typer's help, by heading, each with its first line; none is imported."""
        width = max(map(len, self.table))
        headings = {"Commands": list(self.table)} if self.prefix else commands.groups()
        if not self.prefix:
            formatter.write_paragraph()
            formatter.write_heading("Commands")
        for title, names in headings.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), self.table[name].help) for name in names])

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an interrupt that it does not explain itself is told in one line."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            name = f"{self.prefix} {ctx.invoked_subcommand or ''}".strip() or "pianorig"
            raise Interrupted(f"{name} {how_stopped(interrupt)}; files are written whole or not at all") from interrupt


def _group(name: str) -> LazyGroup:
    """The group ``name`` of commands (such as ``calibrate``) for typer; the module of a command is imported when that
    is called."""
    return LazyGroup(
        name,
        name=name,
        help=commands.COMMANDS[name].help,
        rich_markup_mode=None,
        context_settings=STYLE["context_settings"],
    )


def _usage_piece(argument: TyperArgument) -> Any:
    text = f"{argument.metavar}{'...' if argument.nargs != 1 else ''}"
    return lambda ctx: [text if argument.required else f"[{text}]"]


def _keep_example_lines(text: str) -> str:
    """Help whose paragraphs of examples are not wrapped, so that they can be copied."""
    mark = "\b\n"
    return "\n\n".join(mark + part if part.lstrip().startswith("Example:") else part for part in text.split("\n\n"))


app = typer.Typer(
    name="pianorig",
    cls=LazyGroup,
    help="Play a piano action with a motor, measure and film it, and see how well a model predicts it.",
    epilog="Exit codes: 0 success, 2 bad input, 3 hardware or safety, 1 defect, 130 stopped by Ctrl-C.",
    **STYLE,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib import metadata  # start-up: 10 ms that no command needs

        print(f"pianorig {metadata.version('piano-action-rig')}")
        raise typer.Exit


@app.callback()
def _set_global_options(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
    version: bool = typer.Option(
        False, "--version", help="Show the version and exit.", callback=_print_version, is_eager=True
    ),
) -> None:
    """Set the environment variable ``PIANORIG_DEBUG`` for ``--debug``, by which errors show their traceback;
    ``--version`` prints and ends."""
    if debug:
        os.environ["PIANORIG_DEBUG"] = "1"


def _make_warning_printer() -> Callable[..., None]:
    """Return a replacement of `warnings.showwarning` that prints ``warning: text`` on standard error, each text once,
    without the line of source."""
    shown: set[str] = set()

    def show(message: Warning | str, *where: Any, **more: Any) -> None:
        text = " ".join(str(message).split())
        if text not in shown:
            say(f"warning: {text}")
        shown.add(text)

    return show


def refuse_shadowed_packages() -> None:
    """CommandInputError where Python would find one of our packages (``model``, ``rig``, …) anywhere but beside this
    one; nothing is imported.

    Their names are common: a file ``model.py`` in the current folder, or another project
    installed beside this one, would be imported in place of ours (docs/explanation/page.md).
    """
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        places = [] if spec is None else [spec.origin, *(spec.submodule_search_locations or [])]
        found = next((Path(place) for place in places if place and place != "frozen"), None)
        if found is None:
            raise CommandInputError(f"package {name}: not found in {HOUSE}; install piano-action-rig again")
        if found.resolve() not in (HOUSE / name / "__init__.py", HOUSE / name):
            raise CommandInputError(
                f"package {name}: Python finds {found}, not {HOUSE / name} of piano-action-rig; rename it, start from "
                "another folder, or install piano-action-rig into an environment of its own"
            )


def main(arguments: list[str] | None = None) -> None:
    """Run the command line with ``arguments`` (None: those of the process; none given: the help), print errors as one
    line, and end the process with the exit code: it never returns."""
    given = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    as_json = "--json" in given[: given.index("--") if "--" in given else None]
    write_what_the_terminal_can()
    warnings.showwarning = _make_warning_printer()
    # a command keeps most of what it allocates until it ends: passes of the collector, the last one above all, find
    # nothing and would take a fifth of the time (docs/explanation/lanes.md)
    gc.set_threshold(100_000, 20, 50)  # choice: some hundred times Python's own
    atexit.register(gc.freeze)
    try:
        refuse_shadowed_packages()
        if arguments is None and not as_json:  # a program that calls `main` keeps its standard error
            tell_when_compiling()
        code = app(args=given, prog_name="pianorig", standalone_mode=False)
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except Exception as problem:
        if os.environ.get("PIANORIG_DEBUG") and not hasattr(problem, "format_message"):
            raise
        raise SystemExit(tell_failure(problem, as_json)) from None
    raise SystemExit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
