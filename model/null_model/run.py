"""Simulate a blow on the null model: the key's equation, and a hammer that rides, flies, rebounds and is caught.

The hammer *rides* on the jack until let-off, or until it would have to be pulled. It then *flies* under gravity alone.
At the string its speed reverses at once, by the restitution that the string contact's own law gives. While the jack
is out it is *caught*, without a bounce, where the back check first touches it, or else on the repetition lever, which
holds it as high as the jack did at let-off; the action then carries its weight. It rides again, sharing its angular
momentum, when the jack is back under it: at let-off or above, where the joined path meets it. A hammer in flight weighs
nothing. So the hammer stays between the joined path and the string; a key that leaves its tables is an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError, IntegrationError
from model.files.force_table import check_force_table
from model.force_driven import check_output_times
from model.null_model.reduction import HAMMER, KEY, Path, Reduced, reduce_action
from model.null_model.time_stepping import Constants, integrate
from model.parameters.action import BODIES, STRING, Action, ActionLike, as_action
from model.scene.selection import choice_of
from model.simulation.solution import Solution
from model.simulation.statics import RestState
from model.tolerance import DEFAULT_TOLERANCE

Array = NDArray[np.float64]

ROUNDING = 1e-9  # rad
STEP = 5e-5  # s; a sixtieth of the fastest swing of a key on its felt under 60 N


@dataclass(frozen=True)
class _ByContent:
    """Key of a cache: an action, compared and hashed by its content."""

    content: str
    action: Action = field(compare=False)


@lru_cache(maxsize=8)
def _cached_reduction(key: _ByContent) -> Reduced:
    return reduce_action(key.action)


def simulate(
    action: ActionLike,
    time_s: ArrayLike,
    force_n: ArrayLike,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    output_time_s: ArrayLike | None = None,
    initial: RestState | None = None,
) -> Solution:
    """Predict all bodies' motion by the null model (one degree of freedom and a hammer that can fly) under a force
    table on the key (N, down); called as ``model.simulate``, but ``tolerance`` does not act.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) force table, linear between its points, N, positive downwards
    tolerance : accepted so that calls match ``model.simulate``; the step is fixed, its error far below the model's
    output_time_s : (m,) increasing, within the table; by default the table's own times
    initial : rest state whose key angle the run starts from; by default at rest without force

    Returns
    -------
    Solution : angles and speeds (m, 5); between hammer and the rest of the action the path jumps where it lets go

    Raises
    ------
    InputError : table or times cannot be used; or the scene lacks a body or is not driven by a force
    StaticsError : the action does not balance somewhere along the key's travel
    IntegrationError : the key turns further than its stops were computed for; the message says when

    Notes
    -----
    Equation and assumptions: `model.null_model.reduction` and this module. Tables of the last eight actions are cached.

    Examples
    --------
    >>> import model
    >>> model.null_model.simulate(model.load_action(), *model.force_table("forte")).angle_rad.shape
    (3501, 5)
    """
    action = as_action(action)
    choice_of(action).need_played_key(action.name)
    times, forces = check_force_table(time_s, force_n)
    outputs = check_output_times(output_time_s, times)
    reduced = _cached_reduction(_ByContent(action.content(), action))
    sense = 1.0 if reduced.joined.ratio[0, KEY] > 0.0 else -1.0
    start = 0.0
    if initial is not None:
        if np.ndim(initial.angle_rad) != 1 or len(initial.angle_rad) < len(BODIES):  # those of effects follow
            raise InputError(f"initial state: {np.shape(initial.angle_rad)} angles found, allowed ({len(BODIES)},)")
        start = sense * float(initial.angle_rad[KEY] - reduced.rest_rad[KEY])
    end = float(outputs[-1]) if len(outputs) else float(times[0])
    count = max(1, math.ceil((end - times[0]) / STEP))
    grid = np.linspace(times[0], max(end, times[0] + STEP), 2 * count + 1)
    table = np.interp(grid, times, forces)
    rows = np.empty((count + 1, 5))
    step = float(grid[2] - grid[0])
    joined, away = _table(reduced.joined), _table(reduced.away)
    integrate(joined, away, reduced.check_rad, _constants(action, reduced), start, step, table, rows)
    _check_stops(reduced, grid[::2], rows, table[::2])
    angle, speed = _interpolate_angles(reduced, grid[::2], rows, outputs)
    return Solution(
        bodies=BODIES,
        time_s=outputs,
        angle_rad=angle,
        speed_rad_per_s=speed,
        counters={"n_steps": count},
        tolerance=tolerance,
        action=action,
    )


def _check_stops(reduced: Reduced, time_s: Array, rows: Array, force_n: Array) -> None:
    """Refuse a motion beyond the key's stops or the hammer's, where the tables say nothing."""
    lowest, highest = float(reduced.sigma[0]), float(reduced.sigma[-1])
    lowest_rise = float(np.min(reduced.up * (reduced.joined.angle_rad[:, HAMMER] - reduced.rest_rad[HAMMER])))
    for body, column, low, high in (("key", 0, lowest, highest), ("hammer", 2, lowest_rise, reduced.string_rad)):
        turn = rows[:, column]
        beyond = np.flatnonzero(~((turn >= low - ROUNDING) & (turn <= high + ROUNDING)))
        if len(beyond):
            i = int(beyond[0])
            raise IntegrationError(
                f"null model cannot predict this blow: {body} turns {turn[i]:.4g} rad from rest at {time_s[i]:.4f} s "
                f"under {force_n[i]:.4g} N; its stops allow {low:.4g} to {high:.4g} rad; check the force table"
            )


def _table(path: Path) -> Array:
    columns = path.mass, path.pull, path.lever, path.dry, path.damp, path.angle_rad[:, HAMMER], path.ratio[:, HAMMER]
    return np.ascontiguousarray(np.column_stack(columns))


def _constants(action: Action, reduced: Reduced) -> Constants:
    """Numbers that `integrate` takes: grid of the tables, friction threshold, hammer, turn to the string, let-off."""
    return Constants(
        start=float(reduced.sigma[0]),
        per_rad=1.0 / float(reduced.sigma[1] - reduced.sigma[0]),
        omega_t=action["friction_threshold.omega_t"],
        weight=action["hammer.mass"] * action["gravity.g"],
        centre_x=action["hammer.center_of_mass.x"],
        centre_y=action["hammer.center_of_mass.y"],
        damping=action[f"{STRING}.normal.D"],
        reach=math.hypot(action[f"{STRING}.first.x"], action[f"{STRING}.first.y"]),
        rest=float(reduced.rest_rad[HAMMER]),
        up=reduced.up,
        inertia=reduced.hammer_inertia,
        string=reduced.string_rad,
        let_off=reduced.let_off,
    )


def _interpolate_angles(reduced: Reduced, time_s: Array, rows: Array, at: Array) -> tuple[Array, Array]:
    """Angles and speeds (m, 5) of the bodies at times ``at`` from rows of (key turn, its rate, hammer turn, its rate,
    whether it rides), rad, rad/s, at ``time_s``."""
    s, w, phi, omega = (np.interp(at, time_s, rows[:, k]) for k in range(4))
    step = np.clip(np.searchsorted(time_s, at, side="right") - 1, 0, len(time_s) - 1)
    riding = rows[step, 4] > 0.0
    angle, speed = np.empty((len(at), len(BODIES))), np.empty((len(at), len(BODIES)))
    for i in range(len(BODIES)):
        for path, chosen in ((reduced.joined, riding), (reduced.away, ~riding)):
            angle[chosen, i] = np.interp(s[chosen], reduced.sigma, path.angle_rad[:, i])
            speed[chosen, i] = np.interp(s[chosen], reduced.sigma, path.ratio[:, i]) * w[chosen]
    key = reduced.rest_rad[KEY] + reduced.joined.ratio[0, KEY] * s  # also beyond the ends of the tables
    angle[:, KEY] = key
    angle[:, HAMMER] = reduced.rest_rad[HAMMER] + reduced.up * phi
    speed[:, HAMMER] = reduced.up * omega
    return angle, speed
