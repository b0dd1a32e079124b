"""A blow on the action as it is set, fast enough to follow a slider: curves, events, the moving action."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from model.files.force_library import KNOTS
from model.inside.seen_motion import see_motion
from pianorig.page.action.changed_action import changed_action
from pianorig.player.moving_action import moving_action
from pianorig.player.packing import pack
from validation.conventions import BODIES, ENCODER_BODIES
from validation.curves.signs import TITLE, degrees
from validation.events.definitions import EVENTS
from validation.events.detect import find_events
from validation.measurement.geometry import geometry_of, motion_of
from vision.output.colours import colour_of

RATE_HZ = 5000.0
EVERY, DRAWN = 5, 2  # a pose and a drawn sample for so many samples
QUIET_S = 0.02  # every built-in blow begins later than this
TOLERANCE_RAD = 1e-5
BLOWS = tuple(KNOTS)
KEPT = 8


@dataclass(frozen=True, eq=False)
class _Blow:
    """A blow as it was computed."""

    action: model.Action
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    solution: model.Solution
    rest_rad: NDArray[np.float64]


@lru_cache(maxsize=KEPT)
def _blow(name: str, changes: tuple[str, ...], blow: str, scene: str) -> _Blow:
    """Computed once for curves and all else; the same words always give the same blow."""
    action = changed_action(name, changes, scene)
    table_s, table_n = model.force_table(blow)
    times = model.output_times(float(table_s[0]), float(table_s[-1]), RATE_HZ)
    solution = model.simulate(
        action, table_s, table_n, output_time_s=times, tolerance=TOLERANCE_RAD,
        contact_forces=model.build_scene(action).remembers,
    )  # fmt: skip
    return _Blow(action, times, np.interp(times, table_s, table_n), solution, model.rest_state(action).angle_rad)


def blow_curves(name: str, changes: Sequence[str], blow: str, scene: str = "whole") -> dict[str, Any]:
    """What follows a slider at once: angles under a built-in blow, and nothing else.

    Parameters
    ----------
    name, changes, scene : as for `changed_action`
    blow : one of `BLOWS`

    Raises
    ------
    CommandInputError, model.InputError : no such action, scene, blow or parameter, or a value that is not allowed
    model.StaticsError, model.IntegrationError : the action cannot rest or move like this
    """
    found = _blow(name, tuple(changes), blow, scene)
    turned = found.solution.angle_rad[::DRAWN] - found.rest_rad
    bodies = found.solution.bodies
    return {"values": [pack(degrees(body, turned[:, i])) for i, body in enumerate(bodies) if body in BODIES]}


def live_blow(name: str, changes: Sequence[str], blow: str, scene: str = "whole") -> dict[str, Any]:
    """Motion of an action under a built-in blow: curves, events, the moving action.

    Parameters, errors: as `blow_curves`.
    """
    found = _blow(name, tuple(changes), blow, scene)
    times, solution = found.time_s, found.solution
    rows = slice(None, None, EVERY)
    seen = see_motion(
        model.build_scene(found.action),
        times[rows],
        solution.angle_rad[rows],
        solution.speed_rad_per_s[rows],
        found.force_n[rows],
        None if solution.contact_normal_n is None else solution.contact_normal_n[rows],
    )
    shown = [body for body in solution.bodies if body in BODIES]
    channels = {
        body: {"title": TITLE[body], "color": colour_of(body, BODIES.index(body)), "value": value}
        for body, value in zip(shown, blow_curves(name, changes, blow, scene)["values"], strict=True)
    }
    return {
        "time_s": pack(times[::DRAWN]),
        "force_n": pack(found.force_n[::DRAWN]),
        "channels": channels,
        "drawing": moving_action(seen),
        "events": _events(found) if shown == [*BODIES] else [],
    }


def _events(blow: _Blow) -> list[dict[str, Any]]:
    """What happens in the blow, by the report's definitions, in the units it shows."""
    change, geometry = blow.solution.angle_rad - blow.rest_rad, geometry_of(blow.action, blow.rest_rad[: len(BODIES)])
    motion = motion_of(geometry, blow.time_s, change[:, ENCODER_BODIES], np.full(3, TOLERANCE_RAD))
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
