"""Static rest state of a scene: the angles at which all forces balance and nothing moves.

At zero speed friction vanishes and felt is a conservative spring, so rest is a minimum of energy. Found by
Newton's iteration along the principal axes of the analytic stiffness, which follows the energy down where a contact is
still open or a balance is unstable, then polished until the residual stops falling. It counts as rest where a push in
any direction is answered by at least `SOFTEST`: whether a set rests must not hang on the sign of what rounding leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.codegen.evaluate_observables import contacts_at
from model.codegen.load import load_kernels
from model.codegen.observable_columns import DEPTH, NORMAL
from model.errors import InputError, StaticsError
from model.kernels import workspace as W
from model.parameters.action import ActionLike, as_action
from model.scene.build import Scene, build_scene
from model.scene.pressing import steady_current

LARGEST_TURN = 0.05  # rad per iteration
KICK = 1e-3  # rad, off a saddle
PUSH = 1e-5  # rad: felts that only touch open under it, by far more than rounding (some 1e-13 m)
SOFTEST = 1e-4  # N m/rad that hold a rest: rounding leaves 1e-10, its own weight gives a hanging hammer 1e-2
NO_REST = "rest state: no balance found that a small push cannot leave; check gravity, masses, springs and geometry"
LARGEST_INPUT = 1e4  # N or N m
MOST_ITERATIONS, MOST_ESCAPES = 2000, 10  # then the rest is refused


@dataclass(frozen=True)
class RestState(ArrayRecord):
    """Static balance: angles (n,) rad, contact forces (c,) N, penetrations (c,) m, residual N m."""

    bodies: tuple[str, ...]
    angle_rad: NDArray[np.float64]
    contacts: tuple[str, ...]
    contact_normal_n: NDArray[np.float64]
    penetration_m: NDArray[np.float64]
    residual_nm: float


def balance(
    scene: Scene, q: NDArray[np.float64], u: float, v: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Generalised force (n,), N m, its derivative by the angles and the mass matrix, (n, n) each, at angles ``q`` (n,)
    under the input ``u``, at rest or at speeds ``v``; with joints that give (n + g,).

    Where joints give, what they give follows the angles; by default it is what holds these angles.
    """
    n, give = scene.size, len(scene.pins)
    if give and len(q) == n:
        q = with_pins(scene, q, u)
    w = np.zeros(W.WITH_MEMORY if give else W.SIZE)
    w[W.Q : W.Q + n], w[W.Z : W.Z + give] = q[:n], q[n:]
    if v is not None:
        w[W.V : W.V + n] = v[:n]
    if scene.command is not None:
        u = scene.command.value(u)
        if v is None and scene.wound:
            w[W.V + scene.wound[0]] = steady_current(scene.vector[scene.tables.offset[2] :], u)
    w[W.STATIC] = 1.0
    load_kernels(scene.static_tables).linearise(w, scene.vector, u)
    if give:
        own = np.array([*range(n), *(len(scene.bodies) + k for k in range(give))])  # what is prescribed stands between
        square = [w[at : at + W.WIDE**2].reshape(W.WIDE, W.WIDE) for at in (W.P_MASS, W.P_STIFF)]
        lower, stiff = (rows[np.ix_(own, own)] for rows in square)
        mass = np.tril(lower) + np.tril(lower, -1).T
        return mass @ w[W.P_ACC + own], stiff, mass
    mass = np.diag(w[W.M_DIAG : W.M_DIAG + n])
    for i, parent in enumerate(scene.tables.parent[:n]):
        if parent >= 0:
            mass[i, parent] = mass[parent, i] = w[W.M_UP + i]
    stiff = w[W.STIFF : W.STIFF + W.WIDTH**2].reshape(W.WIDTH, W.WIDTH)[:n, :n]
    return mass @ w[W.ACC : W.ACC + n], stiff, mass


def with_pins(scene: Scene, q: NDArray[np.float64], u: float) -> NDArray[np.float64]:
    """Angles (n,), followed by what the joints give (g,) while bodies are held at these angles."""
    n = scene.size
    return solve_rest(scene, u, np.append(q, np.zeros(len(scene.pins))), tuple(range(n)), with_joints=True)


def _free_part(
    scene: Scene, q: NDArray[np.float64], u: float, free: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Generalised force and stiffness at rest of the coordinates that may move."""
    f, stiff, _ = balance(scene, q, u)
    return f[free], stiff[free[:, None], free]


def _displace(q: NDArray[np.float64], free: NDArray[np.int64], step: NDArray[Any]) -> NDArray[np.float64]:
    out = q.copy()
    out[free] += step
    return out


def solve_rest(
    scene: Scene,
    u: float = 0.0,
    start: NDArray[np.float64] | None = None,
    held: tuple[int, ...] = (),
    *,
    with_joints: bool = False,
) -> NDArray[np.float64]:
    """Angles (n,) of a stable balance under the constant input ``u``, from ``start`` (None: the scene's), ``held``
    coordinates kept there; ``with_joints``: then the joints' deflections, (n + g,); else `StaticsError`."""
    if not abs(u) <= LARGEST_INPUT:
        raise InputError(f"rest state: input found {u:g}, allowed a finite number up to {LARGEST_INPUT:g}")
    q = np.array(scene.start if start is None else start, dtype=float)
    if q.shape == (scene.size,):
        q = np.append(q, np.zeros(len(scene.pins)))
    if q.shape != (scene.size + len(scene.pins),) or not np.all(np.isfinite(q)):
        raise InputError(f"rest state: start found {q}, allowed {scene.size} finite angles")
    free = np.array([i for i in range(len(q)) if i not in (*held, *scene.wound)], dtype=np.int64)
    for _ in range(MOST_ESCAPES):
        q, f, stiff = _minimise_energy(scene, q, u, free)
        for _ in range(20):
            step = np.linalg.lstsq(-stiff, f, rcond=None)[0]
            f_new, stiff_new = _free_part(scene, _displace(q, free, step), u, free)
            if not np.max(np.abs(f_new)) < np.max(np.abs(f)):
                break
            q, f, stiff = _displace(q, free, step), f_new, stiff_new
        loose = _loose_direction(scene, q, u, free, stiff)
        if loose is None:
            return q if with_joints else q[: scene.size]
        q = _displace(q, free, KICK * loose)  # off the saddle; the next descent leaves it for good
    raise StaticsError(NO_REST)


def _loose_direction(
    scene: Scene, q: NDArray[np.float64], u: float, free: NDArray[np.int64], stiff: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Unit vector (f,) of free coordinates along which the equilibrium at ``q`` is unstable, None where it is stable in
    all; ``stiff`` (f, f): derivative of the force.

    The stiffness says it of small turns. A felt that presses by what rounding left counts in it and holds nothing: so
    each coordinate is pushed both ways as well.
    """
    value, axes = np.linalg.eigh(-0.5 * (stiff + stiff.T))
    if value[0] <= SOFTEST:
        size = np.abs(axes[:, 0])
        return np.asarray(axes[:, 0] * np.sign(axes[np.argmax(size > 0.5 * size.max()), 0]))  # LAPACK's sign is any
    for way in (*np.eye(len(free)), *-np.eye(len(free))):
        f, _ = _free_part(scene, _displace(q, free, PUSH * way), u, free)
        if -float(f @ way) <= SOFTEST * PUSH:
            return way
    return None


def _minimise_energy(
    scene: Scene, q: NDArray[np.float64], u: float, free: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Follow the energy down from ``q`` to where the force on the coordinates ``free`` vanishes: that place, the force
    left (f,) and its derivative (f, f); `StaticsError` where that is not reached.

    The step is Newton's along each principal axis of the stiffness, downhill where that is negative, and limited
    on each axis by itself: a loose body may swing far without holding back one that is pressed hard.
    """
    f, stiff = _free_part(scene, q, u, free)
    radius = LARGEST_TURN
    for _ in range(MOST_ITERATIONS):
        size = float(np.max(np.abs(f)))
        if not np.isfinite(size) or not np.all(np.isfinite(stiff)):
            raise StaticsError("rest state: forces are not finite; check masses, springs and geometry")
        if size < max(1e-9, 1e-15 * float(np.max(np.abs(stiff)))):  # below that lies rounding
            return q, f, stiff
        value, axis = np.linalg.eigh(-0.5 * (stiff + stiff.T))
        step = axis @ np.clip(axis.T @ f / np.maximum(np.abs(value), 1e-12), -radius, radius)
        f_new, stiff_new = _free_part(scene, _displace(q, free, step), u, free)
        # energy falls along the step while the force still points with it
        if float(f_new @ step) > -0.5 * float(f @ step):
            q, f, stiff = _displace(q, free, step), f_new, stiff_new
            radius = min(radius * 2.0, LARGEST_TURN)
        else:
            radius = max(0.25 * min(radius, float(np.max(np.abs(step)))), 1e-15)
    raise StaticsError(NO_REST)


def rest_state(
    action: ActionLike, force_n: float = 0.0, scene: Scene | None = None, near: RestState | None = None
) -> RestState:
    """Static balance of an action under a constant force on the key, N, down: angles and contact forces; the search
    begins at ``near``, whose result is kept if the same contacts touch; `StaticsError` without balance.

    Parameters
    ----------
    action : parameter set
    force_n : N, positive downwards on the key (with a motor arm, its drive or a finger in
        ``scene``: torque, N m; command, V; way of the hand, m)
    scene : what takes part; by default what the action says, with its effects
    near : rest of a similar action with the same bodies, where the search begins; what is found is kept if the same
        contacts touch. Else the search begins as a hand sets up the action, as it does by default

    Returns
    -------
    RestState
        Angles (n,), rad, and what is left of the forces.

    Raises
    ------
    StaticsError : no balance was found that holds

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> at_rest = model.rest_state(action).angle_rad
    >>> print(f"{1e3 * float(model.observables.hammer_height_m(action, at_rest)):.1f} mm")
    48.0 mm
    """
    action = as_action(action)
    scene = build_scene(action) if scene is None else scene
    if near is not None and near.bodies == scene.bodies and near.contacts == scene.contacts:
        found = _describe_rest(scene, force_n, solve_rest(scene, force_n, near.angle_rad, with_joints=True))
        if np.array_equal(found.penetration_m > 0.0, near.penetration_m > 0.0):
            return found
    return _describe_rest(scene, force_n, solve_rest(scene, force_n, with_joints=True))


def _describe_rest(scene: Scene, force_n: float, found: NDArray[np.float64]) -> RestState:
    """Rest state from the balanced coordinates ``found`` (n + g,) under ``force_n`` on the key."""
    q, give = found[: scene.size], found[scene.size :]
    scene.check_whole(q, "rest state")
    forces, _, _ = balance(scene, found, force_n)
    still = np.zeros(scene.size)
    rows = np.concatenate([give, np.zeros(len(give))])[None]
    pressed = contacts_at(scene.static_tables, scene.vector, q[None], still[None], rows)[0]
    return RestState(
        bodies=scene.bodies,
        angle_rad=q,
        contacts=scene.contacts,
        contact_normal_n=pressed[:, NORMAL],
        penetration_m=pressed[:, DEPTH],
        residual_nm=float(np.max(np.abs(forces))),
    )
