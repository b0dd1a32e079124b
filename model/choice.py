"""What a scene contains and gives out: built-in names and small TOML files, for ``simulate(scene=...)``.

    bodies = ["key", "whippen"]            # default: all; a body brings its contacts with the bodies that are there
    without = ["contact12", "jack_spring"] # contacts and springs to leave out
    outputs = ["contact_forces", "energy"] # beyond angles and speeds

What is left out is not in the compiled kernels. A new structure compiles once (seconds), then comes from the disk.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import InputError
from .parameters import BODIES, CONTACTS

SPRINGS = ("jack_spring", "repetition_spring")
OUTPUTS = ("contact_forces", "energy", "inside")


@dataclass(frozen=True)
class SceneChoice:
    """Bodies that take part, contacts and springs left out, outputs wanted."""

    bodies: tuple[str, ...] = BODIES
    without: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse names that do not exist and children without their parent."""
        for name, found, allowed in (
            ("bodies", self.bodies, BODIES),
            ("without", self.without, (*CONTACTS, *SPRINGS)),
            ("outputs", self.outputs, OUTPUTS),
        ):
            for item in found:
                if item not in allowed:
                    raise InputError(f"scene: {name}: found {item!r}, allowed {', '.join(allowed)}")
        for child in ("jack", "repetition"):
            if child in self.bodies and "whippen" not in self.bodies:
                raise InputError(f"scene: bodies: {child} hangs from the whippen; add whippen or leave out {child}")
        if "key" not in self.bodies:
            raise InputError("scene: bodies: found no key, allowed scenes with the key, on which the force acts")


SCENES = {
    "whole": SceneChoice(),
    "without-string": SceneChoice(without=("contact12",)),
    "key": SceneChoice(bodies=("key",)),
    "key-whippen": SceneChoice(bodies=("key", "whippen")),
}


def load_scene(name_or_path: str | Path | SceneChoice) -> SceneChoice:
    """A choice by built-in name or from a TOML file; ``InputError`` says what is allowed."""
    if isinstance(name_or_path, SceneChoice):
        return name_or_path
    if str(name_or_path) in SCENES:
        return SCENES[str(name_or_path)]
    path = Path(name_or_path)
    if path.suffix != ".toml":
        raise InputError(f"scene {str(path)!r}: not found; built in: {', '.join(SCENES)}; or name a .toml file")
    try:
        table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
        raise InputError(f"{path}: is not valid TOML: {problem}") from None
    chosen = {}
    for key, value in table.items():
        if key not in ("bodies", "without", "outputs"):
            raise InputError(f"{path}: {key}: unknown key; allowed bodies, without, outputs")
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise InputError(f"{path}: {key}: found {value!r}, allowed a list of names")
        chosen[key] = tuple(value)
    if "bodies" in chosen:
        chosen["bodies"] = tuple(b for b in BODIES if b in chosen["bodies"]) + tuple(
            b for b in chosen["bodies"] if b not in BODIES
        )
    return SceneChoice(**chosen)
