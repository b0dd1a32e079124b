"""Options that several commands have, so that each is named and explained in one way; a command gives its default."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from pianorig.errors import CommandInputError

HOUSE = Path(__file__).resolve().parents[2]
SCENES = (
    "whole", "without-string", "key", "key-whippen", "lifting-key", "flexible-shank", "motor-arm", "motor-drive",
    "motor-voltage", "compliant-tip", "finger", "string", "lifting-key-flexible-shank", "giving-hammer",
    "giving-joints",
)  # fmt: skip
"""Those of ``model.SCENES``, which a test compares: importing it would cost a second of NumPy and numba."""


def complete_file(folder: str) -> Callable[[str], list[str]]:
    """A function for the shell's completion, from what was typed to the names that begin with it of the TOML files in
    ``folder`` of our packages, such as ``rig/profiles``."""

    def complete(incomplete: str) -> list[str]:
        names = sorted(path.stem for path in (HOUSE / folder).glob("*.toml"))
        return [name for name in names if name.startswith(incomplete)]

    return complete


def complete_scene(incomplete: str) -> list[str]:
    return [name for name in SCENES if name.startswith(incomplete)]


def refuse_beside(ctx: typer.Context, option: str, why: str, *takes: str) -> None:
    """Refuse what was typed beside an option that ignores it, at its default value too; ``takes`` are what counts."""
    for one in ctx.command.params:
        source = ctx.get_parameter_source(one.name or "")
        if source is not None and source.name == "COMMANDLINE" and one.name not in (*takes, "as_json"):
            raise CommandInputError(f"{option}: {why}; leave out {one.opts[-1]}")


DEFAULT_ACTION = "hirschkorn2004"
BUILT_IN_ACTION = "Built-in action or a TOML file."
SESSIONS = Path("sessions")
"""Where sessions go when no folder is named."""
SELFTESTS = Path("selftests")
"""Where ``pianorig selftest`` puts its records."""

Figure: TypeAlias = Annotated[Path | None, typer.Option("--figure", help="Draw what was found: .svg, .pdf or .png.")]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Action: TypeAlias = Annotated[
    str, typer.Option("--action", help=BUILT_IN_ACTION, autocompletion=complete_file("model/actions"))
]
Scene: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--scene",
        help="What takes part: a built-in scene (see simulate --help) or a TOML file; default: what the action says.",
        autocompletion=complete_scene,
    ),
]
Settings: TypeAlias = Annotated[
    list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
]
Scale: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--scale",
        help="Parameter, law, pattern or group (damping, friction, joint_friction) to multiply, name=factor; "
        "may be repeated.",
    ),
]
Tolerance: TypeAlias = Annotated[float, typer.Option("--tolerance", help="Largest error of any predicted angle, rad.")]
Rig: TypeAlias = Annotated[
    str, typer.Option("--rig", help="Built-in rig or a TOML file.", autocompletion=complete_file("rig/rigs"))
]
Backend: TypeAlias = Annotated[
    str, typer.Option("--backend", help="sim://, in a scene sim://?scene=string; ni://local or ni-grpc://host:31763.")
]
Profile: TypeAlias = Annotated[
    str,
    typer.Option(
        "--profile", help="forte, piano, double, or a TOML file.", autocompletion=complete_file("rig/profiles")
    ),
]
Operator: TypeAlias = Annotated[str, typer.Option("--operator", help="Who operates the bench.")]
Yes: TypeAlias = Annotated[
    bool, typer.Option("--yes", help="On ni*://: do not ask, where safety.allow_yes of the rig file permits.")
]
Selftests: TypeAlias = Annotated[
    Path, typer.Option("--selftest", help="On ni*://: record of a self-test, or the folder of them.")
]
