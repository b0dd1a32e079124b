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
from model.derived.load import observer_of
from model.derived.observe import contacts_at
from model.errors import InputError, IntegrationError
from model.files.force_table import check_force_table
from model.integrators.stick_slip import SWEEPS, Forcing, FrictionLimits, Rows, step_along
from model.kernels import layout as L
from model.parameters.action import Action
from model.scene.build import Scene, build_scene
from model.simulation.solution import Solution
from model.simulation.statics import solve_rest

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
    spacing = float(np.mean(np.diff(times)))
    if np.ptp(np.diff(times)) > 1e-6 * spacing:
        raise InputError("force table: times are not evenly spaced; resample it first")
    if not 0.0 < step_s <= LARGEST_STEP_S:
        raise InputError(f"step: found {step_s:g} s, allowed above 0 to {LARGEST_STEP_S:g} s")
    every = max(1, int(np.ceil(spacing / step_s - 1e-9)))
    h = spacing / every
    scene = build_scene(action)
    scene.refuse_memory("friction without a threshold speed")
    q, v = solve_rest(scene), np.zeros(scene.size)
    n, c, m = scene.size, len(scene.contacts), len(times)
    angle, speed, held = np.zeros((m - 1, n)), np.zeros((m - 1, n)), np.zeros((m - 1, c + n), dtype=np.int64)
    first = q.copy()
    middles = times[0] + h * (np.arange(every * (m - 1)) + 0.5)
    u = np.interp(middles, times, forces)
    smooth = _without_friction(scene)
    limits = FrictionLimits(scene.vector, smooth, _static_ratio(action, scene), int(scene.tables.offset[1]))
    marched = observer_of(scene.tables, "marched")
    sweeps = step_along(q, v, Forcing(u, h, every), limits, marched, Rows(angle, speed, held))
    if not np.all(np.isfinite(angle)) or sweeps >= SWEEPS:
        raise IntegrationError(f"stick-slip march: no motion found with steps of {h:g} s; take a shorter step")
    angles, speeds = np.vstack([first, angle]), np.vstack([np.zeros(n), speed])
    normal = contacts_at(scene.tables, smooth, angles, speeds)[:, :, NORMAL]
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
        ),
        contact_sticks=sticks[:, :c],
        joint_sticks=sticks[:, c:],
        step_s=h,
    )


def _without_friction(scene: Scene) -> Array:
    """The scene's parameters with every friction coefficient and torque at zero."""
    p = scene.vector.copy()
    for i in range(scene.size):
        p[L.GLOBALS + L.BODY_SIZE * i + L.JF_A] = 0.0
    start = int(scene.tables.offset[1])
    for k in range(len(scene.contacts)):
        p[start + L.CONTACT_SIZE * k + L.MU_A] = 0.0
    return p


def _static_ratio(action: Action, scene: Scene) -> Array:
    """Static over kinetic coefficient (c,): the peak of eq. 2.10, which stays when its width goes to zero."""
    return np.array([peak_ratio(action[f"{c}.friction.B1"], action[f"{c}.friction.B2"]) for c in scene.contacts])
