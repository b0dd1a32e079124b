"""Simulate an action under a measured or invented force table: the main function of ``model``.

Force table in (time s, force N, positive downwards on the key, linear between points), trajectory out.
Bad tables are refused with the row and what is allowed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import check_rows, two_columns
from model.inside.observe_motion import observe
from model.integrators.methods import DEFAULT_METHOD
from model.parameters.action import Action
from model.scene.build import Scene, build_scene
from model.scene.selection import SceneChoice, load_scene
from model.simulation.loads_and_losses import Inside
from model.simulation.run import Simulation, State
from model.simulation.solution import EnergyAudit, Solution
from model.simulation.statics import RestState, solve_rest

LARGEST_FORCE_N = 1000.0


def check_force_table(
    time_s: ArrayLike, force_n: ArrayLike, where: str = "force table", column: str = "force_n"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and forces (k,) as float arrays; raise ``InputError`` at the first row that cannot be used."""
    times, forces = two_columns(time_s, force_n, where)
    if len(times) < 2:
        raise InputError(f"{where}: found {len(times)} rows, allowed at least 2")
    check_rows(times, forces, where, column, LARGEST_FORCE_N)
    return times, forces


def read_force_table(path: str | Path, column: str = "force_n") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a CSV file with the columns ``time_s,force_n``; (k,) each. A motor's ``column`` is ``torque_nm``."""
    table = read_columns(path, ("time_s", column), ())
    return check_force_table(table.numbers("time_s"), table.numbers(column), table.where, column)


def output_times(start: float, end: float, rate_hz: float) -> NDArray[np.float64]:
    """Times from ``start`` to ``end`` at ``rate_hz``; k / rate exactly, so that no rounding adds up."""
    if not np.isfinite(rate_hz) or not 0 < rate_hz <= 1e7:
        raise InputError(f"output rate: found {rate_hz:g} Hz, allowed above 0 to 1e7")
    count = int(np.floor((end - start) * rate_hz + 1e-9)) + 1
    return np.minimum(start + np.arange(count) / rate_hz, end)


def check_output_times(output_time_s: ArrayLike | None, table_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return output times (m,), by default those of the force table; ``InputError`` where they leave it or fall."""
    outputs = table_s if output_time_s is None else np.asarray(output_time_s, dtype=float)
    if outputs.ndim != 1 or not np.all(np.isfinite(outputs)) or np.any(np.diff(outputs) < 0):
        raise InputError("output times: allowed a finite, increasing row of times")
    if len(outputs) and (outputs[0] < table_s[0] or outputs[-1] > table_s[-1]):
        raise InputError(
            f"output times: found {outputs[0]:g} to {outputs[-1]:g} s, allowed within the table, "
            f"{table_s[0]:g} to {table_s[-1]:g} s"
        )
    return outputs


def simulate(
    action: Action,
    time_s: ArrayLike,
    force_n: ArrayLike,
    *,
    tolerance: float = 1e-5,
    output_time_s: ArrayLike | None = None,
    contact_forces: bool = False,
    initial: RestState | State | None = None,
    energy: bool = False,
    inside: bool = False,
    scene: SceneChoice | str | Path = "whole",
    method: str = DEFAULT_METHOD,
) -> Solution:
    """Predict the motion of all five bodies under a force on the key.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) force table, linear between its points; with the effect ``motor_arm`` the motor's torque, N m
    tolerance : requested largest error of any angle, rad
    output_time_s : (m,) increasing, within the table; by default the table's own times
    contact_forces : also compute normal and friction force of each contact
    initial : where to start; by default at rest without force
    energy : also say where the work of the force went (`Solution.energy`)
    inside : also look inside: contacts, joints, bodies (`Solution.inside`)
    scene : what takes part and what to give out, by name or file (`model.scene.selection`)
    method : integration method, see `model.integrators.methods`

    Raises
    ------
    InputError : table, times or tolerance cannot be used
    IntegrationError : the integration could not go on

    Notes
    -----
    SI units, radians. Equations: thesis Chapter 2.
    """
    times, forces = check_force_table(time_s, force_n)
    outputs = check_output_times(output_time_s, times)
    choice = load_scene(scene)
    action = choice.on(action)
    contact_forces = contact_forces or "contact_forces" in choice.outputs
    energy = energy or "energy" in choice.outputs
    inside = inside or "inside" in choice.outputs
    built = build_scene(action, choice)
    if isinstance(initial, State):
        state = initial.copy()
    else:
        angle = solve_rest(built) if initial is None else initial.angle_rad
        state = State(float(times[0]), np.array(angle, dtype=float), np.zeros(built.size))
    return follow(
        built, state, times, forces, outputs, tolerance, method, contact_forces=contact_forces, energy=energy,
        inside=inside,
    )  # fmt: skip


def follow(
    built: Scene,
    state: State,
    times: NDArray[np.float64],
    forces: NDArray[np.float64],
    outputs: NDArray[np.float64],
    tolerance: float,
    method: str,
    *,
    contact_forces: bool = False,
    energy: bool = False,
    inside: bool = False,
) -> Solution:
    """Motion of a scene from ``state``, which it changes, under a checked force table; see `simulate`."""
    first = state.copy()
    run = Simulation(built, state, tolerance=tolerance, method=method, energy=energy)
    stored = run.stored_energy() if energy else 0.0
    end = float(outputs[-1]) if len(outputs) else float(times[-1])
    angles, speeds = run.advance(end, times, forces, output_time_s=outputs)
    normal, tangential = run.contact_forces(angles, speeds) if contact_forces else (None, None)
    contacts = built.contacts if contact_forces else ()
    if normal is not None and tangential is not None and len(built.tables.probe):
        pressed = run.probe_forces(angles, speeds)
        contacts, normal = (*contacts, "motor_arm"), np.hstack([normal, pressed])
        tangential = np.hstack([tangential, np.zeros_like(pressed)])
    return Solution(
        bodies=built.bodies,
        time_s=outputs,
        angle_rad=angles,
        speed_rad_per_s=speeds,
        contacts=contacts,
        contact_normal_n=normal,
        contact_friction_n=tangential,
        counters=run.work(),
        tolerance=tolerance,
        energy=EnergyAudit(float(run.audit[0]), run.stored_energy() - stored, *map(float, run.audit[1:]))
        if energy
        else None,
        inside=_look_inside(built, first, tolerance, method, times, forces, outputs) if inside else None,
    )


def _look_inside(
    scene: Scene,
    first: State,
    tolerance: float,
    method: str,
    times: NDArray[np.float64],
    forces: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> Inside:
    """Inside view of the run that starts at ``first``; the motion is made again for the times it asks for."""

    def states(at: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        again = Simulation(scene, first.copy(), tolerance=tolerance, method=method)
        return again.advance(float(at[-1]) if len(at) else first.time_s, times, forces, output_time_s=at)

    return observe(scene, states, outputs, first.time_s, times, forces)
