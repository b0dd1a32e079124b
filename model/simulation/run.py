"""A simulation of a scene that can be advanced, stopped and resumed.

`State` is plain data, so that saving it and going on later gives the same numbers to the last bit. A failed integration
raises ``IntegrationError``; the state stays the last accepted one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.codegen.evaluate_observables import contacts_at, tips_at
from model.codegen.load import load_kernel, load_kernels
from model.codegen.observable_columns import DEPTH, FRICTION, NORMAL, TIP_FORCE
from model.elements.structure import Structure
from model.errors import InputError, IntegrationError
from model.integrators.methods import DEFAULT_METHOD, RosenbrockTableau, get_method
from model.integrators.step_control import FIRST_STEP, NOT_FINITE, STEP_TOO_SMALL, TOO_MANY_STEPS
from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.signatures import Account, InputTable, Limits, Outputs, SceneNumbers, Span, StepKernels
from model.scene.build import Scene
from model.scene.key_motion import append_prescribed_motion
from model.simulation.negative_contact_force import describe_jumps, describe_pull
from model.simulation.solution import EnergyAudit
from model.simulation.statics import with_pins
from model.simulation.string_motion import propagate_free_string, straight_string_state, string_loss
from model.tolerance import DEFAULT_TOLERANCE

# Local error allowed per step for a requested largest error of an angle over the whole run: found with
# benchmarks/tolerance.py so that the error stays near or below the request on blows from piano to 60 N
# (docs/explanation/steps.md). Kinks of contacts and force tables cost order, hence the extra power.
ANGLE_SHARE = 0.17
SPEED_SHARE = 1.7  # 1/s
EXTRA_POWER = 0.05  # of the tolerance, from that figure
REFERENCE_TOLERANCE = 1e-5  # rad, at which the shares above hold as they are
# Where the key's motion is given the answer is the force that holds it: contacts turn an error of an angle or speed
# into one of force, which no inertia smooths. A third of the local error: docs/explanation/steps.md.
PRESCRIBED_SHARE = 1.0 / 3.0
# What sticks by friction creeps at a fraction of the threshold speed v_t. A local error of that size shakes it loose,
# in the simulation only, whatever the tolerance says: share of v_t at a lever of 0.1 m that an error may reach
# (tests/model/data/false_slip.json, found by benchmarks/stability.py). It costs next to no steps.
CREEP_SHARE, LEVER_M = 0.03, 0.1

REST_SHARE = 0.1  # share of the requested tolerance that an action taken to be at rest may still move

# some thirty times what a blow needs at 1e-5 rad; steps grow with the tolerance's fourth root (steps.md)
STEPS_AT_LEAST, STEPS_PER_SECOND = 20_000, 200_000

SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-12, 1e-2  # rad: rounding of a blow; a fifth of the key's turn
TIME_SLACK = 1e-9  # s, rounding of times computed in different ways
LARGEST_ANGLE, LARGEST_SPEED = 1e3, 1e6  # rad, rad/s

_ADVICE = {
    STEP_TOO_SMALL: "the step fell below 1e-12 s; check that no bodies overlap at the start, "
    "then stiffness and friction thresholds; or loosen `tolerance`",
    NOT_FINITE: "the equations gave a value that is not finite; check the input and the geometry",
    TOO_MANY_STEPS: "too many steps; loosen `tolerance` or shorten the run",
}


@dataclass
class State(ArrayRecord):
    """State of a run: time (s), angles (n,) rad, speeds (n,) rad/s, next step to try (s), memories (z,).

    Memories are those of felt, then how far joints give (m) and how fast (m/s), then those of a string. Without them a
    run starts with felt that has rested at these angles, joints in balance with it, and a straight string.
    """

    time_s: float
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    step_s: float = FIRST_STEP
    memory: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def copy(self) -> State:
        """An independent copy."""
        return State(self.time_s, self.angle_rad.copy(), self.speed_rad_per_s.copy(), self.step_s, self.memory.copy())

    def check(self, size: int) -> None:
        """Refuse what is no state of ``size`` coordinates."""
        for name, array in (("angles", self.angle_rad), ("speeds", self.speed_rad_per_s)):
            if np.shape(array) != (size,):
                raise InputError(f"state: {np.shape(array)} {name} found, allowed ({size},)")
            if not np.all(np.isfinite(array)):
                raise InputError(f"state: {name} must be finite, found {array}")
        for name, found, limit in (
            ("angles", self.angle_rad, LARGEST_ANGLE),
            ("speeds", self.speed_rad_per_s, LARGEST_SPEED),
        ):
            if np.max(np.abs(found)) > limit:
                raise InputError(f"state: {name} found up to {np.max(np.abs(found)):g}, allowed to {limit:g} (rad, s)")
        if not (np.isfinite(self.time_s) and self.step_s > 0.0 and np.isfinite(self.step_s)):
            raise InputError(
                f"state: found time {self.time_s:g} s, next step {self.step_s:g} s; "
                "allowed finite numbers and a step above 0"
            )


def complete_memory(scene: Scene, state: State, u: float = 0.0) -> State:
    """The state with internal variables: its own, checked, or, where it has none, those of felt at rest at its angles.

    Joints that give are in balance under the input ``u``.
    """
    string, give = straight_string_state(scene), len(scene.pins)
    count, found = len(scene.tables.memory) + 2 * give + len(string), np.shape(state.memory)
    if count and found == (0,):
        whole = with_pins(scene, state.angle_rad, u) if give else state.angle_rad
        felt = _rested_memories(scene, state, whole) if len(scene.tables.memory) else np.empty(0)
        return replace(state, memory=np.concatenate([felt, whole[scene.size :], np.zeros(give), string]))
    if found != (count,) or not np.all(np.isfinite(state.memory)):
        raise InputError(f"state: found memories {state.memory}, allowed {count} finite numbers, or none")
    return state


def _rested_memories(scene: Scene, state: State, whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Internal variables (z,) of felt at rest at the state's angles; ``whole`` includes joint displacements."""
    w = np.zeros(W.WITH_MEMORY if scene.pins else W.SIZE)
    w[W.Q : W.Q + scene.size] = state.angle_rad
    w[W.Z : W.Z + len(scene.pins)] = whole[scene.size :]  # the static scene remembers nothing else
    load_kernels(scene.static_tables).linearise(w, scene.vector, state.time_s)
    rows = np.concatenate([whole[scene.size :], np.zeros(len(scene.pins))])[None]
    angles = w[None, W.Q : W.Q + scene.size]
    if np.any(scene.tables.prescribed):
        moved = np.array([[w[W.Q + scene.size], 0.0]])
        angles, _ = append_prescribed_motion(
            scene.static_tables, scene.vector, (angles, np.zeros_like(angles)), moved, rows
        )
    found = contacts_at(scene.static_tables, scene.vector, angles, np.zeros_like(angles), rows)[0]
    s, p, out = Structure(scene.tables), scene.vector, list[float]()
    for c in dict.fromkeys(s.memory):
        curve = p[s.offset[1] + L.CONTACT_SIZE * c + L.K_A :][:3].tolist()
        numbers = [p[n.args[1]] for n in s.law_numbers(c)]
        out += s.law(c).rest_memories(max(0.0, float(found[c, DEPTH])), tuple(curve), numbers, len(s.memories(c)))
    return np.array(out)


def check_input(
    span_s: tuple[float, float],
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> None:
    """Refuse a span that ends before it begins, an input table that is not finite and increasing, and output times
    outside the span."""
    now, until = span_s
    if not until >= now - TIME_SLACK or np.isinf(until):
        raise InputError(f"end of the run: found {until:g} s, allowed a finite time from now on ({now:g} s)")
    if times.ndim != 1 or times.shape != values.shape or len(times) == 0:
        raise InputError(f"input: found shapes {times.shape} and {values.shape}, allowed two equal rows of numbers")
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise InputError("input: found a time or value that is not finite; remove or repair the row")
    if np.any(np.diff(times) <= 0.0):
        raise InputError("input: times found that do not increase; allowed increasing times")
    if len(outputs) and not (
        np.all(np.diff(outputs) >= 0.0) and outputs[0] >= now - TIME_SLACK and outputs[-1] <= until + TIME_SLACK
    ):
        raise InputError(f"output times: allowed increasing, from now ({now:g} s) to the end ({until:g} s)")


class Plan(NamedTuple):
    """What a step loop is given, but for the scene's kernels; see `model.kernels.signatures`."""

    method: RosenbrockTableau
    span: Span
    drive: InputTable
    out: Outputs
    scene: SceneNumbers
    limits: Limits
    account: Account


@dataclass
class Simulation:
    """A scene under way.

    Parameters
    ----------
    scene : what takes part, with all numbers
    state : where it starts; replaced by `advance`
    tolerance : requested largest error of any angle, rad
    method : name of the integration method
    largest_step_s : upper bound of a step, s
    max_steps : most steps of one `advance`; by default in proportion to the time to cover
    energy : also integrate work and losses along the motion
    creep : share of the bound that creep under friction sets to errors; a run that judges another needs less of it
    """

    scene: Scene
    state: State
    tolerance: float = DEFAULT_TOLERANCE
    method: str = DEFAULT_METHOD
    largest_step_s: float = 0.05  # s: shorter than a stroke, so that no step jumps over one
    max_steps: int | None = None
    counters: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(L.COUNTERS), dtype=np.int64))
    energy: bool = False
    creep: float = 1.0
    audit: NDArray[np.float64] = field(default_factory=lambda: np.zeros(9))
    times: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    remembered: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))
    """(m, z) what felt remembered at the output times of the last `advance`; none for most scenes."""
    _kernels: StepKernels | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse a tolerance or a state that cannot be used."""
        if not SMALLEST_TOLERANCE <= self.tolerance <= LARGEST_TOLERANCE:
            raise InputError(
                f"tolerance: found {self.tolerance:g} rad, allowed {SMALLEST_TOLERANCE:g} to {LARGEST_TOLERANCE:g}"
            )
        self.state.check(self.scene.size)
        self.state = complete_memory(self.scene, self.state)

    def advance(
        self,
        until: float,
        input_time_s: ArrayLike,
        input_value: ArrayLike,
        *,
        held: bool = False,
        output_time_s: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Go on to time ``until``, s, under an input linear between its points (``held``: constant from each on); the
        state changes; return angles and speeds (m, n) at ``output_time_s`` (m,), None: none.

        Parameters
        ----------
        until : s
        input_time_s, input_value : (k,) increasing times (s) and force (N) or motor torque (N m)
        held : keep each value until the next time (a converter's output) instead of interpolating linearly
        output_time_s : (m,) times at which to give the trajectory, between now and ``until``

        Returns
        -------
        angles, speeds : (m, n)
        """
        plan = self.plan(until, input_time_s, input_value, held=held, output_time_s=output_time_s)
        return self.accept_result(plan, *self.carry_out(plan))

    def carry_out(self, plan: Plan) -> tuple[float, float, int]:
        """Run the step loop of a plan, which fills the plan's state and outputs but leaves this simulation's; return
        the time reached (s), the next step to try (s) and the status."""
        if self._kernels is None:  # found once: a run may be advanced block by block
            self._kernels = load_kernels(self.scene.tables)
            if self.energy:
                self._kernels = self._kernels._replace(energy=load_kernel(self.scene.tables, "energy"))
        kernels, method = self._kernels, plan.method
        end: tuple[float, float, int] = method.loop(
            plan.span, plan.drive, plan.out, plan.scene, kernels, method.coefficients, plan.limits, plan.account
        )
        return end

    def plan(
        self,
        until: float,
        input_time_s: ArrayLike,
        input_value: ArrayLike,
        *,
        held: bool = False,
        output_time_s: ArrayLike | None = None,
    ) -> Plan:
        """Arguments of the step loop for `advance`, with copies of the state and empty outputs; `InputError` for an
        input or output times that cannot be used. Nothing is run."""
        method = get_method(self.method)
        local = method.share * self.tolerance * min(1.0, (self.tolerance / REFERENCE_TOLERANCE) ** EXTRA_POWER)
        if np.any(self.scene.tables.prescribed):
            local *= PRESCRIBED_SHARE
        outputs = np.empty(0) if output_time_s is None else as_numbers(output_time_s, "output times", 1)
        out_q = np.full((len(outputs), self.scene.size), np.nan)
        out_v = np.full((len(outputs), self.scene.size), np.nan)
        times, values = as_numbers(input_time_s, "input times"), as_numbers(input_value, "input")
        check_input((self.state.time_s, float(until)), times, values, outputs)
        if self.scene.command is not None:
            times, values = self.scene.command.table(times, values, held)
        # what rounding puts just past the end, `_check` lets through, the step loop would not reach
        outputs = np.minimum(outputs, max(float(until), self.state.time_s))
        out_z = np.full((len(outputs), len(self.state.memory)), np.nan)
        if len(times) == 1:
            times, values = np.array([times[0], times[0] + 1.0]), np.array([values[0], values[0]])
        most = self.max_steps
        if most is None:
            tighter = max(1.0, (REFERENCE_TOLERANCE / self.tolerance) ** 0.25)
            most = STEPS_AT_LEAST + int(STEPS_PER_SECOND * tighter * max(0.0, min(1e6, until - self.state.time_s)))
        q, v = self.state.angle_rad.copy(), self.state.speed_rad_per_s.copy()
        return Plan(
            method,
            Span(float(self.state.time_s), float(until), float(self.state.step_s), q, v, self.state.memory.copy()),
            InputTable(times, values, bool(held)),
            Outputs(outputs, out_q, out_v, out_z, np.empty((0, 0))),
            SceneNumbers(self.scene.vector, self.scene.tables.parent[: self.scene.size], self.scene.solved_contacts),
            Limits(
                angle=ANGLE_SHARE * local,
                speed=min(SPEED_SHARE * local, self._creep()),
                rest=REST_SHARE * self.tolerance,
                longest_step=float(self.largest_step_s),
                most_steps=int(most),
            ),
            Account(self.counters, self.times, self.audit if self.energy else np.empty(0)),
        )

    def accept_result(
        self, plan: Plan, time: float, step: float, status: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take over the state in which a step loop left a plan; return its angles and speeds (m, n), or raise the error
        that stopped it."""
        self.state = State(time, plan.span.angle, plan.span.speed, step, plan.span.memory)
        outputs, out_q, out_v, self.remembered, _ = plan.out
        if status in (NOT_FINITE, STEP_TOO_SMALL):
            u = float(np.interp(time, plan.drive.time, plan.drive.value))
            u = time if np.any(self.scene.tables.prescribed) else u
            pulls = describe_pull(self.scene, time, (plan.span.angle, plan.span.speed, plan.span.memory), u)
            if pulls:
                raise InputError(pulls)
        if status in _ADVICE:
            jumps = describe_jumps(self.scene) if status == STEP_TOO_SMALL else ""
            raise IntegrationError(
                f"simulation stopped at t = {time:.6g} s{self._extremes()}: {_ADVICE[status]}{jumps}"
            )
        if not (np.all(np.isfinite(out_q)) and np.all(np.isfinite(out_v))):
            row = int(np.argmin(np.all(np.isfinite(out_q) & np.isfinite(out_v), axis=1)))
            raise IntegrationError(f"simulation: no finite state at t = {outputs[row]:.6g} s; {_ADVICE[NOT_FINITE]}")
        return out_q, out_v

    def _creep(self) -> float:
        """Largest error of a speed, rad/s, that cannot shake loose what friction holds."""
        p, start = self.scene.vector, int(self.scene.tables.offset[1])
        friction = p[start + L.MU_A :: L.CONTACT_SIZE][: len(self.scene.contacts)]
        return self.creep * CREEP_SHARE * float(p[L.V_T]) / LEVER_M if np.any(friction) else np.inf

    def _extremes(self) -> str:
        """Largest speed and contact force of the present state, for a message: most often bodies overlap."""
        q, v = self.state.angle_rad, self.state.speed_rad_per_s
        fastest = int(np.argmax(np.abs(v)))
        words = f" ({self.scene.bodies[fastest]} at {v[fastest]:.3g} rad/s"
        if self.scene.contacts and len(q) == len(self.scene.bodies):
            normal = self.contact_forces(q[None], v[None], self.state.memory[None])[0][0]
            words += f", {self.scene.contacts[int(np.argmax(normal))]} presses with {normal.max():.3g} N"
        return words + ")"

    def stored_energy(self) -> float:
        """Kinetic, potential and elastic energy of the present state, J; zero of heights at the ground's origin."""
        w = np.zeros(W.WITH_MEMORY)
        memory = propagate_free_string(self.scene, np.array([self.state.time_s]), self.state.memory[None])[0]
        w[W.AUDIT_Z : W.AUDIT_Z + len(memory)] = memory
        w[W.AUDIT_Q : W.AUDIT_Q + self.scene.size] = self.state.angle_rad
        w[W.AUDIT_V : W.AUDIT_V + self.scene.size] = self.state.speed_rad_per_s
        load_kernel(self.scene.tables, "energy")(
            w, self.scene.vector, self.state.time_s
        )  # a prescribed coordinate asks when
        return float(w[W.ENERGY])

    def energy_audit(self, start: State, stored_j: float) -> EnergyAudit:
        """Where the work went since ``start``, at which the scene stored ``stored_j``."""
        given, *lost = map(float, self.audit)
        audit = EnergyAudit(given, self.stored_energy() - stored_j, *lost)
        times, rows = (start.time_s, self.state.time_s), (start.memory, self.state.memory)
        return replace(audit, lost_in_string=audit.lost_in_string + string_loss(self.scene, times, rows))

    def contact_forces(
        self,
        angle_rad: ArrayLike,
        speed_rad_per_s: ArrayLike,
        memory: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Normal and friction force (m, c), N, of each contact at angles and speeds (m, n); ``memory`` (m, z), where
        felt remembers: by default that of the last outputs."""
        found = contacts_at(*self._states(angle_rad, speed_rad_per_s, self.remembered if memory is None else memory))
        return found[:, :, NORMAL], found[:, :, FRICTION]

    def probe_forces(self, angle_rad: ArrayLike, speed_rad_per_s: ArrayLike) -> NDArray[np.float64]:
        """Force of each one-sided probe (the motor arm on the key) at given states; (m, n) in, (m, b) out, N.

        Where something remembers, the states are those last given out.
        """
        return tips_at(*self._states(angle_rad, speed_rad_per_s, self.remembered))[:, :, TIP_FORCE]

    def _states(
        self, angle_rad: ArrayLike, speed_rad_per_s: ArrayLike, memory: ArrayLike
    ) -> tuple[L.Tables, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The scene, states (m, n) and what belongs to them, as the kernels take them."""
        q, v = as_numbers(angle_rad, "states: angles", 2), as_numbers(speed_rad_per_s, "states: speeds", 2)
        rows = as_numbers(memory, "states: memories", 2)
        return self.scene.tables, self.scene.vector, q, v, rows if self.scene.remembers else np.empty((len(q), 0))

    def work(self) -> dict[str, int | float]:
        """Counters of the work done so far, by name; ``time_at_rest`` in s."""
        out: dict[str, int | float] = {n: int(k) for n, k in zip(L.COUNTERS, self.counters, strict=True)}
        out["time_at_rest"] = float(self.times[0])
        return out
