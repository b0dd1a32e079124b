"""Derivatives of a recorded motion by parameters: its rest state, its tangents and its normal forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.codegen.load import load_kernel, load_kernels, memory_couplings
from model.codegen.parameter_derivatives import CARRIED, normal_places, normal_sizes
from model.elements.strings import AWAKE
from model.elements.structure import Structure
from model.errors import InputError, IntegrationError
from model.integrators.step_control import FULL
from model.integrators.tangents.channels import Channels, Modes
from model.integrators.tangents.integrate import NODE, STEP_TOO_SMALL, TOO_MANY_STEPS, Landings, integrate_tangents
from model.integrators.tangents.linearised_nodes import Linear, Space, linearise_node
from model.integrators.tangents.parameter_loads import Loads, MotionDerivatives, Sources, normal_force_derivatives
from model.integrators.tangents.radau import STAGES, TangentOutputs
from model.integrators.tangents.recorded_motion import Motion, RegimeDetector, find_kinks, interpolate_states
from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.lanes import LANES, allocate_aligned
from model.kernels.signatures import SceneNumbers, StepKernels
from model.scene.pressing import steady_current
from model.sensitivity.parameter_names import Directions
from model.sensitivity.sources import find_sources, input_derivatives, mode_derivatives, rest_input_derivatives
from model.simulation.run import Plan, Simulation

Array = NDArray[np.float64]

# Steps of the motion that one of the tangents may span: a layer in which friction turns is found by the motion's steps,
# of which a looser motion has fewer. Found with benchmarks/sensitivities.py.
STRIDE, STRIDE_AT, STRIDE_EXPONENT = 8, 2e-9, 0.2
INPUT_KINKS, WEAK_KINK = 50, 0.01  # of the input that steps end at; of the strongest
JUMP = 1e-4  # share of the largest rate at a kink: above what changes within the picosecond of a kink
ROWS = 20_000  # steps recorded at a time
UNTOUCHED = 1.2345e300  # what a kernel leaves in places that it fills in no state
# derivatives below these, per change of a parameter by all of its value, do not decide about steps
LEAST_ANGLE, LEAST_SPEED = 1e-4, 1e-2  # rad, rad/s


def _pad_to_lanes(count: int) -> int:
    """Columns for that many parameters: a multiple of the lanes; those beyond stay zero."""
    return -(-count // LANES) * LANES


class _Run:
    """The kernels, numbers and memory that motion and tangents of one scene share."""

    def __init__(self, directions: Directions) -> None:
        self.directions, self.scene = directions, directions.scene
        tables = self.scene.tables
        self.kernels: StepKernels = load_kernels(tables)
        self.numbers = SceneNumbers(self.scene.vector, tables.parent[: self.scene.size], self.scene.solved_contacts)
        self.structure = s = Structure(tables)
        self.regime = load_kernel(tables, "regime")
        n, p = s.free, _pad_to_lanes(len(directions.parameters))
        count, nodes = STAGES * n, STAGES + 1
        places = [W.P_STIFF, W.P_DAMP, W.P_INPUT, W.P_MASS, W.WIDE] if s.pin else [W.STIFF, W.DAMP, W.F_U, -1, W.WIDTH]
        self.space = Space(
            self.workspace(),
            np.zeros((nodes, n, n)), np.zeros((nodes, n, n)), np.zeros((nodes, n, n)), allocate_aligned(nodes, n, p),
            allocate_aligned(len(self.scene.bodies) - self.scene.size, p),
            allocate_aligned(count, _pad_to_lanes(count)), np.zeros((count, count)), np.zeros(count, dtype=np.int64),
            allocate_aligned(count, p), allocate_aligned(2 * n, p), allocate_aligned(2 * n, p),
            np.zeros(count, dtype=np.int64),
            np.zeros((STAGES, 2)), allocate_aligned(1, p), np.array([*places, s.own, *s.solved]),
            self._allocate_channels(p),
        )  # fmt: skip
        sources = find_sources(directions)
        self.linear = Linear(
            self.numbers, self.kernels, sources, self._allocate_loads(sources), self.space, allocate_aligned(0, 2, p)
        )

    def workspace(self) -> Array:
        return np.zeros(W.WITH_MEMORY if self.scene.remembers else W.SIZE)

    def _allocate_loads(self, sources: Sources) -> Loads:
        """Kernels of the derivatives by the parameters of ``sources``, with allocated arrays for what they fill."""
        s, tables = self.structure, self.scene.tables
        size, places = s.free + len(s.memory) + len(s.string), normal_places(s)
        first = np.cumsum([0, *(len(row) for row in places)])
        memory = np.cumsum([0, *(len(s.memories(c)) for c in range(len(s.contact)))])
        modes = self.count_of_modes()
        numbers, by_number = load_kernel(tables, "numbers"), np.full(size * len(self.scene.vector), UNTOUCHED)
        numbers(self.workspace(), np.zeros(1), self.scene.vector, by_number)
        row = by_number.reshape(-1, size)[sources.number] != UNTOUCHED  # of what no law has, no derivative is ever put
        k, i = np.nonzero(row)
        acting = np.column_stack([size * sources.number[k] + i, i, sources.first[k], sources.first[k + 1]])
        by_number[:] = 0.0
        return Loads(
            numbers, load_kernel(tables, "normals"), load_kernel(tables, "propagate_modes"), np.zeros(1),
            by_number, np.zeros(sum(normal_sizes(s))), np.zeros(CARRIED * modes),
            first, np.array([k for row in places for k in row], dtype=np.int64), memory,
            s.string[0] if s.string else -1, np.ascontiguousarray(acting),
        )  # fmt: skip

    def count_of_modes(self) -> int:
        s = self.structure
        return int(self.scene.vector[s.offset[7]]) if s.string else 0

    def _allocate_channels(self, p: int) -> Channels:
        """Allocated arrays for the tangents of felt and string by ``p`` columns of parameters."""
        s, nodes = self.structure, STAGES + 1
        links = memory_couplings(self.scene.tables) if s.memory or s.string else []
        c, most, own = len(links), max((len(row) for row in links), default=0), len(self.scene.bodies)
        table = np.zeros((c, most), dtype=np.int64)
        for row, of in zip(table, links, strict=True):
            row[: len(of)] = [s.own - 1 - j if s.own <= j < own else s.solved.index(j) for j in of]
        modes, strings = self.count_of_modes(), len(s.string)
        first = (s.offset[7] + L.STRING_HEAD) if s.string else 0
        moved = allocate_aligned(3, modes, p)
        moved[:, :, : len(self.directions.parameters)] = mode_derivatives(self.directions, first, modes)
        string = Modes(
            np.zeros(strings, dtype=np.int64), np.array([first]),
            np.ascontiguousarray(self.scene.vector[first : first + 3 * modes].reshape(3, modes)), moved,
            allocate_aligned(2, modes, p), allocate_aligned(nodes, modes, p), np.array([int(np.any(moved))]),
            np.zeros(nodes), np.zeros(nodes), np.zeros((modes, 4, STAGES)), np.zeros((modes, 2, STAGES, STAGES)),
            np.zeros((STAGES, STAGES)), allocate_aligned(2, STAGES * strings, p),
        )  # fmt: skip
        return Channels(
            table, np.array([len(row) for row in links], dtype=np.int64),
            np.zeros((nodes, c, most)), np.zeros((nodes, c, most)), np.zeros((nodes, c, most)), np.zeros((nodes, c)),
            allocate_aligned(nodes, c, p), np.zeros((c, STAGES, STAGES)), np.zeros((c, STAGES)),
            allocate_aligned(STAGES, c, p), allocate_aligned(STAGES, c, p), allocate_aligned(STAGES, c, p),
            allocate_aligned(c, p),
            np.zeros(len(s.memory)), np.zeros(len(s.memory), dtype=np.int64), np.zeros((3, STAGES, STAGES)), string,
        )  # fmt: skip

    def put_rest_state(self, angle: Array, memory: Array) -> None:
        self.space.point[:] = 0.0
        self.space.point[W.Q : W.Q + len(angle)] = angle
        self.space.point[W.Z : W.Z + len(memory)] = memory


def _record_motion(run: _Run, simulation: Simulation, plan: Plan) -> Motion:
    """Integrate ``plan`` and record every step; the plan's result is taken over into ``simulation``."""
    parts: list[Array] = []
    n, depth = run.scene.size, 2 + len(plan.method.dense)
    size = 2 * n + len(plan.span.memory)
    span, limits = plan.span, plan.limits._replace(rest=0.0)
    counters, most = plan.account.counters, limits.most_steps
    before = counters[L.N_STEPS] + counters[L.N_REJECTED]
    while True:
        rows, steps = np.zeros((ROWS, 2 + depth * size)), counters[L.N_STEPS]
        time, step, status = plan.method.loop(
            span, plan.drive, plan.out._replace(steps=rows), plan.scene, run.kernels, plan.method.coefficients, limits,
            plan.account,
        )  # fmt: skip
        parts.append(rows[: counters[L.N_STEPS] - steps])
        if status != FULL:
            simulation.accept_result(plan, time, step, status)
            break
        span = span._replace(time=time, step=step)
        used = counters[L.N_STEPS] + counters[L.N_REJECTED] - before
        limits = limits._replace(most_steps=max(0, most - int(used)))  # of the whole run, not of each part
    return Motion(parts[0] if len(parts) == 1 else np.concatenate(parts), size, n)


def _rest_derivatives(run: _Run, rest: Array, u: float) -> Array:
    """Derivatives (n, P) of the coordinates at rest, (n,), under ``u``: K d = -load, the balance differentiated.

    A winding's charge has no place at rest; its current has.
    """
    scene, count, size = run.scene, len(run.directions.parameters), run.scene.size
    run.put_rest_state(rest[:size], rest[size:])
    run.space.input_change[0, :count] = rest_input_derivatives(run.directions, u)
    if scene.command is not None:
        u = scene.command.value(u)
        for i in scene.wound:
            run.space.point[W.V + i] = steady_current(scene.vector[scene.tables.offset[2] :], u)
    run.space.point[W.STATIC] = 1.0
    linearise_node(0, u, run.linear._replace(input_slope=np.zeros((1, 2, run.space.load.shape[2]))))
    run.space.point[W.STATIC] = 0.0
    stiff, load = run.space.stiff[0].copy(), run.space.load[0, :, :count]
    for i in scene.wound:
        stiff[:, i] = run.space.damp[0, :, i]
    out = np.asarray(np.linalg.solve(stiff, -load))
    out[list(scene.wound)] = 0.0
    return out


def _scene_at_rest(directions: Directions) -> _Run:
    """Kernels and workspace for the scene at rest, where felt presses by its slow loading curve."""
    return _Run(replace(directions, scene=replace(directions.scene, tables=directions.scene.static_tables)))


def input_kinks(time: Array, value: Array) -> Array:
    """Times (m, 2), each twice, of the strongest kinks of an input table, at which tangent steps must end.

    Not all: between the samples of a measured force they are all alike, and error control is enough.
    """
    slope = np.diff(value) / np.diff(time)
    bend = np.abs(np.diff(slope))
    least = max(WEAK_KINK * np.max(bend, initial=0.0), 1e-9 * np.max(np.abs(slope), initial=0.0))  # above rounding
    strongest = np.argsort(-bend, kind="stable")[:INPUT_KINKS]
    at = time[1:-1][strongest[bend[strongest] > least]]
    return np.repeat(at, 2).reshape(-1, 2)


def rest_derivatives(directions: Directions, whole: Array, u: float) -> Array:
    """Derivatives (n + g, P) of the coordinates at rest ``whole`` under an input; what joints give comes last."""
    return _rest_derivatives(_scene_at_rest(directions), whole, u)


@dataclass(frozen=True)
class TangentResult:
    """Derivatives at the times that were wanted, in their order."""

    # whole_angle, whole_speed: (m, n, P); where joints give, how far they do follows the scene's coordinates
    whole_angle: Array
    whole_speed: Array
    channel: Array  # (m, C, P') of what felt and string remember, filled up to lanes; empty where it was not wanted
    own: int  # of the scene's coordinates
    acts: NDArray[np.bool_]  # (P,) whether anything has moved with a parameter up to the last time
    counters: dict[str, int | float]  # what was counted

    @property
    def angle(self) -> Array:
        """Derivatives of the angles (m, n, P)."""
        return self.whole_angle[:, : self.own]

    @property
    def speed(self) -> Array:
        """Derivatives of the speeds (m, n, P)."""
        return self.whole_speed[:, : self.own]


class RecordedMotion:
    """A motion from rest that was integrated and recorded, with what its derivatives need.

    ``until`` (s) and ``table`` are end and input of the run; ``rest`` the coordinates at rest and the input there;
    ``carried`` (P,) derivatives of a prescribed coordinate, the same at all times.
    """

    def __init__(
        self,
        directions: Directions,
        simulation: Simulation,
        until: float,
        table: tuple[Array, Array],
        rest: tuple[Array, float],
        carried: Array | None = None,
    ) -> None:
        plan = simulation.plan(until, *table)
        self.directions, self.simulation, self.drive = directions, simulation, plan.drive
        self.run = _Run(directions)
        s = self.run.structure
        still = _scene_at_rest(directions) if s.memory or s.string else self.run
        for run in (self.run, still):
            run.space.carried[0:1, : len(directions.parameters)] = 0.0 if carried is None else carried
        self.rest = rest[0][: directions.scene.size].copy()
        self._d_rest = _rest_derivatives(still, *rest)
        self._d_remembered = self._memory_rest_derivatives(plan)
        self.motion = _record_motion(self.run, simulation, plan)
        slopes = input_derivatives(directions, table, plan.drive.time)
        if len(slopes):
            filled = allocate_aligned(*slopes.shape[:2], self.run.space.load.shape[2])
            filled[:, :, : slopes.shape[2]] = slopes
            self.run.linear = self.run.linear._replace(input_slope=filled)

    def _memory_rest_derivatives(self, plan: Plan) -> Array:
        """Derivatives (C, P') of the internal variables at the start, where their rates are 0."""
        run, channels = self.run, self.run.space.channels
        out = allocate_aligned(*channels.inner.shape)
        if len(out):
            run.put_rest_state(plan.span.angle, plan.span.memory)
            linearise_node(0, plan.drive.value[0], run.linear)
            d_rest = np.zeros((self._d_rest.shape[0], out.shape[1]))
            d_rest[:, : self._d_rest.shape[1]] = self._d_rest
            for c in np.flatnonzero(channels.fade[0]):
                entered = channels.load[0, c].copy()
                for k in range(channels.many[c]):
                    j = channels.links[c, k]
                    entered += channels.turn[0, c, k] * (d_rest[j] if j >= 0 else run.space.carried[-1 - j])
                out[c] = -entered / channels.fade[0, c]
        return out

    @property
    def d_rest(self) -> Array:
        """Derivatives (n, P) of the angles at rest."""
        return self._d_rest[: self.run.scene.size]

    def states(self, times: Array) -> tuple[Array, Array]:
        """Angles and speeds (m, n) at times (m,)."""
        n, state = self.run.scene.size, self.whole_states(times)
        return state[:, :n], state[:, n : 2 * n]

    def whole_states(self, times: Array) -> Array:
        """Angles, speeds and internal variables (m, N) at times (m,)."""
        state = np.empty((len(times), self.motion.size))
        interpolate_states(self.motion, np.ascontiguousarray(times, dtype=float), state)
        return state

    def coordinates(self, times: Array) -> tuple[Array, Array]:
        """Angles and speeds (m, n) at times (m,), followed by how far joints give, and how fast."""
        n, state = self.run.scene.size, self.whole_states(times)
        ways, speeds = ([pair[k] for pair in self.run.structure.pin_places(2 * n).values()] for k in (0, 1))
        return state[:, [*range(n), *ways]], state[:, [*range(n, 2 * n), *speeds]]

    def acceleration(self, time: float) -> Array:
        """Accelerations (n + joints that give,) of all coordinates solved for, in the order of `coordinates`, rad/s^2
        or m/s^2, at a time, s."""
        s, w, n = self.run.structure, self.run.workspace(), self.run.scene.size
        state = self.whole_states(np.array([time]))[0]
        w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + len(state) - 2 * n] = np.split(state, [n, 2 * n])
        if s.string:
            w[W.NOW] = time
        u = float(np.interp(time, self.drive.time, self.drive.value))
        self.run.kernels.linearise(w, self.run.scene.vector, u)
        first = W.P_ACC if s.pin else W.ACC
        return w[first : first + s.free]

    def _string_landings(self) -> Array:
        """Rows (w, 3) for each time at which a string's modes are stepped again or left to vibrate: that time, s; how
        long they had vibrated, s (-1: they are left); index of the step."""
        s, n = self.run.structure, self.run.scene.size
        if not s.string:
            return np.empty((0, 3))
        since = self.motion.step[:, 2 + 2 * n + s.first_of_string() + L.SINCE]
        awake = since < 0.5 * AWAKE
        self.run.space.channels.modes.awake[0] = int(awake[0])
        at = np.flatnonzero(awake[1:] != awake[:-1]) + 1
        begin = self.motion.step[at, 0]
        return np.column_stack([begin, np.where(awake[at], begin - since[at - 1], -1.0), at])

    def _stride(self) -> int:
        return max(1, round(STRIDE * (STRIDE_AT / self.simulation.tolerance) ** STRIDE_EXPONENT))

    def follow(self, times: Array, tolerance: float, forces: bool = False) -> TangentResult:
        """Integrate the derivatives by the parameters along the motion to relative ``tolerance``; return them at times
        (m,), s, in any order, for felt and string with ``forces``, and work counters."""
        run, motion = self.run, self.motion
        n, p = self._d_rest.shape
        filled, count = _pad_to_lanes(p), len(run.space.channels.many)
        kinks = np.empty((4 * len(motion.step) + 4, 2))
        seen = RegimeDetector(
            self.drive,
            run.scene.vector,
            run.kernels.linearise,
            run.regime,
            bool(np.any(run.scene.tables.prescribed)),
            run.workspace(),
        )
        found = find_kinks(motion, seen, kinks)
        self._check_rates(kinks[:found])
        scale = np.array([parameter.scale for parameter in self.directions.parameters])
        floor = allocate_aligned(2, filled)
        floor[:, :p], floor[:, p:] = [LEAST_ANGLE / scale, LEAST_SPEED / scale], 1.0
        angle, speed = np.zeros((len(times), n, p)), np.zeros((len(times), n, p))
        channel, woken = allocate_aligned(len(times) if forces and count else 0, count, filled), self._string_landings()
        landing = np.concatenate(
            [kinks[:found], input_kinks(self.drive.time, self.drive.value), np.repeat(woken[:, :1], 2, axis=1)]
        )
        landing = np.ascontiguousarray(landing[np.argsort(landing[:, 0], kind="stable")])
        order = np.argsort(times, kind="stable")
        wanted = TangentOutputs(times[order], order, angle, speed, channel, tolerance, floor, self._stride())
        run.space.largest[:] = 0.0
        run.space.largest[:n, :p] = np.abs(self._d_rest)
        run.space.channels.inner[:] = self._d_remembered
        run.space.channels.modes.tangent[:] = 0.0
        tangent, reached = allocate_aligned(2, n, filled), allocate_aligned(2, n, filled)
        tangent[0, :, :p] = self._d_rest
        status, time, steps, rejected = integrate_tangents(
            motion, self.drive, Landings(landing, woken), run.linear, wanted, tangent, reached, NODE
        )
        if status == STEP_TOO_SMALL:
            raise IntegrationError(f"sensitivities: the step of the derivatives fell below 1e-13 s at t = {time:.6g} s")
        if status == TOO_MANY_STEPS:
            raise IntegrationError(
                f"sensitivities: the derivatives took {steps + rejected} attempts up to t = {time:.6g} s of "
                f"{np.max(times):g} s; ask for fewer parameters, a larger tolerance or a shorter blow"
            )
        counted = {"n_tangent_steps": steps, "n_tangent_rejected": rejected, "n_kinks": found}
        acts = np.any(run.space.largest[:, :p], axis=0)
        counters = {**self.simulation.work(), **counted}
        return TangentResult(angle, speed, channel, run.scene.size, acts, counters)

    def _check_rates(self, kinks: Array) -> None:
        """Raise `InputError` for a law that the user has added whose force or internal rate jumps across a kink, (k, 2)
        times before and after, s.

        The derivatives would jump there, too, by the jump times the derivative of the kink's own time.
        """
        s, run, drive = self.run.structure, self.run, self.drive
        added = [c for c in range(len(s.contact)) if s.law(c).added]
        if not added or not len(kinks):
            return
        first, n, memory = W.P_ACC if s.pin else W.ACC, run.scene.size, len(s.memory)
        rates = np.empty((len(kinks), 2, s.free + memory))
        for k, side in np.ndindex(len(kinks), 2):
            w, t = run.workspace(), kinks[k, side]
            state = self.whole_states(np.array([t]))[0]
            w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + len(state) - 2 * n] = np.split(state, [n, 2 * n])
            if s.string:
                w[W.NOW] = t
            moved = bool(np.any(run.scene.tables.prescribed))
            run.kernels.linearise(w, run.scene.vector, t if moved else float(np.interp(t, drive.time, drive.value)))
            rates[k, side] = [*w[first : first + s.free], *w[W.Z_RATE : W.Z_RATE + memory]]
        largest = np.abs(rates).max(axis=(0, 1))
        jumps = np.abs(rates[:, 1] - rates[:, 0]) > JUMP * largest
        for k in np.flatnonzero(jumps.any(axis=1)):
            remembering = [s.memory[m] for m in np.flatnonzero(jumps[k, s.free :])]
            which = [c for c in remembering if c in added] or added
            names = ", ".join(dict.fromkeys(f"{run.scene.contacts[c]}.law {s.law(c).name}" for c in which))
            what = "rate of a memory" if remembering else "force"
            raise InputError(
                f"sensitivities: {names}: the {what} jumps at t = {kinks[k, 0]:.6g} s, where felt begins or ceases to "
                "press or a 'where' of the law turns; derivatives need a law that is continuous there: let 'rates' and "
                "'alone' agree where the force is 0, as in model/elements/laws/stulov.py, or choose another law"
            )

    def remembered_slopes(self, followed: TangentResult, count: int) -> Array:
        """Derivatives (m, z, P) of the ``count`` internal variables; those of a string stay 0."""
        s, n = self.run.structure, self.run.scene.size
        rows, _, p = followed.whole_angle.shape
        out = np.zeros((rows, count, p))
        if len(s.memory):
            out[:, : len(s.memory)] = followed.channel[:, : len(s.memory), :p]
        for k, places in enumerate(s.pin_places(0).values()):
            for place, of in zip(places, (followed.whole_angle, followed.whole_speed), strict=True):
                out[:, place] = of[:, n + k]
        return out

    def normal_forces(self, state: Array, slopes: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        """Normal forces (m, c), N, at states (m, N), and their derivatives (m, c, P) from those of angles, speeds and
        channels."""
        scene, run = self.run.scene, self.run
        normal = np.empty((len(state), len(scene.contacts)))
        out = np.zeros((*normal.shape, len(self.directions.parameters)))
        moved, linear = MotionDerivatives(np.ascontiguousarray(state), *slopes), run.linear
        normal_force_derivatives(
            moved, scene.vector, scene.size, linear.sources, linear.loads, run.workspace(), normal, out
        )
        return normal, out
