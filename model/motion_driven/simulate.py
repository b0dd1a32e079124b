"""Motion-driven simulation: the measured motion of the key goes in, the force at the key front comes out.

The comparison that tests a model of an action: under a prescribed force the heavy key hides what the rest of it does.
Angles of the key (n,) in, `MotionDriven` out. The key follows the fitted motion exactly; the four other bodies are
solved for; the force follows from the key's own equation of motion:

    force x lever = -(inertia x acceleration + weight + joint friction + contacts at capstan, back check and key pads)

It is the force on the key at the point where the load cell sits, positive downwards: with the key's inertia and its
joint friction, without the motor and its arm, whose inertia acts on the other side of the load cell. The rail's
reaction is that of a hinge: where it pulls the key down (``lifted``) the real key would leave its rail, the encoder
would read lift as rotation, and neither force nor uncertainty hold there.

    driven = model.simulate_motion(action, time_s, key_rad)     # encoder counts x width of a count, or noiseless
    driven.time_s, driven.force_n, driven.u_force_n, driven.angle_rad, driven.lifted
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.force_driven import LARGEST_FORCE_N, check_output_times
from model.integrators.methods import DEFAULT_METHOD
from model.kernels.tables.prescribed_load import load_along
from model.motion_driven.spline_fit import KeyFit, fit_key_motion
from model.parameters.action import BODIES, Action
from model.parameters.effects import SHANK
from model.scene.build import build_scene, check_prescribed_key
from model.scene.key_motion import KeyMotion
from model.scene.selection import SceneChoice, load_scene
from model.simulation.rail_reaction import Tension, tensions
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

LONGEST_STEP_S = 2e-3  # so that no step jumps over a blow that begins inside it
MEMBERS = 40


@dataclass(frozen=True)
class Driven:
    """One run under one motion: states (m, n) in the order ``bodies``, force (m,) N, rail's reaction (m,) N upwards."""

    bodies: tuple[str, ...]
    angle_rad: Array
    speed_rad_per_s: Array
    force_n: Array
    rail_n: Array
    counters: dict[str, int | float]


@dataclass(frozen=True)
class MotionDriven:
    """What a motion of the key asks for and brings about.

    Attributes
    ----------
    bodies : names of the columns
    time_s : (m,)
    force_n : (m,) force at the key front, N, positive downwards
    u_force_n : (m,) its standard uncertainty, N: what the measured angle leaves open, nothing of the model
    coverage_factor : `force_n` +- coverage_factor x `u_force_n` holds 95 %
    angle_rad, speed_rad_per_s : (m, n) of all bodies, the key as fitted
    u_angle_rad : (m, n)
    key_rad_per_s2 : (m,) acceleration of the key
    rest_rad : angle at which the key of this action lies without a force
    rail_n : (m,) force of the balance rail on the key, N, upwards
    lifted : (m,) True where the rail would have to pull
    fit : the motion that was fitted
    counters : steps, rejections and so on of the run under the fitted motion
    tolerance : requested largest error of any angle, rad
    """

    bodies: tuple[str, ...]
    time_s: Array
    force_n: Array
    u_force_n: Array
    coverage_factor: float
    angle_rad: Array
    speed_rad_per_s: Array
    u_angle_rad: Array
    key_rad_per_s2: Array
    rest_rad: float
    rail_n: Array
    lifted: NDArray[np.bool_]
    fit: KeyFit
    counters: dict[str, int | float] = field(default_factory=dict)
    tolerance: float = 1e-6

    def key_tensions(self) -> list[Tension]:
        """Intervals in which the balance rail would have to pull the key down: predicted lift."""
        return tensions(self.time_s, self.rail_n)

    def columns(self) -> dict[str, Array]:
        """Columns by name, in the order of the command's output file."""
        out = {"time_s": self.time_s, "force_n": self.force_n, "u_force_n": self.u_force_n}
        out |= {"key_joint_y_n": self.rail_n, "key_lifted": self.lifted.astype(float)}
        for i, body in enumerate(self.bodies):
            out[f"{body}_rad"] = self.angle_rad[:, i]
        for i, body in enumerate(self.bodies):
            out[f"{body}_rad_per_s"] = self.speed_rad_per_s[:, i]
        return out


def rest_angle(action: Action, choice: SceneChoice) -> float:
    """Angle (rad) at which the key lies without a force."""
    free = build_scene(choice.on(action), choice)
    return float(solve_rest(free)[free.bodies.index("key")])


def drive(
    action: Action,
    motion: KeyMotion,
    output_time_s: Array,
    *,
    tolerance: float = 1e-6,
    choice: SceneChoice | None = None,
    method: str = DEFAULT_METHOD,
) -> Driven:
    """Run the action under a prescribed motion of the key, from rest at its first angle; no uncertainty.

    Parameters
    ----------
    motion : of the key
    output_time_s : (m,) increasing, within the motion
    """
    if choice is not None:
        action = choice.on(action)
    # from zero on: a clock that has run for days has few digits left for a step
    start = float(motion.break_s[0])
    motion, times = KeyMotion(motion.break_s - start, motion.coefficient), output_time_s - start
    scene = build_scene(action, choice=choice, key_motion=motion)
    state = State(0.0, solve_rest(scene, 0.0), np.zeros(scene.size))
    run = Simulation(scene, state, tolerance=tolerance, method=method, largest_step_s=LONGEST_STEP_S)
    span = motion.break_s[[0, -1]]  # the input is the time itself
    angles, speeds = run.advance(float(times[-1]), span, span, output_time_s=times)
    key = motion.at(times)
    angles, speeds = np.column_stack([angles, key[:, 0]]), np.column_stack([speeds, key[:, 1]])
    force, rail = np.empty(len(key)), np.empty(len(key))
    load_along(angles, speeds, np.ascontiguousarray(key[:, 2]), scene.vector, scene.tables, force, rail)
    bodies = tuple(b for b in (*BODIES, SHANK) if b in scene.bodies)
    order = [scene.bodies.index(b) for b in bodies]
    return Driven(bodies, angles[:, order], speeds[:, order], force, rail, run.work())


def simulate_motion(
    action: Action,
    time_s: ArrayLike,
    key_rad: ArrayLike,
    *,
    tolerance: float = 1e-6,
    output_time_s: ArrayLike | None = None,
    resolution_rad: float | None = None,
    jitter_rad: float | None = None,
    from_rest: bool = False,
    u_zero_rad: float = 0.0,
    members: int = MEMBERS,
    seed: int = 0,
    scene: SceneChoice | str | Path = "whole",
    method: str = DEFAULT_METHOD,
    share: Callable[..., Iterable[Driven]] = map,
) -> MotionDriven:
    """Predict the force at the key front, and the other bodies' motion, from the measured motion of the key.

    Parameters
    ----------
    action : parameter set
    time_s, key_rad : (n,) increasing times and measured angles of the key (from ground, counter-clockwise; at rest the
        rest angle of the action); NaN where an angle is lost
    from_rest : the angles are changes since rest, as an incremental encoder gives them: the rest angle is added, and
        the rounding of the encoder's zero to its uncertainty
    tolerance : requested largest error of any angle, rad
    output_time_s : (m,) increasing, within the table; by default the table's own times
    resolution_rad, jitter_rad : width of a count and standard deviation beyond it; by default found in the angles
    u_zero_rad : standard uncertainty of the angles' common zero
    members : size of the seeded ensemble that carries the uncertainty from the angle to the force; 0 leaves it out
        (``u_force_n`` is NaN)
    seed : of the ensemble
    scene : what takes part, by name or file (`model.scene.selection`)
    method : integration method, see `model.integrators`
    share : ``map``, or the ``map`` of an executor that shares the ensemble among threads

    Raises
    ------
    InputError : table, times or tolerance cannot be used
    IntegrationError, StaticsError : the motion is none that the action can follow

    Notes
    -----
    The ensemble draws whole motions from the posterior of the fit (`KeyFit.draw`), so that all of angle, speed and
    acceleration and what the other bodies make of them is in ``u_force_n``: root mean square departure of the members
    from ``force_n``. It is what the angle leaves open under this model, not how right the model is. Noise of the force
    from sample to sample moves the key by less than a count: it is neither in the force nor in its uncertainty.
    Errors last: one draw at an impact can shift the force of a whole hold. Equations: thesis Chapter 2.
    """
    from scipy.special import stdtrit

    if members < 0 or members == 1:
        raise InputError(f"members of the ensemble: found {members}, allowed 0 or from 2")
    if not 0.0 <= u_zero_rad <= 0.1:
        raise InputError(f"uncertainty of the zero: found {u_zero_rad:g} rad, allowed 0 to 0.1")
    choice = load_scene(scene)
    check_prescribed_key(choice)  # before the rest angle, for which the scene's kernels may have to be compiled
    rest = rest_angle(action, choice)
    if from_rest:
        key_rad = np.asarray(key_rad, dtype=float) + rest
    fit = fit_key_motion(time_s, key_rad, resolution_rad=resolution_rad, jitter_rad=jitter_rad)
    outputs = check_output_times(output_time_s, fit.time_s)
    if len(outputs) == 0:
        raise InputError("output times: found none, allowed at least one")

    u_zero = float(np.hypot(u_zero_rad, fit.resolution_rad / np.sqrt(12.0) if from_rest else 0.0))

    def run(motion: KeyMotion) -> Driven:
        return drive(action, motion, outputs, tolerance=tolerance, choice=choice, method=method)

    mean_motion = fit.motion()
    mean = run(mean_motion)
    largest = int(np.argmax(np.abs(mean.force_n)))
    if not abs(mean.force_n[largest]) <= LARGEST_FORCE_N:
        raise InputError(
            f"key motion: takes {mean.force_n[largest]:.0f} N at {outputs[largest]:g} s, allowed up to "
            f"{LARGEST_FORCE_N:g} N; check unit and zero of the angles (at rest {rest:.5f} rad, or changes from rest)"
        )
    random = np.random.default_rng(seed)
    force_square, angle_square = np.zeros(len(outputs)), np.zeros(mean.angle_rad.shape)
    for member in share(run, [fit.draw(random, u_zero) for _ in range(members)]):
        force_square += (member.force_n - mean.force_n) ** 2
        angle_square += (member.angle_rad - mean.angle_rad) ** 2
    with np.errstate(invalid="ignore"):
        u_force, u_angle = (np.sqrt(x / members if members else x * np.nan) for x in (force_square, angle_square))
    return MotionDriven(
        bodies=mean.bodies,
        time_s=outputs,
        force_n=mean.force_n,
        u_force_n=u_force,
        coverage_factor=float(stdtrit(members, 0.975)) if members else float("nan"),
        angle_rad=mean.angle_rad,
        speed_rad_per_s=mean.speed_rad_per_s,
        u_angle_rad=u_angle,
        key_rad_per_s2=mean_motion.at(outputs)[:, 2],
        rest_rad=rest,
        rail_n=mean.rail_n,
        lifted=mean.rail_n < 0.0,
        fit=fit,
        counters=mean.counters,
        tolerance=tolerance,
    )
