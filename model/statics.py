"""Static rest state of a scene: the angles at which all forces balance and nothing moves.

At zero speed friction vanishes and felt is a conservative spring, so rest is a minimum of energy. Found by
a damped Newton iteration with the analytic stiffness, which follows the energy down where a contact is still open,
then polished until the residual stops falling. Fails with ``StaticsError`` that says how far it got.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, StaticsError
from .kernels import dynamics
from .kernels import layout as L
from .kernels import workspace as W
from .kernels.kinematics import place
from .kernels.scenes import kernels_of
from .parameters import Action
from .scene import Scene, build_scene

LARGEST_TURN = 0.05  # rad per iteration


@dataclass(frozen=True)
class RestState:
    """Static balance: angles (n,) rad, contact forces (c,) N, penetrations (c,) m, residual N m."""

    bodies: tuple[str, ...]
    angle_rad: NDArray[np.float64]
    contacts: tuple[str, ...]
    contact_normal_n: NDArray[np.float64]
    penetration_m: NDArray[np.float64]
    residual_nm: float


def _balance(scene: Scene, q: NDArray[np.float64], u: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Generalised force (n,) and its derivative (n, n) at rest; exact where the force is zero."""
    n = scene.size
    w = np.zeros(W.SIZE)
    w[W.Q : W.Q + n] = q
    kernels_of(scene.tables).linearise(w, scene.vector, u)
    mass = np.diag(w[W.M_DIAG : W.M_DIAG + n])
    for i, parent in enumerate(scene.tables.parent):
        if parent >= 0:
            mass[i, parent] = mass[parent, i] = w[W.M_UP + i]
    stiff = w[W.STIFF : W.STIFF + W.WIDTH**2].reshape(W.WIDTH, W.WIDTH)[:n, :n]
    return mass @ w[W.ACC : W.ACC + n], stiff


def solve_rest(scene: Scene, u: float = 0.0, start: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Angles (n,) at which the scene rests under the constant input ``u``.

    Raises
    ------
    StaticsError : no stable balance within 2000 iterations.
    """
    if not np.isfinite(u):
        raise InputError(f"rest state: input found {u}, allowed a finite number")
    q = np.array(scene.start if start is None else start, dtype=float)
    for _ in range(10):
        q, stiff = _descend(scene, q, u)
        weakness, modes = np.linalg.eigh(-0.5 * (stiff + stiff.T))
        if weakness[0] > 0.0:
            return q
        # a saddle: leave it along its weakest direction, to the side where the forces carry on
        off = 0.01 * modes[:, 0]
        force, _ = _balance(scene, q + off, u)
        q = q + off if float(force @ off) > 0.0 else q - off
    raise StaticsError("rest state: the balance found is not stable; check springs and geometry")


def _descend(
    scene: Scene, q: NDArray[np.float64], u: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Follow the forces from ``q`` to a balance; angles (n,) and stiffness (n, n) there."""
    f, stiff = _balance(scene, q, u)
    shift = 1e-2
    for _ in range(2000):
        size = float(np.max(np.abs(f)))
        if size < 1e-9:
            break
        step = np.linalg.solve(shift * np.eye(scene.size) - stiff, f)
        turn = float(np.max(np.abs(step)))
        if turn > LARGEST_TURN:
            step *= LARGEST_TURN / turn
        f_new, stiff_new = _balance(scene, q + step, u)
        # energy falls along the step while the force still points with it
        if float(f_new @ step) > -0.5 * abs(float(f @ step)) and float(f @ step) > 0.0:
            q, f, stiff = q + step, f_new, stiff_new
            shift = max(shift * 0.3, 1e-12)
        else:
            shift = min(shift * 5.0, 1e4)
    else:
        raise StaticsError(
            f"rest state: not found in 2000 iterations, largest residual {size:.2g} N m; check the geometry"
        )
    for _ in range(20):
        step = np.linalg.solve(-stiff, f)
        f_new, stiff_new = _balance(scene, q + step, u)
        if not np.max(np.abs(f_new)) < np.max(np.abs(f)):
            break
        q, f, stiff = q + step, f_new, stiff_new
    return q, stiff


def rest_state(action: Action, force_n: float = 0.0, scene: Scene | None = None) -> RestState:
    """Static balance of an action under a constant force on the key.

    Parameters
    ----------
    action : parameter set
    force_n : N, positive downwards on the key (with a motor arm in ``scene``: the motor's torque, N m)
    """
    scene = build_scene(action) if scene is None else scene
    q = solve_rest(scene, force_n)
    forces, _ = _balance(scene, q, force_n)
    zero, pose = np.zeros(scene.size), np.zeros((scene.size, L.POSE_SIZE))
    place(q, zero, scene.vector, scene.tables.parent, pose)
    states = [dynamics.contact_state(c, zero, scene.vector, scene.tables, pose) for c in range(len(scene.contacts))]
    return RestState(
        bodies=scene.bodies,
        angle_rad=q,
        contacts=scene.contacts,
        contact_normal_n=np.array([s[0] for s in states]),
        penetration_m=np.array([s[2] for s in states]),
        residual_nm=float(np.max(np.abs(forces))),
    )
