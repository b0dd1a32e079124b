"""The action to try out: screws and parameters turned, a blow at once, the touch, a technician's step, a file of it."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from model.files.force_library import KNOTS, RATE_HZ
from model.inside.body_poses import observe_poses
from model.parameters.action import action_text
from model.parameters.quantity import allowed_range
from model.regulation.screws import limits
from model.tolerance import DEFAULT_TOLERANCE
from pianorig.errors import CommandInputError
from pianorig.player.moving_action import moving_action, pack
from validation.conventions import BODIES, ENCODER_BODIES
from validation.curves.display_signs import TITLE, degrees
from validation.events.definitions import EVENTS
from validation.events.detect import find_events
from validation.measurement.geometry import geometry_of, motion_of
from validation.part_names import part_name
from vision.output.colours import body_colour

MOST_CHANGES = 200  # of one action: more than its sliders
MOST_TEXT = 4000  # letters of a scene's text, which is part of an address
COUNTS = ("string.modes", "string.unisons")
LENGTH_M = 5e-3  # a slider reaches so far to either side of a length
TIMES = 4.0  # a slider goes from a quarter of another quantity to this many times of it
TILT = 0.05  # of a component of a normal, whose length must stay near 1
SCREWS = (*model.regulation.SCREWS, model.regulation.REST_RAIL)

_DRIVEN = "scene {}: driven by {}, the blows of this page by force_n; pianorig simulate --scene plays a table of it"


def built_in_actions() -> list[str]:
    folder = Path(model.__file__).parent / "actions"
    return sorted(path.stem for path in folder.glob("*.toml"))


def chosen_scene(text: str) -> model.SceneChoice:
    """The scene of this built-in name, or that the text of a scene file (TOML) describes; CommandInputError for
    anything else, or a scene that no force drives. No file is opened."""
    if text in model.SCENES:
        choice = model.SCENES[text]
    elif "\n" in text or "=" in text:
        if len(text) > MOST_TEXT:
            raise CommandInputError(f"scene: {len(text)} letters, allowed {MOST_TEXT}")
        try:
            choice = model.scene_of(tomllib.loads(text.removeprefix("\ufeff")), "scene")
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
def _load_given_action(name: str, scene: str) -> model.Action:
    if name not in built_in_actions():
        raise CommandInputError(f"action {name[:80]!r}: allowed {', '.join(built_in_actions())}")
    return chosen_scene(scene).apply_to(model.load_action(name))


def changed_action(name: str, changes: Sequence[str], scene: str = "whole") -> model.Action:
    """The built-in action ``name`` in a scene (as `chosen_scene` takes it) with the texts ``path=value``, SI units,
    applied; CommandInputError for another form, or too many."""
    if len(changes) > MOST_CHANGES:
        raise CommandInputError(f"{len(changes)} changes: allowed {MOST_CHANGES}")
    values = {}
    for text in changes:
        path, _, value = text.partition("=")
        try:
            values[path] = float(value)
        except ValueError:
            raise CommandInputError(f"{text[:80]!r}: allowed path=value, the value a number in SI units") from None
    given = _load_given_action(name, scene)
    if not values:
        return given
    changed = given.with_values(values, "page")
    model.choice_of(changed).check(changed)
    return changed


def action_facts(name: str, scene: str = "whole") -> dict[str, Any]:
    """Screws and parameters of a built-in action in a scene as plain dicts for the page: path, name, value, unit,
    standard uncertainty, and the slider's lowest and highest value, SI units."""
    given = _load_given_action(name, scene)
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
        low, high = slider_range(path, quantity.value, quantity.unit)
        about = contacts.get(path.split(".")[0], "")
        facts = {
            "path": path,
            "name": _name(path, given),
            "value": quantity.value,
            "unit": quantity.unit,
            "u": quantity.u,
            "about": about,
        }
        of_scene = path not in given.quantities
        parameters.append({**facts, "low": low, "high": high, "of_scene": of_scene, "count": path in COUNTS})
    return {"name": name, "description": given.description, "screws": screws, "parameters": parameters}


def _name(path: str, action: model.Action) -> str:
    """What a technician calls a parameter, with what tells namesakes apart."""
    part, (_, *rest) = part_name(path, action), path.split(".")
    told = rest if rest[0] in ("first", "second") else rest[1:]
    return f"{part}, {'.'.join(told)}" if told else part


def slider_range(path: str, value: float, unit: str) -> tuple[float, float]:
    """Lowest and highest value of a parameter's slider, in its ``unit``: a fixed distance either way of a length or
    angle, a factor either way of any other quantity, within what is allowed."""
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
    """The action as the text of a TOML file that ``--action`` reads; its head names what was changed."""
    if action.content() == _load_given_action(action.name, "whole").content():
        raise CommandInputError(f"{action.name}: nothing was changed; use it by its name")
    quantities = model.quantities_of(action)
    words = [f"{path} = {value:.9g} {quantities[path].unit}" for path, value in action.changed.items()]
    return action_text(action, [f"{action.name}, changed on the page of `pianorig bench`:", *words])


EVERY, DRAWN = 5, 2  # a pose and a drawn sample for so many samples
QUIET_S = 0.02  # every built-in blow begins later than this
BLOWS = tuple(KNOTS)
KEPT = 8  # blows in memory: those that are flipped between


@lru_cache(maxsize=KEPT)
def _blow(
    name: str, changes: tuple[str, ...], blow: str, scene: str
) -> tuple[model.Action, NDArray[np.float64], model.Solution, NDArray[np.float64]]:
    """Simulate a built-in blow on a changed action: the action, the force (m,), N, at the solution's times, the
    solution, the angles at rest (n,), rad. Cached: the same arguments give the same objects."""
    action = changed_action(name, changes, scene)
    table_s, table_n = model.force_table(blow)
    times = model.output_times(float(table_s[0]), float(table_s[-1]), RATE_HZ)
    solution = model.simulate(
        action, table_s, table_n, output_time_s=times, tolerance=DEFAULT_TOLERANCE,
        contact_forces=model.build_scene(action).remembers,
    )  # fmt: skip
    return action, np.interp(times, table_s, table_n), solution, model.rest_state(action).angle_rad


def blow_curves(name: str, changes: Sequence[str], blow: str, scene: str = "whole") -> dict[str, Any]:
    """Angles (degrees from rest) of the bodies under a built-in blow (`BLOWS`), packed for the page: what follows a
    slider at once."""
    _, _, solution, rest_rad = _blow(name, tuple(changes), blow, scene)
    turned = solution.angle_rad[::DRAWN] - rest_rad
    return {"values": [pack(degrees(body, turned[:, i])) for i, body in enumerate(solution.bodies) if body in BODIES]}


def live_blow(name: str, changes: Sequence[str], blow: str, scene: str = "whole") -> dict[str, Any]:
    """Simulate an action with ``changes`` (path=value) under a built-in blow: force, N, angle curves, degrees, as
    packed float32 (`pack`), the moving drawing, and the events, for the page."""
    action, force_n, solution, rest_rad = _blow(name, tuple(changes), blow, scene)
    times = solution.time_s
    rows = slice(None, None, EVERY)
    seen = observe_poses(
        model.build_scene(action),
        times[rows],
        solution.angle_rad[rows],
        solution.speed_rad_per_s[rows],
        force_n[rows],
        None if solution.contact_normal_n is None else solution.contact_normal_n[rows],
    )
    shown = [body for body in solution.bodies if body in BODIES]
    channels = {
        body: {"title": TITLE[body], "color": body_colour(body, BODIES.index(body)), "value": value}
        for body, value in zip(shown, blow_curves(name, changes, blow, scene)["values"], strict=True)
    }
    return {
        "time_s": pack(times[::DRAWN]),
        "force_n": pack(force_n[::DRAWN]),
        "channels": channels,
        "drawing": moving_action(seen),
        "events": _events(action, solution, rest_rad) if shown == [*BODIES] else [],
    }


def _events(action: model.Action, solution: model.Solution, rest_rad: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Events of a simulated blow, found by the report's definitions, a dict each: title, meaning, value in the unit
    shown (None where absent), time, s, for those that are a time; ``rest_rad``: (n,)."""
    change, geometry = solution.angle_rad - rest_rad, geometry_of(action, rest_rad[: len(BODIES)])
    motion = motion_of(geometry, solution.time_s, change[:, ENCODER_BODIES], np.full(3, DEFAULT_TOLERANCE))
    rows = []
    for event in find_events(motion, int(QUIET_S * RATE_HZ)).values():
        kind = EVENTS[event.name]
        found = event.status != "absent" and math.isfinite(event.value)
        rows.append(
            {
                "name": event.name,
                "title": kind.title,
                "unit": kind.display_unit,
                "meaning": kind.definition,
                "value": event.value * kind.display_factor if found else None,
                "time_s": event.value if found and kind.unit == "s" else None,
                "note": event.note,
            }
        )
    return rows


LARGEST_TURN_M = LENGTH_M


def measure_touch(action: model.Action) -> dict[str, Any]:
    """Press and release the key of an action slowly: force, N, over dip, m, of either way, as packed float32 (`pack`),
    and the touch weights read from them, N, by name."""
    found = model.touch.weigh(action)
    (down_m, down_n), (up_m, up_n) = found.curve()
    return {
        "press": {"dip_m": pack(down_m), "force_n": pack(down_n)},
        "release": {"dip_m": pack(up_m), "force_n": pack(up_n)},
        "weights": {name: force for name, (force, _) in found.rows().items()},
        "dip_m": found.dip_m,
    }


def technician_step(action: model.Action, target: str, turn_m: float) -> dict[str, Any]:
    """Measure the seven regulated lengths, m, before and after the screw of the length ``target`` is turned by
    ``turn_m`` (None where one cannot be measured); the action given is not changed."""
    screw = next((screw for screw in model.regulation.SCREWS if screw.target == target), None)
    if screw is None:
        names = ", ".join(one.name for one in model.regulation.TARGETS)
        raise CommandInputError(f"target {target[:40]!r}: allowed {names}")
    if not abs(turn_m) <= LARGEST_TURN_M:
        raise CommandInputError(f"turn {1e3 * turn_m:g} mm: allowed up to {1e3 * LARGEST_TURN_M:g} mm either way")
    turned = action.with_values({screw.path: action[screw.path] + turn_m}, "page")
    before, after = model.regulation.measure(action), model.regulation.measure(turned)
    rows = [
        {
            "target": each.name,
            "words": each.words,
            "wanted_m": each.wanted_m,
            "before_m": before.value_m[each.name],
            "after_m": after.value_m[each.name],
            "remark": after.remarks.get(each.name) or before.remarks.get(each.name) or "",
        }
        for each in model.regulation.TARGETS
    ]
    return {"screw": screw.name, "path": screw.path, "turn_m": turn_m, "value": turned[screw.path], "rows": rows}
