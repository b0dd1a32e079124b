"""Rest state after a technician lifts the hammer by hand and lets it down on the jack.

Statics has no friction, so an action that is out of regulation may also balance with the jack slipped out from under
the knuckle, and a search may end there. Here the search starts with the hammer above the jack, from several places if
need be, and the balance with the jack best under the knuckle is taken. Raises ``StaticsError`` where nothing balances.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import StaticsError
from model.parameters.action import BODIES, JACK_KNUCKLE, Action, ActionLike, as_action
from model.scene.build import build_scene
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

LIFTS = ((0.15, 0.05), (0.05, 0.0), (0.1, 0.0))  # rad: hammer above, jack turned out of, where they usually rest
SHORT_LIFT = 0.03  # rad, above where the rest of the action has settled
WELL_UNDER_RAD = math.radians(10.0)  # of the knuckle around the jack's edge: the jack stands well under it
KEY, JACK, HAMMER = (BODIES.index(b) for b in ("key", "jack", "hammer"))


def slip_angle(action: Action, angle_rad: Array) -> Array:
    """Angle (rad) of the knuckle around the jack's top edge, (m,), from angles (m, 5): 0 on top, pi/2 beside it."""

    def place(body: str, path: str, parent: tuple[Any, Array] | None) -> tuple[Any, Array]:
        angle = angle_rad[:, BODIES.index(body)]
        x, y = np.full(len(angle), action[f"{path}.x"]), np.full(len(angle), action[f"{path}.y"])
        if parent is None:
            return x + 1j * y, angle
        return parent[0] + (x + 1j * y) * np.exp(1j * parent[1]), angle + parent[1]

    whippen = place("whippen", "whippen.pivot", None)
    jack = place("jack", "jack.pivot", whippen)
    hammer = place("hammer", "hammer.pivot", None)
    edge = complex(action[f"{JACK_KNUCKLE}.second.x"], action[f"{JACK_KNUCKLE}.second.y"])
    knuckle = complex(action[f"{JACK_KNUCKLE}.first.x"], action[f"{JACK_KNUCKLE}.first.y"])
    way = hammer[0] + knuckle * np.exp(1j * hammer[1]) - jack[0] - edge * np.exp(1j * jack[1])
    top = np.exp(1j * (jack[1] + action[f"{JACK_KNUCKLE}.second.arc_start"]))
    out: Array = np.angle(way / top)
    return out


def _starts(usual: Array, found: list[Array]) -> Iterator[Array]:
    """Yield start states (n,), rad: hammer lifted and jack turned back from ``usual``; then those of ``found``, which
    the caller fills meanwhile, with the jack as usual."""
    for lift, room in LIFTS:
        start = usual.copy()
        start[HAMMER] -= lift
        start[JACK] -= room
        yield start
    for settled in list(found):  # everything else as it settled, the jack back on its pad
        start = settled.copy()
        start[JACK] = usual[JACK]
        start[HAMMER] -= SHORT_LIFT
        yield start


def hand_set_rest(action: ActionLike) -> Array:
    """Angles (n,), rad from ground or parent, the five bodies' first, at rest after the hammer is lifted by hand and
    let down on the jack; `StaticsError` where no balance is found.

    Parameters
    ----------
    action : parameter set

    Returns
    -------
    ndarray
        Angles (n,), rad, those of `model.BODIES` first.

    Raises
    ------
    StaticsError : no such balance was found

    Examples
    --------
    >>> import model
    >>> model.hand_set_rest(model.load_action("hirschkorn2004-regulated")).shape
    (5,)
    """
    action = as_action(action)
    scene = build_scene(action)
    found: list[Array] = []
    problem: StaticsError | None = None
    for start in _starts(scene.start, found):
        try:
            found.append(solve_rest(scene, 0.0, start))
        except StaticsError as caught:
            problem = caught
            continue
        if abs(slip_angle(action, found[-1][None, :])[0]) < WELL_UNDER_RAD:
            return found[-1]
    if not found:
        raise problem or StaticsError("rest state: not found")
    return min(found, key=lambda q: abs(float(slip_angle(action, q[None, :])[0])))
