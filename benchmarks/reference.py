"""Reference trajectories: an explicit Runge-Kutta method of order 8, compiled, that shares nothing with the integrators.

Dormand and Prince's DOP853 with error control at 1e-13 of each angle and speed, restarted at every point of the force
table so that no kink lies inside a step. Explicit steps of about a microsecond: some seconds a blow. The right-hand
side is the scene's compiled one, which the tests hold to the NumPy twin.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate._ivp import dop853_coefficients as _dop

import model
from model.kernels import workspace as W
from model.kernels.scenes import kernels_of

TOLERANCE = 1e-13
_A, _B, _C, _E5 = _dop.A[:12, :12].copy(), _dop.B.copy(), _dop.C[:12].copy(), _dop.E5[:12].copy()


@numba.njit(nogil=True, error_model="numpy")
def _rhs(linearise, w, p, y, n, u, out):  # type: ignore[no-untyped-def]
    w[W.Q : W.Q + n] = y[:n]
    w[W.V : W.V + n] = y[n:]
    linearise(w, p, u)
    out[:n] = y[n:]
    out[n:] = w[W.ACC : W.ACC + n]


@numba.njit(nogil=True, error_model="numpy")
def _explicit(linearise, p, y, times, force, tolerance, rows, A, B, C, E5):  # type: ignore[no-untyped-def]
    n = y.shape[0] // 2
    w = np.zeros(W.SIZE)
    k = np.zeros((12, 2 * n))
    rows[0] = y
    h = 1e-7
    count = 0
    for j in range(times.shape[0] - 1):
        t, end = times[j], times[j + 1]
        slope = (force[j + 1] - force[j]) / (end - t)
        while t < end:
            step = min(h, end - t)
            for s in range(12):
                z = y.copy()
                for m in range(s):
                    z += step * A[s, m] * k[m]
                _rhs(linearise, w, p, z, n, force[j] + slope * (t + C[s] * step - times[j]), k[s])
            new = y.copy()
            error = np.zeros(2 * n)
            for s in range(12):
                new += step * B[s] * k[s]
                error += step * E5[s] * k[s]
            worst = np.max(np.abs(error)) / tolerance
            count += 1
            if count > 200_000_000 or not np.isfinite(worst):
                return -1
            if worst <= 1.0:
                y = new
                t = end if step == end - t else t + step
                grow = 0.9 * max(worst, 1e-12) ** (-0.125)
                h = max(h, step * min(2.0, grow)) if step < h else step * min(2.0, grow)
            else:
                h = step * max(0.2, 0.9 * worst ** (-0.125))
        rows[j + 1] = y
    return count


def explicit(
    action: model.Action, time_s: NDArray[np.float64], force_n: NDArray[np.float64], tolerance: float = TOLERANCE
) -> NDArray[np.float64]:
    """Angles and speeds (k, 10) at the points of the force table, started at rest."""
    scene = model.build_scene(action)
    y = np.concatenate([model.rest_state(action).angle_rad, np.zeros(scene.size)])
    rows = np.zeros((len(time_s), 2 * scene.size))
    kernel = kernels_of(scene.tables).linearise
    count = _explicit(kernel, scene.vector, y, time_s, force_n, tolerance, rows, _A, _B, _C, _E5)
    if count < 0:
        raise SystemExit("reference: the explicit method failed")
    return rows
