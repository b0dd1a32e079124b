"""Simulate a slow press of the key at constant speed: force and all motions.

Built on the equations of motion with all friction, not on statics, so that the jack really slides out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import NORMAL
from model.elements.prescribed import ORDER
from model.errors import InputError
from model.motion_driven.prescribed_key import key_load
from model.observables import head_height_m, key_dip_m
from model.parameters.action import BODIES, Action, ActionLike, as_action
from model.scene.build import build_scene
from model.scene.key_motion import KeyMotion, append_prescribed_motion
from model.simulation.compliant_joints import pin_motion
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest
from model.tolerance import DEFAULT_TOLERANCE

Array = NDArray[np.float64]

SAMPLE, SAMPLE_WAY = 5e-4, 2.5e-6  # s and m of the front, between states; the longer of both
RAMP, RAMP_WAY = 0.04, 2e-4  # s and m of the front, in which the key accelerates and stops; the longer of both
SLOW_M_PER_S = 0.005  # of the key front: choice; friction is taken at it
HOLD_S = 0.3  # at a stop: choice; felt has come to rest
LONGEST_STEP_S, LONGEST_STEP_WAY = 2e-3, 1e-5  # s and m of the front; the longer of both
KEY = BODIES.index("key")


@dataclass(frozen=True)
class Press:
    """A slow press: states at (m,) times, force at the key front (m,) N, positive downwards.

    Attributes
    ----------
    time_s, dip_m, hammer_height_m, force_n : (m,); the dip is that of the front, which the key's angle alone does not
        tell where it lifts or gives
    angle_rad, speed_rad_per_s : (m, 5)
    contact_normal_n : contact name -> (m,) N
    leg : (m,) index of the waypoint the key is moving to
    arrived : time at which each waypoint is reached, s
    """

    time_s: Array
    dip_m: Array
    hammer_height_m: Array
    force_n: Array
    angle_rad: Array
    speed_rad_per_s: Array
    contact_normal_n: dict[str, Array]
    leg: NDArray[np.int64]
    arrived: tuple[float, ...]


def key_angle_at_dip(action: Action, rest_rad: Array, dip_m: float) -> float:
    x, y = action["drive.point.x"], action["drive.point.y"]
    length, offset = math.hypot(x, y), math.atan2(y, x)
    height = length * math.sin(float(rest_rad[KEY]) + offset) - dip_m
    if not abs(height) < length:
        raise InputError(f"dip: found {1e3 * dip_m:g} mm, allowed what a key {1e3 * length:.0f} mm long can turn")
    return math.asin(height / length) - offset


def _motion_through_stops(
    start: float, stops: Sequence[float], turn_rate: float, ramp_s: float, hold_s: float
) -> tuple[KeyMotion, list[float]]:
    """The key's motion from ``start`` through ``stops`` (rad) at ``turn_rate`` (rad/s), reached in ``ramp_s``, resting
    ``hold_s`` at each; and the times of arrival, s.

    Speeds rise and fall as 3 x^2 - 2 x^3, so that the acceleration has no jump.
    """
    at, rows, arrived, here = [0.0], list[list[float]](), list[float](), start

    def go_on(time: float, *row: float) -> None:
        at.append(at[-1] + time)
        rows.append([*[0.0] * (ORDER - len(row)), *row])

    for stop in stops:
        way = abs(stop - here)
        rate = math.copysign(min(turn_rate, way / ramp_s), stop - here)  # lower over a short distance
        if rate != 0.0:
            cruise = max(way / abs(rate) - ramp_s, 1e-9)
            ramp = -0.5 * rate / ramp_s**3, rate / ramp_s**2  # of time to the fourth and to the third
            before = stop - 0.5 * rate * ramp_s
            go_on(ramp_s, *ramp, 0.0, 0.0, here)
            go_on(cruise, rate, before - rate * cruise)
            go_on(ramp_s, -ramp[0], -ramp[1], 0.0, rate, before)
        arrived.append(at[-1])
        go_on(hold_s, stop)
        here = stop
    return KeyMotion(np.array(at), np.array(rows)), arrived


def slow_press(
    action: ActionLike,
    rest_rad: ArrayLike,
    dips_m: ArrayLike,
    *,
    speed_m_per_s: float = SLOW_M_PER_S,
    hold_s: float = HOLD_S,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Press:
    """Move the key front, from ``rest_rad`` (n,), to each of ``dips_m`` (m below rest) in turn, at ``speed_m_per_s``,
    resting ``hold_s`` at each; dip, force (N, down), angles, contact forces and hammer height over time.

    Parameters
    ----------
    action : parameter set
    rest_rad : (n,) rest state of the action's scene to start from
    dips_m : where the key stops, e.g. ``[0.010]`` or, to press and let go, ``[0.010, 0.0]``
    speed_m_per_s : of the key front
    hold_s : rest at each stop, s
    tolerance : requested largest error of any angle, rad

    Returns
    -------
    Press
        Dip, m, force, N, angles, rad, and height of the hammer, m, over time.

    Raises
    ------
    InputError : a speed that is not above 0 and up to 1 m/s, no dip, or no rest state
    IntegrationError, StaticsError : the action cannot follow this motion

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> press = model.slow_press(action, model.hand_set_rest(action), [0.005])
    >>> print(f"{1e3 * press.hammer_height_m[-1]:.0f} mm below the string at half dip")
    19 mm below the string at half dip
    """
    action = as_action(action)
    if not 0.0 < speed_m_per_s <= 1.0:
        raise InputError(f"speed of the press: found {speed_m_per_s:g} m/s, allowed above 0 to 1")
    rest, dips = as_numbers(rest_rad, "angles at rest", 1), as_numbers(dips_m, "dips of the key", 1)
    names = build_scene(action).bodies
    if len(rest) != len(names) or len(dips) == 0:
        raise InputError(
            f"slow press: found {len(rest)} angles at rest and {len(dips)} dips, allowed {len(names)} and 1 or more"
        )
    begin = key_angle_at_dip(action, rest, 0.0)
    stops = [key_angle_at_dip(action, rest, float(dip)) for dip in dips]
    ramp_s, sample_s = max(RAMP, RAMP_WAY / speed_m_per_s), max(SAMPLE, SAMPLE_WAY / speed_m_per_s)
    motion, arrived = _motion_through_stops(begin, stops, speed_m_per_s / abs(action["drive.point.x"]), ramp_s, hold_s)
    scene = build_scene(action, key_motion=motion)
    start = solve_rest(scene, 0.0, rest[[names.index(body) for body in scene.bodies[: scene.size]]])
    longest = max(LONGEST_STEP_S, LONGEST_STEP_WAY / speed_m_per_s)
    run = Simulation(scene, State(0.0, start, np.zeros(scene.size)), tolerance, largest_step_s=longest)
    times = sample_s * np.arange(1, math.floor(motion.break_s[-1] / sample_s) + 1)
    span = motion.break_s[[0, -1]]  # the input is the time itself
    own = run.advance(float(times[-1]), span, span, output_time_s=times)
    moved, memory = motion.evaluate(times), run.remembered if scene.remembers else None
    q, v = append_prescribed_motion(scene.tables, scene.vector, own, moved, memory)
    force, _ = key_load(scene, q, v, moved[:, 2], memory=memory)
    normal = contacts_at(scene.tables, scene.vector, q, v, memory)[:, :, NORMAL]
    order = [scene.bodies.index(body) for body in BODIES]
    whole = np.column_stack([q, pin_motion(scene, run.remembered)[0]]) if scene.pins else q
    front = np.tile(rest[: len(BODIES)], (len(times), 1))
    front[:, KEY] = moved[:, 0]
    return Press(
        time_s=times,
        dip_m=key_dip_m(action, front, rest[: len(BODIES)]),
        hammer_height_m=head_height_m(action, scene.coordinates, whole),
        force_n=force,
        angle_rad=q[:, order],
        speed_rad_per_s=v[:, order],
        contact_normal_n={name: normal[:, i] for i, name in enumerate(scene.contacts)},
        leg=np.minimum(np.searchsorted(np.array(arrived), times, side="left"), len(stops) - 1),
        arrived=tuple(arrived),
    )
