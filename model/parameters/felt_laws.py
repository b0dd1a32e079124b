"""Laws of felt that each contact of an action may follow, and the parameters that those with memory add to it.

``contact02.law = "stulov"`` in an action's or a scene's file chooses one; ``contact02.stulov.epsilon`` and so on are
its numbers (`felt_laws.toml`: defaults with unit and source). Whatever the law, ``normal.a``, ``b``, ``c`` are the
felt's slow loading curve. Equations and rules: docs/explanation/felt.md.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from model.errors import InputError
from model.parameters.quantity import Quantity, quantity_tables, read_quantity

FILE = Path(__file__).with_name("felt_laws.toml")
HUNT_CROSSLEY, STULOV, HYSTERESIS = "hunt-crossley", "stulov", "hysteresis"
FELT_LAWS = (HUNT_CROSSLEY, STULOV, HYSTERESIS)


@cache
def law_defaults(contacts: tuple[str, ...]) -> Mapping[str, Quantity]:
    """Quantities of the laws with memory by path, for each of the contacts."""
    table = tomllib.loads(FILE.read_text(encoding="utf-8"))
    usual = {path: read_quantity(path, item, item["unit"], str(FILE)) for path, item in quantity_tables(table)}
    return {f"{contact}.{path}": quantity for contact in contacts for path, quantity in usual.items()}


def law_of(path: str) -> tuple[str, str] | None:
    """Contact and law that a parameter path belongs to, where it is one of a law with memory."""
    contact, _, rest = path.partition(".")
    law = rest.split(".")[0]
    return (contact, law) if law in (STULOV, HYSTERESIS) else None


def check_law(path: str, found: object, where: str) -> str:
    """The name of a law; ``InputError`` for any other."""
    if not isinstance(found, str) or found not in FELT_LAWS:
        raise InputError(f"{where}: {path}: found {found!r}, allowed {', '.join(FELT_LAWS)}")
    return found
