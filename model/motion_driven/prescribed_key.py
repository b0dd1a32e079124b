"""One run under a prescribed motion of the key: the other bodies are solved for, the force at the key front follows.

    force x lever = -(inertia x acceleration + weight + joint friction + contacts at capstan, back check and key pads)

It is the force on the key where the load cell sits, positive downwards: with the key's inertia and joint friction,
without the motor and its arm, whose inertia acts on the other side of the load cell. The rail's reaction is that of a
hinge: where it pulls the key down the real key would leave its rail, and the force is not valid there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.derived.columns import ANGLE, HELD, JOINT_Y
from model.derived.observe import bodies_at
from model.integrators.methods import DEFAULT_METHOD
from model.parameters.action import BODIES, Action
from model.parameters.effects import SHANK
from model.scene.build import Scene, build_scene
from model.scene.key_motion import KeyMotion
from model.scene.selection import SceneChoice
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

LONGEST_STEP_S = 2e-3  # so that no step jumps over a blow that begins inside it


@dataclass(frozen=True)
class PrescribedRun:
    """States (m, n) in the order ``bodies``, force (m,) N, rail's reaction on the key (m,) N upwards."""

    bodies: tuple[str, ...]
    angle_rad: Array
    speed_rad_per_s: Array
    force_n: Array
    rail_n: Array
    counters: dict[str, int | float]


def rest_angle(action: Action, choice: SceneChoice) -> float:
    """Angle (rad) of the key at rest without a force."""
    free = build_scene(choice.on(action), choice)
    return float(solve_rest(free)[free.bodies.index("key")])


def run_prescribed(
    action: Action,
    motion: KeyMotion,
    output_time_s: Array,
    *,
    tolerance: float = 1e-6,
    choice: SceneChoice | None = None,
    method: str = DEFAULT_METHOD,
) -> PrescribedRun:
    """Run the action under a prescribed motion of the key, from rest at its first angle.

    Parameters
    ----------
    action : parameter set
    motion : of the key
    output_time_s : (m,) increasing, within the motion
    tolerance : requested largest error of any angle, rad
    choice : what takes part
    method : integration method by name
    """
    if choice is not None:
        action = choice.on(action)
    # from zero on: a clock that has run for days has few digits left for a step
    start = float(motion.break_s[0])
    motion, times = KeyMotion(motion.break_s - start, motion.coefficient), output_time_s - start
    scene = build_scene(action, choice=choice, key_motion=motion)
    scene.refuse_giving("motion of the key")
    state = State(0.0, solve_rest(scene, 0.0), np.zeros(scene.size))
    run = Simulation(scene, state, tolerance=tolerance, method=method, largest_step_s=LONGEST_STEP_S)
    span = motion.break_s[[0, -1]]  # the input is the time itself
    angles, speeds = run.advance(float(times[-1]), span, span, output_time_s=times)
    key = motion.at(times)
    angles, speeds = np.column_stack([angles, key[:, 0]]), np.column_stack([speeds, key[:, 1]])
    force, rail = key_load(scene, angles, speeds, key[:, 2], memory=run.remembered if scene.remembers else None)
    bodies = tuple(b for b in (*BODIES, SHANK) if b in scene.bodies)
    order = [scene.bodies.index(b) for b in bodies]
    return PrescribedRun(bodies, angles[:, order], speeds[:, order], force, rail, run.work())


def key_load(
    scene: Scene,
    angles: Array,
    speeds: Array,
    acceleration: Array,
    vector: Array | None = None,
    memory: Array | None = None,
) -> tuple[Array, Array]:
    """What holds a key to its motion: force (m,) N down at the drive point, and of the pivot on the key, N, upwards.

    Parameters
    ----------
    scene : with the key prescribed, its last coordinate
    angles, speeds : (m, n) of all coordinates
    acceleration : (m,) of the key, rad/s^2
    vector : numbers of the scene; its own by default
    memory : (m, z) what a run remembered there, if anything
    """
    p, key = scene.vector if vector is None else vector, len(scene.bodies) - 1
    found = bodies_at(scene.tables, p, (angles, speeds), memory, prescribed=acceleration)[:, key]
    x, y = p[scene.tables.offset[2] : scene.tables.offset[2] + 2]
    arm = np.cos(found[:, ANGLE]) * x - np.sin(found[:, ANGLE]) * y
    force = -found[:, HELD] / arm
    return force, found[:, JOINT_Y] + force
