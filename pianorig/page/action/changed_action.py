"""An action with changed values as a request states them, the parameters that can be turned, and the file of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import model
from model.parameters.quantity import allowed_range
from model.parameters.write_toml import action_text
from model.regulation.screws import limits
from pianorig.errors import CommandInputError

MOST_CHANGES = 200
LENGTH_M = 5e-3  # a slider reaches so far to either side of a length
TIMES = 4.0  # a slider goes from a quarter of another quantity to this many times of it
TILT = 0.05  # of a component of a normal, whose length must stay near 1
SCREWS = (*model.regulation.SCREWS, model.regulation.REST_RAIL)


def built_in_actions() -> list[str]:
    """Names of the actions that come with the program."""
    folder = Path(model.__file__).parent / "actions"
    return sorted(path.stem for path in folder.glob("*.toml"))


@lru_cache(maxsize=8)
def _given(name: str) -> model.Action:
    if name not in built_in_actions():
        raise CommandInputError(f"action {name[:80]!r}: allowed {', '.join(built_in_actions())}")
    return model.load_action(name)


def changed_action(name: str, changes: Sequence[str]) -> model.Action:
    """A built-in action with ``path=value`` texts applied.

    Raises
    ------
    CommandInputError : no such action, or a text that is none of ``path=value``
    model.InputError : an unknown path, or a value that is not allowed
    """
    if len(changes) > MOST_CHANGES:
        raise CommandInputError(f"{len(changes)} changes: allowed {MOST_CHANGES}")
    values = {}
    for text in changes:
        path, _, value = text.partition("=")
        try:
            values[path] = float(value)
        except ValueError:
            raise CommandInputError(f"{text[:80]!r}: allowed path=value, the value a number in SI units") from None
    given = _given(name)
    return given.with_values(values, "page") if values else given


def action_facts(name: str) -> dict[str, Any]:
    """Screws and parameters of an action, each with the reach of its slider, SI units.

    Raises
    ------
    CommandInputError : no such action
    """
    given = _given(name)
    contacts = {key.removesuffix(".description"): text for key, text in given.structure.items() if "description" in key}
    screws = []
    for screw in SCREWS:
        low, high = limits(given, screw)
        screws.append(
            {
                "name": screw.name,
                "path": screw.path,
                "target": screw.target if screw is not model.regulation.REST_RAIL else "",
                "low": given[screw.path] + low,
                "high": given[screw.path] + high,
            }
        )
    parameters = []
    for path, quantity in given.quantities.items():
        low, high = reach(path, quantity.value, quantity.unit)
        about = contacts.get(path.split(".")[0], "")
        facts = {"path": path, "value": quantity.value, "unit": quantity.unit, "u": quantity.u, "about": about}
        parameters.append({**facts, "low": low, "high": high})
    return {"name": name, "description": given.description, "screws": screws, "parameters": parameters}


def reach(path: str, value: float, unit: str) -> tuple[float, float]:
    """How far a slider goes: a few millimetres about a length, some times any other quantity.

    Examples
    --------
    >>> reach("hammer.mass", 0.01, "kg")
    (0.0025, 0.04)
    """
    if path.endswith((".normal.x", ".normal.y")):
        low, high = value - TILT, value + TILT
    elif unit in ("m", "rad") or value == 0.0:
        low, high = value - LENGTH_M, value + LENGTH_M
    else:
        low, high = sorted((value / TIMES, value * TIMES))
    least, most, beyond = allowed_range(path)
    if beyond and low <= least:  # the least itself is not allowed
        low = least + (value - least) / TIMES
    return max(low, least), min(high, most)


def toml_of(action: model.Action) -> str:
    """The action as the text of a TOML file that ``--action`` reads; its head names what was changed.

    Raises
    ------
    CommandInputError : nothing was changed
    """
    if not action.changed:
        raise CommandInputError(f"{action.name}: nothing was changed; use it by its name")
    words = [f"{path} = {value:.9g} {action.quantities[path].unit}" for path, value in action.changed.items()]
    return action_text(action, [f"{action.name}, changed on the page of `pianorig bench`:", *words])
