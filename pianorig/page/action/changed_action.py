"""An action in a scene with changed values, as a request states them; what can be turned on it, and the file of it."""

from __future__ import annotations

import tomllib
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
MOST_TEXT = 4000  # letters of a scene's text, which is part of an address
COUNTS = ("string.modes", "string.unisons")
LENGTH_M = 5e-3  # a slider reaches so far to either side of a length
TIMES = 4.0  # a slider goes from a quarter of another quantity to this many times of it
TILT = 0.05  # of a component of a normal, whose length must stay near 1
SCREWS = (*model.regulation.SCREWS, model.regulation.REST_RAIL)

_DRIVEN = "scene {}: driven by {}, the blows of this page by force_n; pianorig simulate --scene plays a table of it"


def built_in_actions() -> list[str]:
    """Names of the actions that come with the program."""
    folder = Path(model.__file__).parent / "actions"
    return sorted(path.stem for path in folder.glob("*.toml"))


def chosen_scene(text: str) -> model.SceneChoice:
    """A scene by its built-in name, or from the text of a scene file; the server opens no file.

    Raises
    ------
    CommandInputError : no such scene, text that is not TOML, or a scene that no force on the key drives
    model.InputError : a key or value of the text that is not allowed
    """
    if text in model.SCENES:
        choice = model.SCENES[text]
    elif "\n" in text or "=" in text:
        if len(text) > MOST_TEXT:
            raise CommandInputError(f"scene: {len(text)} letters, allowed {MOST_TEXT}")
        try:
            choice = model.scene_of(tomllib.loads(text), "scene")
        except tomllib.TOMLDecodeError as problem:
            raise CommandInputError(f"scene: is not valid TOML: {problem}") from None
    else:
        raise CommandInputError(f"scene {text[:80]!r}: allowed {', '.join(model.SCENES)}, or the text of a scene file")
    if choice.input_column != "force_n":
        raise CommandInputError(_DRIVEN.format(text[:80], choice.input_column))
    return choice


def scenes() -> dict[str, str]:
    """Why a built-in scene cannot be shown, by its name; empty where it can."""
    driven = {name: choice.input_column for name, choice in model.SCENES.items()}
    return {name: "" if by == "force_n" else _DRIVEN.format(name, by) for name, by in driven.items()}


@lru_cache(maxsize=8)
def _given(name: str, scene: str) -> model.Action:
    if name not in built_in_actions():
        raise CommandInputError(f"action {name[:80]!r}: allowed {', '.join(built_in_actions())}")
    return chosen_scene(scene).on(model.load_action(name))


def changed_action(name: str, changes: Sequence[str], scene: str = "whole") -> model.Action:
    """A built-in action in a scene (`chosen_scene`) with ``path=value`` texts applied.

    Raises
    ------
    CommandInputError : no such action or scene, or a text that is none of ``path=value``
    model.InputError : an unknown path, one that plays no part in the scene, or a value that is not allowed
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
    given = _given(name, scene)
    if not values:
        return given
    changed = given.with_values(values, "page")
    model.choice_of(changed).check(changed)
    return changed


def action_facts(name: str, scene: str = "whole") -> dict[str, Any]:
    """Screws and parameters of an action in a scene, each with the reach of its slider, SI units.

    Raises
    ------
    CommandInputError, model.InputError : as `changed_action`
    """
    given = _given(name, scene)
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
    for path, quantity in model.quantities_of(given).items():
        low, high = reach(path, quantity.value, quantity.unit)
        about = contacts.get(path.split(".")[0], "")
        facts = {"path": path, "value": quantity.value, "unit": quantity.unit, "u": quantity.u, "about": about}
        of_scene = path not in given.quantities
        parameters.append({**facts, "low": low, "high": high, "of_scene": of_scene, "count": path in COUNTS})
    return {"name": name, "description": given.description, "screws": screws, "parameters": parameters}


def reach(path: str, value: float, unit: str) -> tuple[float, float]:
    """How far a slider goes: a few millimetres about a length, some times any other quantity.

    Examples
    --------
    >>> reach("hammer.mass", 0.01, "kg")
    (0.0025, 0.04)
    """
    if path in COUNTS:
        return allowed_range(path)[:2]
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
    if action.content() == _given(action.name, "whole").content():
        raise CommandInputError(f"{action.name}: nothing was changed; use it by its name")
    quantities = model.quantities_of(action)
    words = [f"{path} = {value:.9g} {quantities[path].unit}" for path, value in action.changed.items()]
    return action_text(action, [f"{action.name}, changed on the page of `pianorig bench`:", *words])
