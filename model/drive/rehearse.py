"""A log as a bench with a known drive would write it: to see, before the experiment, what a log would determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.drive.log import DriveLog
from model.drive.readings import driven_scene, static_torque_nm
from model.errors import InputError
from model.files.force_library import force_table
from model.parameters.action import Action
from model.parameters.effects import MOTOR, WINDING
from model.scene.selection import SceneChoice, load_scene
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]
RATE_HZ = 5000.0
TOLERANCE = 1e-7
BLOW_S, PUSHES_S = 0.7, 0.46  # a forte, then pushes of 5 to 24 ms on the key that lies at the bottom


@dataclass(frozen=True)
class SensorErrors:
    """What the sensors of a simulated log add: noise of force and current, width of a count, error of scales."""

    force_n: float = 0.02
    current_a: float = 0.02
    count_rad: float = 2.0 * np.pi / 327680
    scale: float = 5e-3


def identification_command(action: Action, scene: SceneChoice | str, seed: int = 1, push_n: float = 22.0) -> Array:
    """A command, V, that shows what a drive does: a forte, then pushes of random height and length.

    Parameters
    ----------
    action : parameter set, with the guess of the drive that scales the command
    scene : with the effect ``motor_drive``
    seed : of the pushes
    push_n : highest push at the tip, N

    Returns
    -------
    ndarray
        Command (n,), V, at 5 kHz.

    Raises
    ------
    InputError : the scene has no drive

    Examples
    --------
    >>> import model
    >>> command_v = model.drive.identification_command(model.load_action(), "motor-drive")
    >>> len(command_v)
    6000
    """
    choice = load_scene(scene)
    volts_per_n = choice.on(action)["motor_arm.length"] / static_torque_nm(action, choice, 1.0)
    random = np.random.default_rng(seed)
    out = np.zeros(6000)
    blow = int(BLOW_S * RATE_HZ)
    out[:blow] = 0.8 * volts_per_n * np.interp(np.arange(blow) / RATE_HZ, *force_table("forte"))
    at, end = blow + 100, blow + 100 + int(PUSHES_S * RATE_HZ)
    while at < end:
        length = int(random.integers(25, 120))
        out[at : at + length] = random.uniform(0.2, 1.0) * push_n * volts_per_n
        at += length
    return out


def simulated_log(
    action: Action,
    scene: SceneChoice | str,
    command_v: ArrayLike,
    *,
    errors: SensorErrors | None = None,
    seed: int = 0,
    current: bool = True,
) -> DriveLog:
    """What a bench with this drive would log at 5 kHz.

    Parameters
    ----------
    action : parameter set, with the numbers of drive and arm
    scene : with the effect ``motor_drive``
    command_v : (n,) command, V, held from sample to sample
    errors : of the sensors; by default those of the virtual bench
    seed : of the errors
    current : whether the current is recorded

    Returns
    -------
    DriveLog

    Raises
    ------
    InputError : the scene has no drive, or a command that cannot be followed

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> command_v = model.drive.identification_command(action, "motor-voltage")
    >>> log = model.drive.simulated_log(action, "motor-voltage", command_v)
    >>> found = model.drive.identify_drive(log, model.drive.DriveOptions(mode="voltage"))
    >>> print(f"{found['resistance'].value:.2f} ohm, {1e3 * found['inductance'].value:.2f} mH")
    1.00 ohm, 3.01 mH
    """
    built, wrong = driven_scene(action, scene), errors or SensorErrors()
    volts = as_numbers(command_v, "command", 1)
    if len(volts) < 2 or not np.isfinite(volts).all():
        raise InputError(f"command: found {len(volts)} values, allowed 2 or more finite ones, V")
    times = np.arange(len(volts)) / RATE_HZ
    run = Simulation(built, State(0.0, solve_rest(built), np.zeros(built.size)), TOLERANCE)
    angle, speed = run.advance(float(times[-1]), times, volts, held=True, output_time_s=times)
    random = np.random.default_rng(seed)
    force_scale, current_scale = 1.0 + wrong.scale * np.clip(random.standard_normal(2), -2.5, 2.5)
    noise = random.standard_normal((2, len(volts)))
    amperes = current_scale * speed[:, built.bodies.index(WINDING)] + wrong.current_a * noise[1]
    turned = angle[:, built.bodies.index(MOTOR)]
    return DriveLog(
        time_s=times,
        command_v=volts,
        force_n=force_scale * run.probe_forces(angle, speed)[:, 0] + wrong.force_n * noise[0],
        arm_rad=wrong.count_rad * np.round(turned / wrong.count_rad) if wrong.count_rad > 0.0 else turned,
        current_a=amperes if current else None,
    )
