"""Simulate one run under a prescribed motion, and the force that holds the motion.

    force x lever = -(inertia x acceleration + weight + joint friction + contacts at capstan, back check and key pads)

Of a key it is the force where the load cell sits, positive downwards: with the key's inertia and joint friction,
without the motor and its arm, whose inertia acts on the other side of the load cell. The rail's reaction is that of a
hinge: where it pulls the key down the real key would leave its rail, and the force is not valid there. Of a key that
lifts or whose joint gives the front is prescribed (`model.scene.key_motion`). With a motor arm or a finger its angle
is prescribed, and what holds it is the torque on its joint.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.codegen.evaluate_observables import bodies_at
from model.codegen.observable_columns import HELD, JOINT_Y
from model.errors import ModelError
from model.integrators.methods import DEFAULT_METHOD
from model.kernels.lanes import has_wide_vectors
from model.parameters.action import BODIES, Action
from model.parameters.effects import ARM, FINGER, KEY_LIFT, MOTOR, SHANK
from model.scene.build import Scene, build_scene
from model.scene.key_motion import KeyMotion, acceleration_of_input, angle_at_height, append_prescribed_motion
from model.scene.selection import SceneChoice, choice_of
from model.scene.string_terms import with_modes
from model.simulation.compliant_joints import CompliantJointMotion, compliant_joint_motion
from model.simulation.lanes import advance_lanes, lane_kind
from model.simulation.run import Plan, Simulation, State
from model.simulation.solution import EnergyAudit
from model.simulation.statics import solve_rest
from model.simulation.string_motion import StringMotion, string_motion
from model.tolerance import MOTION_TOLERANCE

Array = NDArray[np.float64]

LONGEST_STEP_S = 2e-3  # so that no step jumps over a blow that begins inside it


@dataclass(frozen=True)
class PrescribedMotion:
    """States (m, n) in the order ``bodies``, and counters of the work."""

    bodies: tuple[str, ...]
    angle_rad: Array
    speed_rad_per_s: Array
    counters: dict[str, int | float]


@dataclass(frozen=True)
class PrescribedRun(PrescribedMotion):
    """The motion with force (m,) N and the rail's reaction on the key (m,) N upwards.

    With motor arm or finger the force is the torque on its joint over its length ``arm_m``. ``energy`` is the audit,
    where it was asked for; ``string`` and ``give`` as of a `Solution`.
    """

    force_n: Array
    rail_n: Array
    arm_m: float | None = None
    energy: EnergyAudit | None = None
    string: StringMotion | None = None
    give: CompliantJointMotion | None = None


def rest_angle(action: Action, choice: SceneChoice) -> float:
    """Angle (rad) of what a motion would prescribe at rest without a force."""
    free = build_scene(choice.apply_to(action), choice)
    return prescribed_angle(free, choice.prescribed_coordinate, solve_rest(free, with_joints=True), free.vector)


def prescribed_angle(free: Scene, body: str, coordinates: Array, p: Array) -> float:
    """Angle (rad) of ``body`` that a motion would prescribe at ``coordinates`` (n + g,) of ``free``, its scene without
    a motion, with parameters ``p``: for a key that rises, the angle that puts a fixed key's front there."""
    angle, rise = float(coordinates[free.bodies.index(body)]), 0.0
    if body != "key":
        return angle
    if KEY_LIFT in free.bodies:
        rise = coordinates[free.bodies.index(KEY_LIFT)]
    elif ("key", "y") in free.pins:
        rise = coordinates[free.size + free.pins.index(("key", "y"))]
    x, y = front = p[free.tables.offset[2] : free.tables.offset[2] + 2]
    return float(angle_at_height(front, np.sin(angle) * x + np.cos(angle) * y + rise)) if rise else angle


def run_prescribed(
    action: Action,
    motion: KeyMotion,
    output_time_s: Array,
    *,
    tolerance: float = MOTION_TOLERANCE,
    choice: SceneChoice | None = None,
    method: str = DEFAULT_METHOD,
    energy: bool = False,
) -> PrescribedRun:
    """Run the action under a prescribed motion of the key, arm or finger, from balance at its first angle; states (m,
    n) at ``output_time_s``, s, force (m,), N, that holds it, the rail's, and with ``energy`` the audit."""
    choice = choice_of(action, choice)
    action = choice.apply_to(action)
    action = with_modes(action, tolerance)
    under_way = _Prescribed.start(action, motion, output_time_s, tolerance, choice, method, energy)
    run, scene = under_way.run, under_way.scene
    state = run.state
    stored = run.stored_energy() if energy else 0.0
    own = run.advance(*under_way.span(), output_time_s=under_way.time_s)
    angles, speeds, moved = under_way.whole_states(own)
    force, rail = key_load(scene, angles, speeds, moved[:, 2], memory=under_way.memory)
    arm = (
        None
        if choice.prescribed_coordinate == "key"
        else action[f"{ARM if choice.prescribed_coordinate == MOTOR else FINGER}.length"]
    )
    bodies, order = under_way.order()
    return PrescribedRun(
        bodies,
        angles[:, order],
        speeds[:, order],
        run.work(),
        force / (arm or 1.0),
        rail,
        arm,
        run.energy_audit(state, stored) if energy else None,
        string_motion(scene, under_way.time_s, run.remembered),
        compliant_joint_motion(scene, run.remembered),
    )


def run_prescribed_lanes(
    runs: Sequence[tuple[Action, KeyMotion, Array]], *, tolerance: float
) -> list[PrescribedMotion | ModelError]:
    """Motions, without forces, of ``runs`` (action, motion, output times (m,), s) in their order, or the error of each
    that fails; integrated side by side where the processor has wide vectors."""
    out: list[PrescribedMotion | ModelError] = [ModelError("not run")] * len(runs)
    alike: dict[object, list[tuple[int, _Prescribed, Plan]]] = defaultdict(list)
    for i, (action, motion, output_time_s) in enumerate(runs):
        try:
            choice = choice_of(action)
            action = with_modes(choice.apply_to(action), tolerance)
            one = _Prescribed.start(action, motion, output_time_s, tolerance, choice)
            plan = one.run.plan(*one.span(), output_time_s=one.time_s)
            alike[lane_kind(one.scene) if has_wide_vectors() else i].append((i, one, plan))
        except ModelError as problem:
            out[i] = problem
    for group in alike.values():
        plans = [plan for _, _, plan in group]
        if has_wide_vectors():
            ends = advance_lanes(group[0][1].scene.tables, plans)
        else:
            ends = [one.run.carry_out(plan) for _, one, plan in group]
        for (i, one, plan), end in zip(group, ends, strict=True):
            try:
                angles, speeds, _ = one.whole_states(one.run.accept_result(plan, *end))
                bodies, order = one.order()
                out[i] = PrescribedMotion(bodies, angles[:, order], speeds[:, order], one.run.work())
            except ModelError as problem:
                out[i] = problem
    return out


@dataclass(frozen=True)
class _Prescribed:
    """A run under a prescribed motion, on a clock of its own."""

    scene: Scene
    motion: KeyMotion
    time_s: Array  # (m,) of the outputs
    run: Simulation

    @classmethod
    def start(
        cls,
        action: Action,
        motion: KeyMotion,
        output_time_s: Array,
        tolerance: float,
        choice: SceneChoice,
        method: str = DEFAULT_METHOD,
        energy: bool = False,
    ) -> _Prescribed:
        """Build (not run) the simulation of a prescribed motion, in balance at its first angle; times are counted from
        the motion's start."""
        # from zero on: a clock that has run for days has few digits left for a step
        start = float(motion.break_s[0])
        motion, times = KeyMotion(motion.break_s - start, motion.coefficient), output_time_s - start
        scene = build_scene(action, choice=choice, key_motion=motion)
        state = State(0.0, solve_rest(scene, 0.0), np.zeros(scene.size))
        run = Simulation(scene, state, tolerance=tolerance, method=method, largest_step_s=LONGEST_STEP_S, energy=energy)
        return cls(scene, motion, times, run)

    def span(self) -> tuple[float, Array, Array]:
        """Until when, and the input: it is the time itself."""
        span = self.motion.break_s[[0, -1]]
        return float(self.time_s[-1]), span, span

    @property
    def memory(self) -> Array | None:
        return self.run.remembered if self.scene.remembers else None

    def whole_states(self, own: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        """Angles and speeds (m, n) of all coordinates from those solved for; the motion (m, 3)."""
        moved = self.motion.evaluate(self.time_s)
        return *append_prescribed_motion(self.scene.tables, self.scene.vector, own, moved, self.memory), moved

    def order(self) -> tuple[tuple[str, ...], list[int]]:
        """Bodies in the usual order, and where the scene has them."""
        usual = [b for b in (*BODIES, SHANK, KEY_LIFT, MOTOR, FINGER) if b in self.scene.bodies]
        bodies = tuple(dict.fromkeys([*usual, *self.scene.bodies]))
        return bodies, [self.scene.bodies.index(b) for b in bodies]


def key_load(
    scene: Scene,
    angles: Array,
    speeds: Array,
    acceleration: Array,
    vector: Array | None = None,
    memory: Array | None = None,
) -> tuple[Array, Array]:
    """Force (N, down) or torque (N m) (m,) that holds the last coordinate to its motion of ``acceleration`` (m,), and
    the joint's force on the key (m,), N, up; ``angles``, ``speeds`` (m, n) of all coordinates."""
    p, states = scene.vector if vector is None else vector, (angles, speeds)
    wanted = acceleration_of_input(scene.tables, p, states, acceleration, memory)
    found = bodies_at(scene.tables, p, states, memory, prescribed=wanted)
    return found[:, -1, HELD], found[:, scene.bodies.index("key"), JOINT_Y]
