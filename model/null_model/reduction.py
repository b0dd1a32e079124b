"""Reduce an action to one degree of freedom: mass, balance and friction reflected along its static paths.

The coordinate is the key's turn sigma from rest, rad, positive as the front goes down. For each sigma the other bodies
are in equilibrium without friction (felt as a spring), on one of two paths:

- *joined*: the hammer on the jack, the jack on its rest pad (friction under the knuckle holds it there);
- *away*: no hammer on the action.

With J = dq/dsigma along a path and f(q, v, u) the generalised forces of the five-body model at u newton on the key,

    M = J'M(q)J,  pull = J'f(q, 0, 0),  lever = J'f(q, 0, 1) - pull,
    M s'' + 1/2 dM/dsigma s'^2 = pull + lever u - dry tanh(s'/omega_t) - damp s',

where dry and damp are the odd part of J'f(q, Js', 0) in s', taken at two speeds: joint and contact friction, and felt.
Let-off is where the jack meets the button on the joined path. Tables over sigma are interpolated linearly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import DEPTH, NORMAL
from model.observables import hammer_height_from_angle
from model.parameters.action import BACK_CHECK, BODIES, BUTTON, CONTACTS, USUAL, Action, ActionLike, as_action
from model.scene.build import Scene, build_scene
from model.scene.selection import choice_of
from model.simulation.hand_set_rest import hand_set_rest
from model.simulation.statics import balance, solve_rest

Array = NDArray[np.float64]

KEY, JACK, HAMMER = (BODIES.index(b) for b in ("key", "jack", "hammer"))
STEP = 2.5e-4  # rad between the points of a path
DOWN_N, UP_N = 400.0, 200.0  # force on the key at which the paths end; the rig stops at 120 N, a sudden force doubles
MOST_POINTS = 2000  # of a static path
SLOW, FAST = 1.0, 2.0  # rad/s of the key: friction slides fully at both
STILL_OPEN = 1e-4  # rad below the string at which the hammer is parked for the path without it


@dataclass(frozen=True)
class Path:
    """One static path over sigma: states and reflected quantities."""

    # angle_rad, ratio: (p, 5) angles, and their derivatives by sigma
    angle_rad: Array
    ratio: Array
    mass: Array  # (p,) kg m^2
    pull: Array  # (p,) N m at rest without force
    lever: Array  # (p,) N m per N on the key
    dry: Array  # (p,) N m of friction
    damp: Array  # (p,) N m s of felt


@dataclass(frozen=True)
class Reduced:
    """An action with one degree of freedom and a hammer that can fly.

    Attributes
    ----------
    sigma : (p,) rad, evenly spaced
    joined, away : paths over ``sigma``; ``joined`` repeats its last row past let-off
    let_off : sigma at which the jack meets the button, inf where it never does
    rest_rad : (5,)
    up : +1 or -1, sense of the hammer's angle towards the string
    hammer_inertia : about its pivot, kg m^2
    string_rad : how far the hammer turns from rest to the string
    check_rad : (p,) how far above rest the back check catches it; -inf where it does not
    """

    sigma: Array
    joined: Path
    away: Path
    let_off: float
    rest_rad: Array
    up: float
    hammer_inertia: float
    string_rad: float
    check_rad: Array


def _static_states(
    scene: Scene, rest: Array, direction: float, held: tuple[int, ...], points: int | None
) -> list[Array]:
    """Static states (5,) from ``rest`` on, the key turned in steps along ``direction`` (±1) with ``held`` coordinates
    fixed: ``points`` of them, or (None) up to a limit of force."""
    out, q = [], rest.copy()
    limit = DOWN_N if direction < 0.0 else UP_N
    for _ in range(MOST_POINTS if points is None else points):
        q = q.copy()
        q[KEY] += direction * STEP
        q = solve_rest(scene, 0.0, q, held)
        out.append(q)
        if points is None:
            f, unit = balance(scene, q, 0.0)[0][KEY], balance(scene, q, 1.0)[0][KEY]
            if abs(f / (unit - f)) > limit:
                break
    return out


def _reflected_quantities(scene: Scene, angle_rad: Array, sense: float) -> Path:
    """Mass, pull, force ratio, friction and damping of all bodies reflected to the key along states (p, 5), with these
    angles and ratios; ``sense``: sign of the key's angle as its front goes down."""
    ratio = np.gradient(angle_rad, STEP, axis=0)
    ratio[:, KEY] = sense  # exact
    rows = np.empty((len(ratio), 5))
    for i, (q, j) in enumerate(zip(angle_rad, ratio, strict=True)):
        still, _, mass = balance(scene, q, 0.0)
        pull, unit = j @ still, j @ balance(scene, q, 1.0)[0]
        slow, fast = (
            0.5 * j @ (balance(scene, q, 0.0, -j * w)[0] - balance(scene, q, 0.0, j * w)[0]) for w in (SLOW, FAST)
        )
        damp = (fast - slow) / (FAST - SLOW)
        rows[i] = j @ mass @ j, pull, unit - pull, max(0.0, slow - damp * SLOW), max(0.0, damp)
    mass, pull, lever, dry, damp = rows.T
    return Path(angle_rad, ratio, mass, pull, lever, dry, damp)


def _penetration(scene: Scene, name: str, q: Array) -> float:
    """Penetration of a contact (m), negative where open; -inf where the scene has no such contact."""
    if name not in scene.contacts:
        return -np.inf
    depth = contacts_at(scene.tables, scene.vector, q[None], np.zeros((1, scene.size)))[0, :, DEPTH]
    return float(depth[scene.contacts.index(name)])


def _catch_angle(scene: Scene, angle_rad: Array, rest: float, up: float, string: float) -> Array:
    """Highest hammer angle (p,), rad above rest, at which the back check touches a falling hammer, by key state (p, 5),
    -inf where it does not; ``string``: turn from rest to the string, ``up``: sign of that turn."""
    if BACK_CHECK not in scene.contacts:
        return np.full(len(angle_rad), -np.inf)
    column = scene.contacts.index(BACK_CHECK)

    def touches(height: Array) -> NDArray[np.bool_]:
        q = angle_rad.copy()
        q[:, HAMMER] = rest + up * height
        return np.asarray(contacts_at(scene.tables, scene.vector, q, np.zeros_like(q))[:, column, NORMAL] > 0.0)

    # an open place above and a touching one below, per position of the key
    high, low = np.full(len(angle_rad), np.nan), np.full(len(angle_rad), np.nan)
    steps = np.linspace(string, 0.0, 41)  # each is refined: choice, a contact opens once
    for above, below in zip(steps[:-1], steps[1:], strict=True):
        new = np.isnan(low) & touches(np.full(len(angle_rad), below))
        high[new], low[new] = above, below
    for _ in range(16):
        middle = 0.5 * (high + low)
        touching = touches(middle)
        high, low = np.where(touching, high, middle), np.where(touching, middle, low)
    return np.where(np.isnan(low), -np.inf, low)


def _turn_to_string(action: Action, rest: float) -> tuple[float, float]:
    """Sign (+1 or -1) of the hammer's turn towards the string, and how far (rad) it turns from ``rest``, rad, to the
    string; inf beyond 1 rad."""
    turn = np.linspace(0.0, 1.0, 20001)  # rad, in steps of 0.05 mrad
    up = 1.0 if hammer_height_from_angle(action, rest + 1e-6) < hammer_height_from_angle(action, rest) else -1.0
    height = hammer_height_from_angle(action, rest + up * turn)
    beyond = np.flatnonzero(height <= 0.0)
    if not len(beyond):
        return up, float("inf")
    i = max(1, int(beyond[0]))
    return up, float(turn[i - 1] + (turn[i] - turn[i - 1]) * height[i - 1] / (height[i - 1] - height[i]))


def reduce_action(action: ActionLike) -> Reduced:
    """Tables, over the key's angle, of inertia, forces, friction and damping reflected to the key, with the hammer
    carried and away, from the action's parameters alone (no effects, the usual law of felt).

    Parameters
    ----------
    action : parameter set

    Returns
    -------
    Reduced
        Tables over the key's angle, rad.

    Raises
    ------
    InputError : a scene that lacks a body
    StaticsError : no balance at some position of the key

    Examples
    --------
    >>> import model
    >>> reduced = model.null_model.reduce_action(model.load_action())
    >>> reduced.rest_rad.shape
    (5,)
    """
    action = as_action(action)
    choice = replace(choice_of(action), effects=())  # the yardstick knows no effects and one law
    choice.need_played_key(action.name)
    action = choice.apply_to(replace(action, changed={})).with_laws(dict.fromkeys(CONTACTS, USUAL))
    scene, rest = build_scene(action), hand_set_rest(action)
    lever = balance(scene, rest, 1.0)[0][KEY] - balance(scene, rest, 0.0)[0][KEY]
    sense = 1.0 if lever > 0.0 else -1.0  # of the key's angle as its front goes down
    up, string = _turn_to_string(action, float(rest[HAMMER]))

    parked = rest.copy()
    parked[HAMMER] = rest[HAMMER] + up * (min(string, 1.0) - STILL_OPEN)
    parked = solve_rest(scene, 0.0, parked, (KEY, HAMMER))
    above = _static_states(scene, parked, -sense, (KEY, HAMMER), None)
    below = _static_states(scene, parked, sense, (KEY, HAMMER), None)
    away = np.array([*above[::-1], parked, *below])
    sigma = sense * (away[:, KEY] - rest[KEY])

    joined = [*_static_states(scene, rest, -sense, (KEY, JACK), len(above))[::-1], rest]
    let_off, before = np.inf, _penetration(scene, BUTTON, rest)
    for _ in below:
        joined += _static_states(scene, joined[-1], sense, (KEY, JACK), 1)
        depth = _penetration(scene, BUTTON, joined[-1])
        if depth > 0.0:
            let_off = float(sigma[len(joined) - 1] - STEP * min(1.0, depth / max(depth - before, 1e-15)))
            joined[-1] = 2.0 * joined[-2] - joined[-3]  # as if there were no button
            break
        before = depth
    path = _reflected_quantities(scene, np.array(joined), sense)
    missing = len(sigma) - len(joined)
    path = Path(*(np.concatenate([a, np.repeat(a[-1:], missing, axis=0)]) for a in vars(path).values()))
    without = _reflected_quantities(scene, away, sense)
    without.ratio[:, HAMMER] = 0.0
    return Reduced(
        sigma=sigma,
        joined=path,
        away=without,
        let_off=let_off,
        rest_rad=rest,
        up=up,
        hammer_inertia=float(balance(scene, rest, 0.0)[2][HAMMER, HAMMER]),
        string_rad=string,
        check_rad=_catch_angle(scene, away, float(rest[HAMMER]), up, min(string, 1.0)),
    )
