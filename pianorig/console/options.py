"""Options that several commands have, so that each is named and explained in one way; a command gives its default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

Rig: TypeAlias = Annotated[str, typer.Option("--rig", help="Built-in rig or a TOML file.")]
Backend: TypeAlias = Annotated[str, typer.Option("--backend", help="sim://, ni://local or ni-grpc://host:31763.")]
Yes: TypeAlias = Annotated[
    bool, typer.Option("--yes", help="On ni*://: do not ask, where safety.allow_yes of the rig file permits.")
]
Selftests: TypeAlias = Annotated[
    Path, typer.Option("--selftest", help="On ni*://: record of a self-test, or the folder of them.")
]
Scale: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--scale",
        help="Parameter, law, pattern or group (damping, friction, joint_friction) to multiply, name=factor; "
        "repeatable.",
    ),
]
