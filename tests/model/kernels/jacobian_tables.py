"""Analytic derivatives by loops over a scene's tables: K = df/dq - (dM/dq) a and D = df/dv, (n, n) each.

Those of the generated kernels are compared with them. A touching contact adds rank-one terms along its normal and its
sliding direction and, through the rotation of both with each coordinate, the change of the directions themselves.
Every derivative rests on one rule: turning coordinate b moves a point X that hangs from it by z x (X - P_b).
Nothing of it is compiled, which would take longer than all the states that tests look at.
"""

from functools import cache, cached_property
from types import FunctionType

import numpy as np

import model
from model.kernels import laws
from model.kernels import layout as L
from model.kernels.layout import (
    A_R,
    BODY_SIZE,
    DAMP,
    DAMPER_SIZE,
    DRIVE_SIZE,
    DRIVE_X,
    DRIVE_Y,
    FORCE_DOWN,
    GLOBALS,
    GRAVITY,
    GUIDED,
    JF_A,
    JF_B1,
    JF_B2,
    K_A,
    K_B,
    K_C,
    MASS,
    MU_A,
    MU_B1,
    MU_B2,
    OMEGA_T,
    POSE_CX,
    POSE_CY,
    POSE_OMEGA,
    POSE_X,
    POSE_Y,
    PROBE_SIZE,
    SPRING_K,
    SPRING_SIZE,
    V_T,
)
from model.kernels.trajectory import dynamics, kinematics
from model.kernels.trajectory.dynamics import Equations


@cache
def plain(kernel):
    """The Python function of a kernel, which calls those of the kernels it calls."""
    function = kernel.py_func
    used = {name: function.__globals__[name] for name in function.__code__.co_names if name in function.__globals__}
    names = {name: plain(value) if hasattr(value, "py_func") else value for name, value in used.items()}
    return FunctionType(function.__code__, names)


felt, friction, probe_state = (plain(f) for f in (laws.felt, laws.friction, dynamics.probe_state))
along_chain, contact_offset, gap_geometry, point = (
    plain(getattr(kinematics, name)) for name in ("along_chain", "contact_offset", "gap_geometry", "point")
)


def inertia_and_joints(v, u, a, p, tables, pose, stiff, damp, f_u):
    """Set ``stiff``, ``damp`` and ``f_u`` = df/du from everything but contacts."""
    parent = tables.parent
    n = v.shape[0]
    g = p[GRAVITY]
    for i in range(n):
        f_u[i] = 0.0
        for j in range(n):
            stiff[i, j] = 0.0
            damp[i, j] = 0.0
    for i in range(n):
        o = GLOBALS + BODY_SIZE * i
        threshold = p[V_T] if parent[i] == GUIDED else p[OMEGA_T]
        _, slope = friction(v[i], 1.0 / threshold, p[o + JF_A], p[o + JF_B1], p[o + JF_B2])
        damp[i, i] -= slope
        m = p[o + MASS]
        rx = pose[i, POSE_CX] - pose[i, POSE_X]
        ry = pose[i, POSE_CY] - pose[i, POSE_Y]
        own = m * g * ry
        w = parent[i]
        if w == GUIDED:
            continue
        stiff[i, i] += own
        if w >= 0 and parent[w] == GUIDED:
            stiff[w, i] += m * rx * v[i] * v[i] + m * ry * a[i]
            stiff[i, i] += m * ry * a[w]
            damp[w, i] += 2.0 * m * ry * v[i]
        elif w >= 0:
            dx = pose[i, POSE_X] - pose[w, POSE_X]
            dy = pose[i, POSE_Y] - pose[w, POSE_Y]
            stiff[w, w] += m * g * (dy + ry)
            stiff[i, w] += own
            stiff[w, i] += own
            h = m * (dx * rx + dy * ry)
            dh = m * (dy * rx - dx * ry)
            ww = pose[w, POSE_OMEGA]
            # centrifugal terms; d(dh)/dq_i = -h, and h does not change with q_w
            stiff[w, i] += h * (2.0 * ww + v[i]) * v[i]
            stiff[i, i] -= h * ww * ww
            damp[w, w] -= 2.0 * dh * v[i]
            damp[w, i] -= 2.0 * dh * (ww + v[i])
            damp[i, w] += 2.0 * dh * ww
            # (dM/dq_i) a
            stiff[w, i] -= 2.0 * dh * a[w] + dh * a[i]
            stiff[i, i] -= dh * a[w]
    o = tables.offset[0]
    for k in range(tables.spring.shape[0]):
        i = tables.spring[k]
        stiff[i, i] -= p[o + SPRING_K]
        o += SPRING_SIZE
    o = tables.offset[2]
    for k in range(tables.drive.shape[0]):
        i = tables.drive[k, 1]
        if tables.drive[k, 0] == FORCE_DOWN:
            x, y = point(pose, i, p[o + DRIVE_X], p[o + DRIVE_Y])
            f_u[i] -= x - pose[i, POSE_X]
            stiff[i, i] += u * (y - pose[i, POSE_Y])
            if parent[i] >= 0 and parent[parent[i]] == GUIDED:
                f_u[parent[i]] -= 1.0
        else:
            f_u[i] += 1.0
        o += DRIVE_SIZE
    o = tables.offset[5]
    for k in range(tables.damper.shape[0]):
        damp[tables.damper[k], tables.damper[k]] -= p[o]
        o += DAMPER_SIZE


def contacts(v, p, tables, pose, work, stiff, damp):
    """Add the derivatives of all touching contacts; ``work`` is (4, MAX_CHAIN) scratch."""
    start = tables.offset[1]
    for c in range(tables.contact.shape[0]):
        o = contact_offset(start, c)
        shape = tables.contact[c, 2]
        x, nx, ny, ax, ay, bx, by, distance = gap_geometry(
            pose, p, o, tables.contact[c, 0], tables.contact[c, 1], shape
        )
        if x <= 0.0:
            continue
        r = p[o + A_R] - 0.5 * x
        px = ax - r * nx
        py = ay - r * ny
        count = tables.contact[c, 3]
        gn = work[0]  # generalised direction of the normal force
        gt = work[1]  # and of the tangential force, t = z x n
        rate = 0.0
        slide = 0.0
        for k in range(count):
            b = tables.chain[c, k]
            gn[k], gt[k] = along_chain(pose, tables.parent, b, tables.side[c, k], px, py, nx, ny)
            rate -= gn[k] * v[b]
            slide += gt[k] * v[b]
        fn, fn_x, fn_rate = felt(x, rate, p[o + K_A], p[o + K_B], p[o + K_C], p[o + DAMP])
        if fn == 0.0:
            continue
        mu = 0.0
        mu_s = 0.0
        if p[o + MU_A] != 0.0:
            mu, mu_s = friction(slide, 1.0 / p[V_T], p[o + MU_A], p[o + MU_B1], p[o + MU_B2])
        for j in range(count):
            cj = tables.chain[c, j]
            qx = pose[cj, POSE_X]
            qy = pose[cj, POSE_Y]
            s = tables.side[c, j]
            x_j = -gn[j]
            # velocity of the circle's centre and turning rate kappa of the normal (n_j = kappa t)
            lifts = tables.parent[cj] == GUIDED
            if s > 0 and lifts:
                vx = 0.0
                vy = 1.0
                kappa = 0.0 if distance == 0.0 else nx / distance
            elif lifts:
                vx = 0.0
                vy = 0.0
                kappa = 0.0 if distance == 0.0 else -nx / distance
            elif s > 0:
                vx = -(ay - qy)
                vy = ax - qx
                kappa = 0.0 if distance == 0.0 else (nx * vy - ny * vx) / distance
            else:
                vx = 0.0
                vy = 0.0
                kappa = 1.0 if distance == 0.0 else -(nx * (bx - qx) + ny * (by - qy)) / distance
            xx = vx + 0.5 * x_j * nx + r * kappa * ny
            xy = vy + 0.5 * x_j * ny - r * kappa * nx
            dn = work[2]
            dt = work[3]
            rate_j = 0.0
            slide_j = 0.0
            for k in range(count):
                b = tables.chain[c, k]
                mx = xx
                my = xy
                if tables.ancestor[b, cj] == 1 and lifts:
                    my -= 1.0
                elif tables.ancestor[b, cj] == 1:
                    mx += pose[b, POSE_Y] - qy
                    my -= pose[b, POSE_X] - qx
                lx = px - pose[b, POSE_X]
                ly = py - pose[b, POSE_Y]
                sk = tables.side[c, k]
                if tables.parent[b] == GUIDED:
                    dn[k] = sk * kappa * nx
                    dt[k] = -sk * kappa * ny
                else:
                    dn[k] = sk * (mx * ny - my * nx + kappa * (lx * nx + ly * ny))
                    dt[k] = sk * (mx * nx + my * ny - kappa * (lx * ny - ly * nx))
                rate_j -= dn[k] * v[b]
                slide_j += dt[k] * v[b]
            fn_j = fn_x * x_j + fn_rate * rate_j
            fn_vj = -fn_rate * gn[j]
            mu_j = mu_s * slide_j
            mu_vj = mu_s * gt[j]
            for k in range(count):
                b = tables.chain[c, k]
                along = gn[k] - mu * gt[k]
                stiff[b, cj] += fn_j * along + fn * (dn[k] - mu * dt[k] - mu_j * gt[k])
                damp[b, cj] += fn_vj * along - fn * mu_vj * gt[k]
    o = tables.offset[3]
    for k in range(tables.probe.shape[0]):
        a = tables.probe[k, 0]
        b = tables.probe[k, 1]
        x, rate, la, lb = probe_state(v, p, o, a, b, pose, tables.parent)
        fn, fn_x, fn_rate = felt(x, rate, p[o + 4], p[o + 5], p[o + 6], p[o + 7])
        if fn > 0.0:
            _, ay = point(pose, a, p[o], p[o + 1])
            _, by = point(pose, b, p[o + 2], p[o + 3])
            ha = ay - pose[a, POSE_Y]  # a lever arm changes by minus its height
            hb = by - pose[b, POSE_Y]
            fn_qa = -fn_x * la + fn_rate * ha * v[a]
            fn_qb = fn_x * lb - fn_rate * hb * v[b]
            stiff[a, a] += fn_qa * la - fn * ha
            stiff[a, b] += fn_qb * la
            stiff[b, a] -= fn_qa * lb
            stiff[b, b] += -fn_qb * lb + fn * hb
            damp[a, a] -= fn_rate * la * la
            damp[a, b] += fn_rate * lb * la
            damp[b, a] += fn_rate * la * lb
            damp[b, b] -= fn_rate * lb * lb
            w = tables.parent[b]
            if w >= 0 and tables.parent[w] == GUIDED:  # b rises with the guide it hangs from
                stiff[a, w] += fn_x * la
                stiff[b, w] -= fn_x * lb
                stiff[w, a] -= fn_qa
                stiff[w, b] -= fn_qb
                stiff[w, w] -= fn_x
                damp[a, w] += fn_rate * la
                damp[b, w] -= fn_rate * lb
                damp[w, a] += fn_rate * la
                damp[w, b] -= fn_rate * lb
                damp[w, w] -= fn_rate
        o += PROBE_SIZE


class Evaluation:
    """Terms of the equations of motion and their derivatives at (q, v, u), by loops over the scene's tables."""

    def __init__(self, scene: model.Scene, q: np.ndarray, v: np.ndarray, u: float) -> None:
        n, p, tables = scene.size, scene.vector, scene.tables
        self.scene, self.v, self.u = scene, v, u
        self.pose = np.zeros((n, L.POSE_SIZE))
        self.f, self.a, self.m_diag, m_up = (np.zeros(n) for _ in range(4))
        self.touching = dynamics.acceleration(
            q, v, u, p, tables, Equations(self.pose, self.m_diag, m_up, self.f, self.a)
        )
        self.mass = np.diag(self.m_diag)
        for i, w in enumerate(tables.parent):
            if w >= 0:
                self.mass[i, w] = self.mass[w, i] = m_up[i]

    @cached_property
    def derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K, D and df/du."""
        n, p, tables = self.scene.size, self.scene.vector, self.scene.tables
        stiff, damp, f_u = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
        inertia_and_joints(self.v, self.u, self.a, p, tables, self.pose, stiff, damp, f_u)
        contacts(self.v, p, tables, self.pose, np.zeros((4, L.MAX_CHAIN)), stiff, damp)
        return stiff, damp, f_u

    @property
    def stiff(self) -> np.ndarray:
        return self.derivatives[0]

    @property
    def damp(self) -> np.ndarray:
        return self.derivatives[1]

    @property
    def f_u(self) -> np.ndarray:
        return self.derivatives[2]
