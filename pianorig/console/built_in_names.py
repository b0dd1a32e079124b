"""Names a shell can complete: built-in profiles, rigs, actions and scenes, found without importing what reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

HOUSE = Path(__file__).resolve().parents[2]
SCENES = (
    "whole", "without-string", "key", "key-whippen", "lifting-key", "flexible-shank", "motor-arm", "motor-drive",
    "motor-voltage", "compliant-tip", "finger", "string", "lifting-key-flexible-shank", "giving-hammer",
    "giving-joints",
)  # fmt: skip
"""Those of ``model.SCENES``, which a test compares: importing it would cost a second of NumPy and numba."""


def complete_file(folder: str) -> Callable[[str], list[str]]:
    """A completion by the names of the TOML files in one of our folders, such as ``rig/profiles``."""

    def complete(incomplete: str) -> list[str]:
        names = sorted(path.stem for path in (HOUSE / folder).glob("*.toml"))
        return [name for name in names if name.startswith(incomplete)]

    return complete


def complete_scene(incomplete: str) -> list[str]:
    """A completion by the names of the scenes."""
    return [name for name in SCENES if name.startswith(incomplete)]
