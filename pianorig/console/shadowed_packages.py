"""Another package under one of our names, found first by Python, is named before it can do harm.

The five packages have common names (``model``, ``rig`` …). A file ``model.py`` in the current folder, or another
project installed beside this one, would be imported in place of ours (docs/explanation/page.md).
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from pianorig.errors import CommandInputError

HOUSE = Path(__file__).resolve().parents[2]
PACKAGES = ("model", "vision", "rig", "validation")


def refuse_shadowed_packages() -> None:
    """Check, without importing them, that Python finds our packages beside this one.

    Raises
    ------
    CommandInputError : another package or file has the name, or one of ours is missing
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
