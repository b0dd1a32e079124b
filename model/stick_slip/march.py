"""A blow with set-valued friction, marched at a fixed step.

Force table in, angles and speeds at its times out, as from `model.simulate`; here bodies stick exactly. First order in
the step where friction acts; the same felt, inertia and drive. A fixed step of a few microseconds makes it slow: it
shows the limit v_t -> 0 and does not replace `model.simulate`. Refuses tables as `model.simulate` does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.calibration.parts import peak_ratio
from model.derived.columns import NORMAL
from model.derived.load import kernel_of
from model.derived.observe import contacts_at
from model.elements.strings import AWAKE
from model.errors import InputError, IntegrationError
from model.files.force_table import check_force_table
from model.integrators.stick_slip import SWEEPS, Forcing, FrictionLimits, Places, Rows, step_along
from model.kernels import layout as L
from model.parameters.action import Action
from model.parameters.effects import MOTOR_DRIVE
from model.scene.build import Scene, build_scene
from model.scene.selection import choice_of
from model.simulation.giving_motion import giving_motion
from model.simulation.run import State, with_memory
from model.simulation.solution import Solution
from model.simulation.statics import solve_rest
from model.simulation.string_motion import string_motion

LARGEST_STEP_S = 5e-5

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Marched:
    """A marched blow.

    Attributes
    ----------
    solution : what `model.simulate` would give, with the normal forces; friction forces are impulses here, so none
    contact_sticks : (m, c) whether a contact sticks; open and frictionless ones do not
    joint_sticks : (m, n) whether a joint sticks
    step_s : step that was used
    """

    solution: Solution
    contact_sticks: NDArray[np.bool_]
    joint_sticks: NDArray[np.bool_]
    step_s: float


def simulate(action: Action, time_s: ArrayLike, force_n: ArrayLike, step_s: float = 5e-6) -> Marched:
    """Predict a blow with set-valued friction.

    Parameters
    ----------
    action : parameter set; the threshold speeds play no part
    time_s, force_n : (k,) evenly spaced force table, linear between its points
    step_s : longest step; the nearest whole part of the table's spacing below it is used

    Returns
    -------
    Marched
        The motion, and which contacts and joints stick.

    Raises
    ------
    InputError : a table that cannot be used, or a step out of range
    IntegrationError : the motion left all bounds, or an impulse did not converge; a shorter step helps

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.force_table("forte")
    >>> begins = time_s < 0.1
    >>> marched = model.stick_slip.simulate(model.load_action(), time_s[begins], force_n[begins], step_s=2e-5)
    >>> bool(marched.joint_sticks[1].all())  # at rest
    True
    """
    times, forces = check_force_table(time_s, force_n)
    if MOTOR_DRIVE in choice_of(action).effects:
        raise InputError(
            "friction without a threshold speed: found the effect motor_drive, allowed motor_arm, whose input is a "
            "torque"
        )
    spacing = float(np.mean(np.diff(times)))
    if np.ptp(np.diff(times)) > 1e-6 * spacing:
        raise InputError("force table: times are not evenly spaced; resample it first")
    if not 0.0 < step_s <= LARGEST_STEP_S:
        raise InputError(f"step: found {step_s:g} s, allowed above 0 to {LARGEST_STEP_S:g} s")
    every = max(1, int(np.ceil(spacing / step_s - 1e-9)))
    h = spacing / every
    scene = build_scene(action)
    n, c, m = scene.size, len(scene.contacts), len(times)
    began = with_memory(scene, State(float(times[0]), solve_rest(scene), np.zeros(n)))
    places = _places(scene)
    first = np.concatenate([began.angle_rad, began.speed_rad_per_s, began.memory])
    if places.modes.size:
        first[places.ways - L.STRING_STATES] = AWAKE  # its modes are marched from the start
    states, held = np.zeros((m - 1, len(first))), np.zeros((m - 1, c + n), dtype=np.int64)
    middles = times[0] + h * (np.arange(every * (m - 1)) + 0.5)
    u = np.interp(middles, *((times, forces) if scene.command is None else scene.command.table(times, forces, False)))
    smooth = _without_friction(scene)
    limits = FrictionLimits(scene.vector, smooth, _static_ratio(scene), int(scene.tables.offset[1]))
    marched = kernel_of(scene.tables, "marched")
    sweeps = step_along(first.copy(), Forcing(u, h, every), limits, marched, places, Rows(states, held))
    if not np.all(np.isfinite(states)) or sweeps >= SWEEPS:
        raise IntegrationError(f"stick-slip march: no motion found with steps of {h:g} s; take a shorter step")
    states = np.vstack([first, states])
    angles, speeds, memory = states[:, :n], states[:, n : 2 * n], states[:, 2 * n :]
    normal = contacts_at(scene.tables, smooth, angles, speeds, memory)[:, :, NORMAL]
    sticks = np.vstack([np.zeros((1, c + n), dtype=bool), held.astype(bool)])
    return Marched(
        solution=Solution(
            bodies=scene.bodies,
            time_s=times,
            angle_rad=angles,
            speed_rad_per_s=speeds,
            contacts=scene.contacts,
            contact_normal_n=normal,
            counters={"n_steps": len(u), "most_sweeps": int(sweeps)},
            string=string_motion(scene, times, memory),
            give=giving_motion(scene, memory),
        ),
        contact_sticks=sticks[:, :c],
        joint_sticks=sticks[:, c:],
        step_s=h,
    )


def _without_friction(scene: Scene) -> Array:
    """The scene's parameters with every friction coefficient and torque at zero."""
    p, start = scene.vector.copy(), int(scene.tables.offset[1])
    p[L.GLOBALS + L.JF_A :: L.BODY_SIZE][: scene.size] = 0.0
    p[start + L.MU_A :: L.CONTACT_SIZE][: len(scene.contacts)] = 0.0
    return p


def _static_ratio(scene: Scene) -> Array:
    """Static over kinetic value (c + n,) of contacts and joints: the peak of eq. 2.10, which stays at any width."""
    start = int(scene.tables.offset[1])
    places = [start + L.CONTACT_SIZE * c + L.MU_B1 for c in range(len(scene.contacts))]
    places += [L.GLOBALS + L.BODY_SIZE * i + L.JF_B1 for i in range(scene.size)]
    return np.array([peak_ratio(*scene.vector[k : k + 2].tolist()) for k in places])


def _places(scene: Scene) -> Places:
    """Where a state row, angles, speeds, then what is remembered, has what the march moves."""
    n, give, felt = scene.size, len(scene.pins), len(scene.tables.memory)
    first, ways = 2 * n + felt, 2 * n + felt + 2 * give + L.STRING_STATES
    strung, at = len(scene.tables.string) > 0, int(scene.tables.offset[7])
    count = int(scene.vector[at]) if strung else 0
    return Places(
        np.array([*range(n), *range(first, first + give)]),
        np.array([*range(n, 2 * n), *range(first + give, first + 2 * give)]),
        n,
        2 * n,
        felt,
        scene.vector[at + L.STRING_HEAD :][: 3 * count].reshape(3, count) if strung else np.zeros((3, 0)),
        ways if strung else 2 * n,
        int(scene.tables.string[0]) if strung else 0,
    )
