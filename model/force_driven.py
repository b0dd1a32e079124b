"""Simulate an action under a measured or invented force table: the main function of ``model``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.files.force_table import check_force_table
from model.inside.observe_motion import observe
from model.keywords import make_options
from model.parameters.action import Action, ActionLike, as_action
from model.parameters.effects import STRING_EFFECT, column
from model.scene.build import Scene, build_scene
from model.scene.selection import SceneChoice
from model.scene.string_terms import with_modes
from model.simulation.compliant_joints import compliant_joint_motion
from model.simulation.loads_and_losses import Inside
from model.simulation.options import ForceDrivenKeywords, ForceDrivenOptions
from model.simulation.run import SMALLEST_TOLERANCE, Plan, Simulation, State
from model.simulation.solution import MISSED, Contacts, Solution
from model.simulation.statics import RestState, solve_rest
from model.simulation.string_motion import count_modes, string_motion

Array = NDArray[np.float64]

HIGHEST_RATE_HZ = 1e7  # of outputs: a second of them takes a gigabyte
COMPANION = 0.1  # tolerance of the run that an error is estimated with, of the requested one
SECOND_COMPANION = 0.01  # of another one, where the first leaves doubt


def output_times(start: float, end: float, rate_hz: float) -> Array:
    """Times start + k / ``rate_hz``, s, from ``start`` to at most ``end``, without accumulated rounding.

    Parameters
    ----------
    start, end : first and last possible time, s
    rate_hz : rows per second

    Returns
    -------
    ndarray
        Times (m,), s.

    Raises
    ------
    InputError : a rate that is not above 0 and up to 1e7 Hz

    Examples
    --------
    >>> import model
    >>> model.output_times(0.0, 0.5, 4.0)
    array([0.  , 0.25, 0.5 ])
    """
    if not np.isfinite(rate_hz) or not 0 < rate_hz <= HIGHEST_RATE_HZ:
        raise InputError(f"output rate: found {rate_hz:g} Hz, allowed above 0 to {HIGHEST_RATE_HZ:g}")
    count = int(np.floor((end - start) * rate_hz + 1e-9)) + 1
    return np.minimum(start + np.arange(count) / rate_hz, end)


def check_output_times(output_time_s: ArrayLike | None, table_s: Array) -> Array:
    """Return output times (m,), s, None: those of the force table, ``table_s``; ``InputError`` where they leave it or
    fall (equal ones are allowed)."""
    outputs = table_s if output_time_s is None else as_numbers(output_time_s, "output times", 1)
    if not np.all(np.isfinite(outputs)) or np.any(np.diff(outputs) < 0):
        raise InputError("output times: allowed a finite, increasing row of times")
    if len(outputs) and (outputs[0] < table_s[0] or outputs[-1] > table_s[-1]):
        raise InputError(
            f"output times: found {outputs[0]:g} to {outputs[-1]:g} s, allowed within the table, "
            f"{table_s[0]:g} to {table_s[-1]:g} s"
        )
    return outputs


class Recorded(Protocol):
    """A recorded trial: it has the force as it acted, and the times at which its sensors were read."""

    @property
    def time_s(self) -> Any:
        """Sample times (n,), s."""

    def corrected_force(self) -> Any:
        """Force with ``time_s`` and ``force_n``, (k,), and ``preload_n``, the load at rest."""


def simulate(
    action: ActionLike,
    time_s: ArrayLike | Recorded | None = None,
    force_n: ArrayLike | None = None,
    *,
    initial: RestState | State | None = None,
    **keywords: Unpack[ForceDrivenKeywords],
) -> Solution:
    """Predict the motion of all bodies under a table of times, s, and forces, N, down on the key (or of motor, drive or
    finger, as ``scene`` says), or under a recorded trial's; from ``initial``, by default at rest (a record: under its
    preload).

    Parameters
    ----------
    action : parameter set, its name or its file
    time_s, force_n : (k,) force table, linear between its points; with an effect that presses the key
        its input: torque of ``motor_arm``, N m; command of ``motor_drive``, V; motion of ``finger``, m. Or a recorded
        trial alone (`rig.TrialData`): its corrected force drives, from rest under its preload, and rows come out at
        its sample times
    initial : where to start; by default at rest, without force under a table
    tolerance : requested largest error of any angle, rad; by default 1e-5
    output_time_s : (m,) increasing, within the table; by default the table's own times
    scene : what takes part and what to give out, by name or file (`model.scene.selection`)
    method : integration method by name (`model.integrators.methods`)
    contact_forces : also compute normal and friction force of each contact
    energy : also account for the work of the force (`Solution.energy`)
    inside : also evaluate contacts, joints and bodies (`Solution.inside`)
    estimate_error : also estimate the largest error of any angle (`Solution.error_rad`), at about twice the cost

    Returns
    -------
    Solution
        Angles, rad, and speeds, rad/s, (m, 5), in the order of `model.BODIES`; with effects, their coordinates follow.

    Raises
    ------
    InputError : table, times or tolerance cannot be used
    IntegrationError : the integration could not go on

    Notes
    -----
    SI units, radians. Equations: thesis Chapter 2.

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.force_table("forte")
    >>> solution = model.simulate(model.load_action("hirschkorn2004"), time_s, force_n, contact_forces=True)
    >>> solution.angle_rad.shape, solution.bodies[0]
    ((3501, 5), 'key')
    >>> print(f"{solution.contacts['jack - knuckle'].normal_n.max():.1f} N")
    9.0 N
    >>> ax = solution.plot()
    >>> solution.to_frame().attrs["units"]["hammer_rad"]
    'rad'
    """
    options = make_options(ForceDrivenOptions, "model.simulate", keywords, ("time_s", "force_n", "initial"))
    if time_s is None:
        raise TypeError("model.simulate() needs time_s and force_n, or a recorded trial in their place")
    preload_n = 0.0
    if force_n is None:
        times, forces, preload_n, sampled = force_table_of_trial(time_s)
        options = options if options.output_time_s is not None else replace(options, output_time_s=sampled)
    else:
        times, forces = check_force_table(time_s, force_n)  # type: ignore[arg-type]  # a trial comes without a force
    outputs = check_output_times(options.output_time_s, times)
    action, choice = options.resolve(as_action(action))
    if force_n is None:
        require_force_input(choice)
    scene, fewer = resolve_string_modes(action, choice, options)
    if isinstance(initial, State):
        state = initial.copy()
    else:
        angle = solve_rest(scene, preload_n) if initial is None else initial.angle_rad
        state = State(float(times[0]), np.array(angle, dtype=float), np.zeros(scene.size))
    run = ForceDrivenRun(
        scene, times, forces, outputs, options.tolerance, options.method, choice.outputs,
        options.estimate_error, fewer,
    )  # fmt: skip
    return replace(run.simulate_from(state), action=action)


def force_table_of_trial(trial: Any) -> tuple[Array, Array, float, Array]:
    """Of a recorded trial: times (k,), s, and corrected force (k,), N, extended to the last sample; preload, N; and the
    sample times (n,), s, from the table's first on. `InputError` for what is no trial."""
    if not hasattr(trial, "corrected_force"):
        file = f"; read it by model.read_force_table({str(trial)!r})" if isinstance(trial, str | Path) else ""
        raise InputError(f"force: found {type(trial).__name__}, allowed time_s and force_n, or a recorded trial{file}")
    trial = trial.read() if hasattr(trial, "read") else trial
    force = trial.corrected_force()
    times, forces, sampled = force.time_s, force.force_n, trial.time_s
    if sampled[-1] > times[-1]:  # the force of the last samples comes after the end of the record
        times, forces = np.append(times, sampled[-1]), np.append(forces, forces[-1])
    times, forces = check_force_table(times, forces, f"trial {getattr(trial, 'number', '')}".strip())
    return times, forces, float(force.preload_n), sampled[sampled >= times[0]]


def require_force_input(choice: SceneChoice) -> None:
    """Refuse a scene that a recorded trial cannot drive."""
    if choice.input_column != "force_n":
        raise InputError(f"a trial has a force, this scene is driven by {choice.input_column}; give a table")


def resolve_string_modes(
    action: Action, choice: SceneChoice, options: ForceDrivenOptions
) -> tuple[Scene, Scene | None]:
    """Scene with the string modes that the tolerance needs, and one with half as many to estimate their error; None
    where the action sets their number, no string sounds or no estimate is requested."""
    if STRING_EFFECT not in choice.effects or action["string.modes"] != 0.0:
        return build_scene(action, choice), None
    scene = build_scene(with_modes(action, options.tolerance), choice)
    fewer = build_scene(with_modes(action, options.tolerance, 0.5), choice) if options.estimate_error else None
    return scene, fewer


@dataclass(frozen=True)
class ForceDrivenRun:
    """What decides the motion of a scene under a force table, but for the state it starts from."""

    scene: Scene  # what takes part, with all numbers
    # time_s, force_n: (k,) checked force table
    time_s: Array
    force_n: Array
    output_time_s: Array  # (m,)
    # tolerance, method: as for `simulate`
    tolerance: float
    method: str
    outputs: tuple[str, ...] = ()  # beyond angles and speeds, as in a `SceneChoice`
    estimate_error: bool = False  # also integrate with a tenth of the tolerance and compare
    # the scene with half the modes, where the tolerance chose them: what its companions take, so that the estimate
    # holds what the modes left out are worth, three times
    fewer_modes: Scene | None = None

    def simulate_from(self, state: State) -> Solution:
        """Integrate the run from ``state`` and return its solution, with the outputs and the error estimate that were
        requested."""
        energy = "energy" in self.outputs
        under_way = self._run(state, energy=energy)
        stored = under_way.stored_energy() if energy else 0.0
        angles, speeds = under_way.advance(self._end(), self.time_s, self.force_n, output_time_s=self.output_time_s)
        solution = self.solution(under_way, angles, speeds)
        if energy:
            solution = replace(solution, energy=under_way.energy_audit(state, stored))
        if "inside" in self.outputs:
            solution = replace(solution, inside=self._inside_view(state))
        if self.estimate_error:
            solution = replace(
                solution, error_rad=self.confirm_error(state, angles, self.companion_difference(state, angles))
            )
        return solution

    def _end(self) -> float:
        return float(self.output_time_s[-1]) if len(self.output_time_s) else float(self.time_s[-1])

    def plan_run(self, state: State, *, companion: bool = False) -> tuple[Simulation, Plan]:
        under_way = self.companion(state) if companion else self._run(state)
        return under_way, under_way.plan(self._end(), self.time_s, self.force_n, output_time_s=self.output_time_s)

    def _run(self, state: State, *, energy: bool = False) -> Simulation:
        return Simulation(self.scene, state.copy(), self.tolerance, self.method, energy=energy)

    def companion(self, state: State, share: float = COMPANION) -> Simulation:
        """Run for the error estimate, at ``share`` times this run's bounds on local errors."""
        tolerance = max(share * self.tolerance, SMALLEST_TOLERANCE)
        scene = self.scene if self.fewer_modes is None or len(state.memory) else self.fewer_modes
        return Simulation(scene, state.copy(), tolerance, self.method, creep=share)

    def companion_difference(self, first: State, angles: Array, share: float = COMPANION) -> float:
        """Largest difference (rad) of ``angles`` from the same motion, from state ``first``, integrated with a
        ``share`` of the tolerance.

        The tighter run contains what no local estimate knows: how much the errors of early steps grow.
        """
        other, _ = self.companion(first, share).advance(
            self._end(), self.time_s, self.force_n, output_time_s=self.output_time_s
        )
        return self.largest_difference(angles, other)

    def confirm_error(self, first: State, angles: Array, error: float) -> float:
        """``error``, rad, estimated by one companion run; where it is above the tolerance but below a clear miss, a
        second one is run from ``first`` and the larger is returned.

        Where small errors grow, a companion may happen to go wrong the same way.
        """
        if not self.tolerance < error <= MISSED * self.tolerance:
            return error
        return max(error, self.companion_difference(first, angles, SECOND_COMPANION))

    def largest_difference(self, angles: Array, others: Array) -> float:
        """Largest difference of an angle (rad) between two motions, columns that are no angles left out."""
        turning = [i for i, body in enumerate(self.scene.bodies) if column(body).endswith("_rad")]
        return float(np.max(np.abs(angles - others)[:, turning], initial=0.0))

    def solution(self, under_way: Simulation, angles: Array, speeds: Array) -> Solution:
        """Solution of ``under_way``, a run that has been integrated, with ``angles`` and ``speeds`` (m, n) at the
        output times, and contact forces if requested; no energy, inside view or error estimate."""
        contacts: tuple[str, ...] = ()
        normal, tangential = None, None
        if "contact_forces" in self.outputs:
            contacts, normal, tangential = _contact_forces(under_way, angles, speeds)
        return Solution(
            bodies=self.scene.bodies,
            time_s=self.output_time_s,
            angle_rad=angles,
            speed_rad_per_s=speeds,
            contacts=Contacts(contacts),
            contact_normal_n=normal,
            contact_friction_n=tangential,
            counters=under_way.work() | count_modes(self.scene),
            tolerance=self.tolerance,
            string=string_motion(self.scene, self.output_time_s, under_way.remembered),
            give=compliant_joint_motion(self.scene, under_way.remembered),
        )

    def _inside_view(self, first: State) -> Inside:
        """Inside view of the motion from ``first``, which is integrated again for the times that the view needs."""

        def states(at: Array) -> tuple[Array, ...]:
            again = self._run(first)
            until = float(at[-1]) if len(at) else first.time_s
            found = again.advance(until, self.time_s, self.force_n, output_time_s=at)
            return (*found, again.remembered) if self.scene.remembers else found

        return observe(self.scene, states, self.output_time_s, first.time_s, self.time_s, self.force_n)


def _contact_forces(run: Simulation, angles: Array, speeds: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Names (c,), normal and friction forces (m, c) of all contacts, the tip of motor arm or finger as one of them."""
    normal, tangential = run.contact_forces(angles, speeds)
    if not len(run.scene.tables.probe):
        return run.scene.contacts, normal, tangential
    tip = run.probe_forces(angles, speeds)
    return (
        (*run.scene.contacts, run.scene.presser),
        np.hstack([normal, tip]),
        np.hstack([tangential, np.zeros_like(tip)]),
    )
