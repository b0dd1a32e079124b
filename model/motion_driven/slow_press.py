"""A slow press of the key at a steady speed, as a technician examines an action; force and all motions come out.

Built on the equations of motion with all friction, not on statics, so that the jack really slides out and the hammer
really falls back. A stiff position servo moves a key of inertia `SERVO_INERTIA`; the force reported at the key front,
per block of time, is what a hand on the real key would need for the same motion (momentum balance of the key, exact).
Raises ``InputError`` where the key cannot reach a dip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.derived.load import kernels_of
from model.errors import InputError
from model.integrators.servo import STEP_LOOP, Followed, Servo, ServoRun, Wanted, follow
from model.kernels.signatures import Outputs
from model.observables import hammer_height_m, key_dip_m
from model.parameters.action import BODIES, Action
from model.scene.build import build_scene
from model.simulation.run import Simulation, State

Array = NDArray[np.float64]

SERVO_INERTIA = 1.0  # kg m^2 about the key's pivot, some 300 keys: the action hardly disturbs the motion
SERVO_RATE = 150.0  # 1/s, double pole of the servo
BLOCK = 2e-3  # s, over which the force is constant
SAMPLES = 4  # states recorded per block
RAMP = 0.04  # s, in which the key accelerates and stops
KEY = BODIES.index("key")


@dataclass(frozen=True)
class Press:
    """A slow press: states at (m,) times, force at the key front (m,) N, positive downwards, mean over its block.

    Attributes
    ----------
    time_s, dip_m, hammer_height_m, force_n : (m,)
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
    """Angle of the key (rad) at which its front is ``dip_m`` below rest."""
    x, y = action["drive.point.x"], action["drive.point.y"]
    length, offset = math.hypot(x, y), math.atan2(y, x)
    height = length * math.sin(float(rest_rad[KEY]) + offset) - dip_m
    if not abs(height) < length:
        raise InputError(f"dip: found {1e3 * dip_m:g} mm, allowed what a key {1e3 * length:.0f} mm long can turn")
    return math.asin(height / length) - offset


def _speed_profile(
    start: float, stops: Sequence[float], turn_rate: float, hold_s: float
) -> tuple[Array, Array, list[float]]:
    """Knots of the key's speed (times, speeds) through the stops, resting ``hold_s`` at each; times of arrival."""
    times, speeds, arrived = [0.0], [0.0], []
    here = start
    for stop in stops:
        way = abs(stop - here)
        rate = min(turn_rate, way / RAMP)  # lower over a short distance
        sign = math.copysign(1.0, stop - here)
        if rate > 0.0:
            t = times[-1]
            cruise = way / rate - RAMP
            times += [t + RAMP, t + RAMP + max(cruise, 1e-9), t + 2.0 * RAMP + max(cruise, 1e-9)]
            speeds += [sign * rate, sign * rate, 0.0]
        arrived.append(times[-1])
        times.append(times[-1] + hold_s)
        speeds.append(0.0)
        here = stop
    return np.array(times), np.array(speeds), arrived


def slow_press(
    action: Action,
    rest_rad: ArrayLike,
    dips_m: ArrayLike,
    *,
    speed_m_per_s: float = 0.005,
    hold_s: float = 0.3,
    tolerance: float = 1e-5,
) -> Press:
    """Move the key front to each of ``dips_m`` (m below rest) in turn, at a steady speed.

    Parameters
    ----------
    action : parameter set
    rest_rad : (5,) rest state to start from
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
    if not 0.0 < speed_m_per_s <= 1.0:
        raise InputError(f"speed of the press: found {speed_m_per_s:g} m/s, allowed above 0 to 1")
    rest, dips = as_numbers(rest_rad, "angles at rest", 1), as_numbers(dips_m, "dips of the key", 1)
    if len(rest) != len(BODIES) or len(dips) == 0:
        raise InputError(
            f"slow press: found {len(rest)} angles at rest and {len(dips)} dips, allowed {len(BODIES)} and 1 or more"
        )
    lever = action["drive.point.x"]
    stops = [key_angle_at_dip(action, rest, float(dip)) for dip in dips]
    knots, speeds, arrived = _speed_profile(float(rest[KEY]), stops, speed_m_per_s / abs(lever), hold_s)
    ways = np.concatenate([[0.0], np.cumsum(np.diff(knots) * 0.5 * (speeds[1:] + speeds[:-1]))]) + rest[KEY]
    servo = action.with_values({"key.inertia": SERVO_INERTIA})
    run = Simulation(build_scene(servo), State(0.0, rest.copy(), np.zeros(len(BODIES))), tolerance)
    count = math.ceil(knots[-1] / BLOCK)
    middle = (np.arange(count) + 0.5) * BLOCK
    wanted_speed = np.interp(middle, knots, speeds)
    index = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(knots) - 2)
    wanted = ways[index] + 0.5 * (speeds[index] + wanted_speed) * (middle - knots[index])
    wanted_acceleration = np.gradient(wanted_speed, BLOCK) if count > 1 else np.zeros(count)
    done = _follow(run, Wanted(wanted, wanted_speed, wanted_acceleration), lever, action["drive.point.y"])
    extra = SERVO_INERTIA - action["key.inertia"]
    force = done.pull + extra * done.gained / BLOCK / done.arm
    times = (np.arange(1, count * SAMPLES + 1)) * (BLOCK / SAMPLES)
    q_all, v_all = done.angle.reshape(-1, len(BODIES)), done.speed.reshape(-1, len(BODIES))
    normal, _ = run.contact_forces(q_all, v_all)
    return Press(
        time_s=times,
        dip_m=key_dip_m(action, q_all, rest),
        hammer_height_m=hammer_height_m(action, q_all),
        force_n=np.repeat(force, SAMPLES),
        angle_rad=q_all,
        speed_rad_per_s=v_all,
        contact_normal_n={name: normal[:, i] for i, name in enumerate(run.scene.contacts)},
        leg=np.minimum(np.searchsorted(np.array(arrived), times, side="left"), len(stops) - 1),
        arrived=tuple(arrived),
    )


def _follow(run: Simulation, wanted: Wanted, front_x: float, front_y: float) -> Followed:
    """States of every block; raises what stopped the run."""
    count, n = len(wanted.angle), len(BODIES)
    start, end = np.arange(count) * BLOCK, np.arange(1, count + 1) * BLOCK
    at = start[:, None] + BLOCK * np.arange(1, SAMPLES + 1) / SAMPLES
    at[:, -1] = end
    shape = (count, SAMPLES, n)
    pull, gained, arm = np.zeros((3, count))
    z = len(run.state.memory)
    memory = np.full((count, SAMPLES, z), np.nan)
    done = Followed(at, np.full(shape, np.nan), np.full(shape, np.nan), memory, pull, gained, arm)
    plan = run.plan(BLOCK, np.array([0.0, BLOCK]), np.zeros(2), output_time_s=at[0])  # the same numbers for all blocks
    servo = Servo(SERVO_INERTIA, SERVO_RATE, BLOCK, front_x, front_y, KEY)
    given = ServoRun(
        STEP_LOOP, plan.scene, kernels_of(run.scene.tables), plan.method.coefficients, plan.limits, plan.account
    )
    reached = follow(servo, wanted, plan.span, done, given)
    rows = at.ravel(), done.angle.reshape(-1, n), done.speed.reshape(-1, n), memory.reshape(count * SAMPLES, z)
    run.reached(plan._replace(out=Outputs(*rows, plan.out.steps)), *reached)
    return done
