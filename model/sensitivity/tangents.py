"""Derivatives of a motion with respect to parameters: motion, rest state and tangents put together.

In: `Directions` (how parameters change a scene's numbers) and an input table; out: `Recorded`, which
gives states and their derivatives at any times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.derived.load import kernels_of, slopes_of
from model.errors import InputError, IntegrationError
from model.integrators.tangents.follow import NODE, STEP_TOO_SMALL, TOO_MANY_STEPS, follow
from model.integrators.tangents.loads import LANES, Loads, Moved, normal_slopes
from model.integrators.tangents.nodes import Linear, Space, linearise_node
from model.integrators.tangents.radau import STAGES, Wanted
from model.integrators.tangents.recorded_motion import FULL, Log, Motion, find_kinks, record, states_along
from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.regimes import MOST_CONTACTS, normal_size
from model.kernels.signatures import SceneNumbers, StepKernels
from model.sensitivity.parameter_names import Directions
from model.sensitivity.sources import sources_of
from model.simulation.run import Plan, Simulation
from model.simulation.statics import balance

Array = NDArray[np.float64]

# Steps of the motion that one of the tangents may span: a layer in which friction turns is found by the motion's steps,
# of which a looser motion has fewer. Found with benchmarks/sensitivities.py.
STRIDE, STRIDE_AT, STRIDE_EXPONENT = 8, 2e-9, 0.2
INPUT_KINKS, WEAK_KINK = 50, 0.01  # of the input that steps end at; of the strongest
CACHE_LINE = 64  # bytes
ROWS = 20_000  # steps recorded at a time
# derivatives below these, per change of a parameter by all of its value, do not decide about steps
LEAST_ANGLE, LEAST_SPEED = 1e-4, 1e-2  # rad, rad/s


def _filled_up(count: int) -> int:
    """Columns for that many parameters: a multiple of the lanes; those beyond stay zero."""
    return -(-count // LANES) * LANES


def aligned(*shape: int) -> Array:
    """Zeros that start at a cache line: a row of lanes across two of them takes twice the time."""
    count = int(np.prod(shape))
    whole = np.zeros(count + CACHE_LINE // 8)
    start = (-whole.ctypes.data % CACHE_LINE) // 8
    return whole[start : start + count].reshape(shape)


class _Run:
    """The kernels, numbers and memory that motion and tangents of one scene share."""

    def __init__(self, directions: Directions) -> None:
        self.directions, self.scene = directions, directions.scene
        tables = self.scene.tables
        self.kernels: StepKernels = kernels_of(tables)
        self.numbers = SceneNumbers(self.scene.vector, tables.parent[: self.scene.size], self.scene.solved_contacts)
        if self.scene.solved_contacts > MOST_CONTACTS:
            raise InputError(f"sensitivities: found {self.scene.solved_contacts} contacts, allowed {MOST_CONTACTS}")
        self.regime = slopes_of(tables, "regime")
        n, p = self.scene.size, _filled_up(len(directions.parameters))
        count, nodes = STAGES * n, STAGES + 1
        self.space = Space(
            np.zeros(W.SIZE),
            np.zeros((nodes, n, n)), np.zeros((nodes, n, n)), np.zeros((nodes, n, n)), aligned(nodes, n, p),
            aligned(len(self.scene.bodies) - n, p),
            aligned(count, _filled_up(count)), np.zeros((count, count)), np.zeros(count, dtype=np.int64),
            aligned(count, p), aligned(2 * n, p), aligned(2 * n, p),
        )  # fmt: skip
        self.linear = Linear(self.numbers, self.kernels, sources_of(directions), self._loads(n), self.space)

    def _loads(self, n: int) -> Loads:
        tables, size = self.scene.tables, normal_size(len(self.scene.bodies))
        return Loads(
            slopes_of(tables, "numbers"), slopes_of(tables, "normals"), np.zeros(1),
            np.zeros(n * len(self.scene.vector)), np.zeros(len(self.scene.contacts) * size),
        )  # fmt: skip


def _motion(run: _Run, simulation: Simulation, plan: Plan) -> Motion:
    """Record the whole run."""
    parts: list[Motion] = []
    n, depth = run.scene.size, 4 + 2 * len(plan.method.dense)
    span, limits = plan.span, plan.limits._replace(rest=0.0)
    counters, most = plan.account.counters, limits.most_steps
    before = counters[L.N_STEPS] + counters[L.N_REJECTED]
    while True:
        part = Motion(np.zeros((ROWS, 2)), np.zeros((ROWS, depth, n)), np.zeros(ROWS, np.int64))
        time, step, status, rows = record(
            span, plan.drive, run.numbers, run.kernels, run.regime, plan.method.coefficients, limits,
            Log(part, plan.account.counters),
        )  # fmt: skip
        parts.append(Motion(*(array[:rows] for array in part)))
        if status != FULL:
            simulation.reached(plan, time, step, status)
            break
        span = span._replace(time=time, step=step)
        used = counters[L.N_STEPS] + counters[L.N_REJECTED] - before
        limits = limits._replace(most_steps=max(0, most - int(used)))  # of the whole run, not of each part
    if len(parts) == 1:
        return parts[0]
    return Motion(*(np.ascontiguousarray(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)))


def rest_slopes(run: _Run, rest: Array, u: float) -> Array:
    """Derivatives (n, P) of the angles at rest: K d = -load, the balance differentiated."""
    n, count = run.scene.size, len(run.directions.parameters)
    run.space.point[:] = 0.0
    run.space.point[W.Q : W.Q + n] = rest
    run.space.point[W.STATIC] = 1.0
    linearise_node(0, u, run.linear)
    run.space.point[W.STATIC] = 0.0
    _, stiff, _ = balance(run.scene, rest, u)
    return np.asarray(np.linalg.solve(stiff, -run.space.load[0, :, :count]))


def input_kinks(time: Array, value: Array) -> Array:
    """Strongest kinks of an input table (m, 2): a step that goes on over one may see nothing of it at its nodes.

    Not all: between the samples of a measured force they are all alike, and error control is enough.
    """
    slope = np.diff(value) / np.diff(time)
    bend = np.abs(np.diff(slope))
    least = max(WEAK_KINK * np.max(bend, initial=0.0), 1e-9 * np.max(np.abs(slope), initial=0.0))  # above rounding
    strongest = np.argsort(-bend, kind="stable")[:INPUT_KINKS]
    at = time[1:-1][strongest[bend[strongest] > least]]
    return np.repeat(at, 2).reshape(-1, 2)


def key_rest_slopes(directions: Directions, rest: Array, force_n: float = 0.0) -> Array:
    """Derivatives (P,) of the key's angle at rest under a force, in a scene whose key is free."""
    return np.asarray(rest_slopes(_Run(directions), rest, force_n)[directions.scene.bodies.index("key")])


@dataclass(frozen=True)
class Followed:
    """Derivatives at the times that were wanted, in their order.

    Attributes
    ----------
    filled_angle, filled_speed : (m, n, P') with columns of zeros that fill up the lanes
    count : P, of parameters
    acts : (P,) whether anything has moved with a parameter up to the last time
    counters : what was counted
    """

    filled_angle: Array
    filled_speed: Array
    count: int
    acts: NDArray[np.bool_]
    counters: dict[str, int | float]

    @property
    def angle(self) -> Array:
        """Derivatives of the angles (m, n, P)."""
        return self.filled_angle[:, :, : self.count]

    @property
    def speed(self) -> Array:
        """Derivatives of the speeds (m, n, P)."""
        return self.filled_speed[:, :, : self.count]


class Recorded:
    """A motion from rest that was integrated and recorded, with what its derivatives need.

    ``carried`` (P,) are derivatives of a prescribed key's angle, the same at all times.
    """

    def __init__(
        self,
        directions: Directions,
        simulation: Simulation,
        plan: Plan,
        rest_input: float,
        carried: Array | None = None,
    ) -> None:
        self.directions, self.simulation, self.drive = directions, simulation, plan.drive
        self.run = _Run(directions)
        if carried is not None:
            self.run.space.carried[0, : len(carried)] = carried
        self.rest = plan.span.angle.copy()
        self.d_rest = rest_slopes(self.run, self.rest, rest_input)
        self.motion = _motion(self.run, simulation, plan)

    def states(self, times: Array) -> tuple[Array, Array]:
        """Angles and speeds (m, n) at times (m,)."""
        angle, speed = np.empty((2, len(times), self.run.scene.size))
        states_along(self.motion, np.ascontiguousarray(times, dtype=float), angle, speed)
        return angle, speed

    def acceleration(self, time: float) -> Array:
        """Accelerations (n,) at a time."""
        n, w = self.run.scene.size, np.zeros(W.SIZE)
        angle, speed = self.states(np.array([time]))
        w[W.Q : W.Q + n], w[W.V : W.V + n] = angle[0], speed[0]
        u = float(np.interp(time, self.drive.time, self.drive.value))
        self.run.kernels.linearise(w, self.run.scene.vector, u)
        return w[W.ACC : W.ACC + n]

    def _stride(self) -> int:
        return max(1, round(STRIDE * (STRIDE_AT / self.simulation.tolerance) ** STRIDE_EXPONENT))

    def follow(self, times: Array, tolerance: float) -> Followed:
        """Derivatives at times (m,) in any order, and what was counted.

        Raises
        ------
        IntegrationError : the derivatives could not be carried on
        """
        run, motion = self.run, self.motion
        n, p = self.d_rest.shape
        filled = _filled_up(p)
        kinks = np.empty((4 * len(motion.time) + 4, 2))
        found = find_kinks(motion, self.drive, run.scene.vector, run.kernels.linearise, run.regime, kinks)
        scale = np.array([parameter.scale for parameter in self.directions.parameters])
        floor = aligned(2, filled)
        floor[:, :p], floor[:, p:] = [LEAST_ANGLE / scale, LEAST_SPEED / scale], 1.0
        angle, speed = aligned(len(times), n, filled), aligned(len(times), n, filled)
        landing = np.concatenate([kinks[:found], input_kinks(self.drive.time, self.drive.value)])
        landing = np.ascontiguousarray(landing[np.argsort(landing[:, 0], kind="stable")])
        order = np.argsort(times, kind="stable")
        wanted = Wanted(times[order], order, angle, speed, tolerance, floor, self._stride())
        run.space.largest[:] = 0.0
        run.space.largest[:n, :p] = np.abs(self.d_rest)
        tangent, reached = aligned(2, n, filled), aligned(2, n, filled)
        tangent[0, :, :p] = self.d_rest
        status, time, steps, rejected = follow(motion, self.drive, landing, run.linear, wanted, tangent, reached, NODE)
        if status == STEP_TOO_SMALL:
            raise IntegrationError(f"sensitivities: the step of the derivatives fell below 1e-13 s at t = {time:.6g} s")
        if status == TOO_MANY_STEPS:
            raise IntegrationError(
                f"sensitivities: the derivatives took {steps + rejected} attempts up to t = {time:.6g} s of "
                f"{np.max(times):g} s; ask for fewer parameters, a larger tolerance or a shorter blow"
            )
        counted = {"n_tangent_steps": steps, "n_tangent_rejected": rejected, "n_kinks": found}
        acts = np.any(run.space.largest[:, :p], axis=0)
        return Followed(angle, speed, p, acts, {**self.simulation.work(), **counted})

    def normal_forces(self, state: tuple[Array, Array], slopes: tuple[Array, Array]) -> tuple[Array, Array]:
        """Normal forces (m, c), N, and their derivatives (m, c, P); the states' are (m, n, P), filled up to lanes."""
        scene, linear = self.run.scene, self.run.linear
        normal = np.empty((len(state[0]), len(scene.contacts)))
        out = aligned(*normal.shape, slopes[0].shape[2])
        moved = Moved(*state, *slopes)
        contacts_at = int(scene.tables.offset[1])
        normal_slopes(moved, scene.vector, contacts_at, linear.sources, linear.loads, np.zeros(W.SIZE), normal, out)
        return normal, out[:, :, : len(self.directions.parameters)]
