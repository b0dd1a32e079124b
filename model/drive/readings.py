"""Current, voltages, torque, powers and stored energy of a motor's drive during a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.time_table import two_columns
from model.kernels import layout as L
from model.parameters.action import Action, ActionLike, as_action
from model.parameters.effects import ARM, MOTOR, WINDING
from model.scene.build import Scene, build_scene
from model.scene.pressing import amplifier_voltage, steady_current
from model.scene.selection import SceneChoice, load_scene
from model.simulation.solution import Solution

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DriveReadings:
    """Of a motor's drive, (m,) each, at the output times of a run.

    Attributes
    ----------
    time_s : s
    current_a : current in the winding, A
    amplifier_v : voltage at the winding, V
    back_emf_v : voltage that the turning motor induces, V
    torque_nm : torque of the current, N m
    force_n : force of the arm's tip on the key, N; NaN where contact forces were not asked for
    power_in_w : from the amplifier, W
    heat_w : lost in the winding's resistance, W
    stored_j : in the winding's inductance, J
    """

    time_s: Array
    current_a: Array
    amplifier_v: Array
    back_emf_v: Array
    torque_nm: Array
    force_n: Array
    power_in_w: Array
    heat_w: Array
    stored_j: Array

    def columns(self) -> dict[str, Array]:
        """Voltages, torque and powers by name, for an output file; without time, current and force."""
        names = ("amplifier_v", "back_emf_v", "torque_nm", "power_in_w", "heat_w", "stored_j")
        return {f"drive_{name}": getattr(self, name) for name in names}


def drive_readings(
    action: ActionLike,
    solution: Solution,
    time_s: ArrayLike,
    command_v: ArrayLike,
    scene: SceneChoice | str = "motor-drive",
) -> DriveReadings:
    """Current (A), voltages (V), torque (N m), tip force (N; NaN without contact forces), powers (W) and stored energy
    (J) of the motor's drive at the output times of ``solution``, a run driven by ``command_v`` (V) at ``time_s``.

    Parameters
    ----------
    action : parameter set of the run
    solution : the run, of a scene with the effect ``motor_drive``
    time_s, command_v : (k,) the command that drove it, V, linear between its points
    scene : the scene of the run

    Returns
    -------
    DriveReadings

    Raises
    ------
    InputError : the run had no drive

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> time_s, force_n = model.force_table("forte")
    >>> run = model.simulate(action, time_s, force_n / 12.0, scene="motor-drive")
    >>> seen = model.drive.drive_readings(action, run, time_s, force_n / 12.0)
    >>> print(f"{seen.current_a.max():.1f} A, back-EMF up to {seen.back_emf_v.max():.1f} V")
    4.1 A, back-EMF up to 5.7 V
    """
    action = as_action(action)
    if WINDING not in solution.bodies:
        raise InputError("drive: found a run without the effect motor_drive, allowed a scene with it")
    built = driven_scene(action, scene)
    numbers = built.vector[built.tables.offset[2] :][: L.WINDING_SIZE]
    current = solution.speed_rad_per_s[:, solution.bodies.index(WINDING)]
    emf = numbers[L.WINDING_K] * solution.speed_rad_per_s[:, solution.bodies.index(MOTOR)]
    assert built.command is not None
    table = built.command.table(*two_columns(time_s, command_v, "command"), False)
    volts = amplifier_voltage(numbers, np.interp(solution.time_s, *table), current)
    force = np.full(len(current), np.nan)
    if solution.contact_normal_n is not None:
        force = solution.contact_normal_n[:, solution.contacts.index(ARM)]
    return DriveReadings(
        time_s=solution.time_s,
        current_a=current,
        amplifier_v=volts,
        back_emf_v=emf,
        torque_nm=numbers[L.WINDING_K] * current,
        force_n=force,
        power_in_w=volts * current,
        heat_w=numbers[L.WINDING_R] * current**2,
        stored_j=0.5 * built.vector[L.GLOBALS + L.BODY_SIZE * built.wound[0] + L.INERTIA] * current**2,
    )


def driven_scene(action: Action, scene: SceneChoice | str) -> Scene:
    """A scene of an action in which a drive turns the motor; ``InputError`` where none does."""
    choice = load_scene(scene)
    built = build_scene(choice.apply_to(action), choice)
    if not built.wound:
        raise InputError("drive: found a scene without the effect motor_drive, allowed a scene with it")
    return built


def static_torque_nm(action: ActionLike, scene: SceneChoice | str, command_v: float) -> float:
    """Torque, N m, that a motor which stands still makes under a constant command, V, within the limits of its
    amplifier; `InputError` for a scene without a motor drive.

    Parameters
    ----------
    action : parameter set
    scene : with the effect ``motor_drive``
    command_v : V

    Returns
    -------
    float

    Raises
    ------
    InputError : the scene has no drive

    Examples
    --------
    >>> import model
    >>> f"{model.drive.static_torque_nm(model.load_action(), 'motor-drive', 2.0):.2f} N m"
    '2.40 N m'
    """
    action = as_action(action)
    built = driven_scene(action, scene)
    assert built.command is not None
    numbers = built.vector[built.tables.offset[2] :][: L.WINDING_SIZE]
    return float(numbers[L.WINDING_K]) * steady_current(numbers, built.command.value(command_v))
