"""Accelerations of a scene: M(q) a = f(q, v, u), with M and f assembled by loops over the scene's tables.

Generalised coordinates are joint angles. A force F at X on body A and -F on body B gives, on each
coordinate b that moves A against B, side_b * (X - P_b) x F; the same vectors turn speeds into the rates of
penetration and of sliding. Contacts act at mid-penetration on the common normal; inertia is about the
centre of mass (docs/decisions/0008-model-open-points.md). Equations: thesis Sections 2.1, 2.2.
"""

from typing import NamedTuple

import numpy as np

from model.kernels.compile import inlined, inlined_uncounted, kernel, uncounted
from model.kernels.laws import amplifier, felt, friction
from model.kernels.layout import (
    A_R,
    AMPLIFIER,
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
    INERTIA,
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
    SPRING_Q0,
    SPRING_SIZE,
    SPRING_T0,
    V_T,
    WINDING_K,
    WINDING_R,
)
from model.kernels.trajectory.kinematics import along_chain, contact_offset, gap_geometry, place, point


class Equations(NamedTuple):
    """Poses and terms of M a = f at one state: what `acceleration` fills; (n,) each but ``pose`` (n, POSE_SIZE)."""

    pose: np.ndarray
    m_diag: np.ndarray  # diagonal of M
    m_up: np.ndarray  # its coupling of child and parent
    force: np.ndarray  # f
    acceleration: np.ndarray  # a


@inlined
def mass_matrix(pose, p, parent, m_diag, m_up):
    """Diagonal (n,) and child-parent coupling (n,) of M; nothing else is filled in a two-level tree."""
    n = parent.shape[0]
    for i in range(n):
        o = GLOBALS + BODY_SIZE * i
        m = p[o + MASS]
        rx = pose[i, POSE_CX] - pose[i, POSE_X]
        ry = pose[i, POSE_CY] - pose[i, POSE_Y]
        own = p[o + INERTIA] + m * (rx * rx + ry * ry)
        m_diag[i] = m if parent[i] == GUIDED else own
        m_up[i] = 0.0
    for i in range(n):
        o = GLOBALS + BODY_SIZE * i
        m = p[o + MASS]
        rx = pose[i, POSE_CX] - pose[i, POSE_X]
        ry = pose[i, POSE_CY] - pose[i, POSE_Y]
        own = p[o + INERTIA] + m * (rx * rx + ry * ry)
        w = parent[i]
        if w >= 0 and parent[w] == GUIDED:
            m_up[i] = m * rx
            m_diag[w] += m
        elif w >= 0:
            dx = pose[i, POSE_X] - pose[w, POSE_X]
            dy = pose[i, POSE_Y] - pose[w, POSE_Y]
            h = m * (dx * rx + dy * ry)
            m_up[i] = own + h
            m_diag[w] += own + m * (dx * dx + dy * dy) + 2.0 * h


@inlined
def solve_mass(m_diag, m_up, parent, f, a):
    """Solve M a = f by eliminating children into their parents; (n,) each."""
    n = parent.shape[0]
    for i in range(n):
        a[i] = f[i]
    # children first: they touch nothing but their parent
    for i in range(n - 1, -1, -1):
        w = parent[i]
        if w >= 0:
            a[w] -= m_up[i] / m_diag[i] * a[i]
    for i in range(n):
        w = parent[i]
        if w < 0:
            pivot = m_diag[i]
            for k in range(n):
                if parent[k] == i:
                    pivot -= m_up[k] * m_up[k] / m_diag[k]
            a[i] /= pivot
    for i in range(n):
        w = parent[i]
        if w >= 0:
            a[i] = (a[i] - m_up[i] * a[w]) / m_diag[i]


@inlined
def inertia_and_joint_forces(q, v, u, p, tables, pose, f):
    """Gravity, centrifugal terms, joint friction, springs and drives, added up in ``f`` (n,)."""
    parent = tables.parent
    n = q.shape[0]
    g = p[GRAVITY]
    for i in range(n):
        o = GLOBALS + BODY_SIZE * i
        threshold = p[V_T] if parent[i] == GUIDED else p[OMEGA_T]
        torque, _ = friction(v[i], 1.0 / threshold, p[o + JF_A], p[o + JF_B1], p[o + JF_B2])
        f[i] = -torque
    for i in range(n):
        m = p[GLOBALS + BODY_SIZE * i + MASS]
        rx = pose[i, POSE_CX] - pose[i, POSE_X]
        ry = pose[i, POSE_CY] - pose[i, POSE_Y]
        w = parent[i]
        f[i] -= m * g if w == GUIDED else m * g * rx
        if w >= 0 and parent[w] == GUIDED:
            f[w] -= m * (g - ry * v[i] * v[i])
        elif w >= 0:
            dx = pose[i, POSE_X] - pose[w, POSE_X]
            dy = pose[i, POSE_Y] - pose[w, POSE_Y]
            f[w] -= m * g * (dx + rx)
            dh = m * (dy * rx - dx * ry)  # derivative of m d.r by the child's own angle
            ww = pose[w, POSE_OMEGA]
            f[w] -= dh * (2.0 * ww + v[i]) * v[i]
            f[i] += dh * ww * ww
    o = tables.offset[0]
    for k in range(tables.spring.shape[0]):
        i = tables.spring[k]
        f[i] += p[o + SPRING_T0] - p[o + SPRING_K] * (q[i] - p[o + SPRING_Q0])
        o += SPRING_SIZE
    o = tables.offset[2]
    for k in range(tables.drive.shape[0]):
        i = tables.drive[k, 1]
        if tables.drive[k, 0] == FORCE_DOWN:
            x, _ = point(pose, i, p[o + DRIVE_X], p[o + DRIVE_Y])
            f[i] -= u * (x - pose[i, POSE_X])
            if parent[i] >= 0 and parent[parent[i]] == GUIDED:
                f[parent[i]] -= u
        elif tables.drive[k, 0] == AMPLIFIER:
            volts, _, _ = amplifier(u, v[i], p[o + 2], p[o + 3], p[o + 4], p[o + 5], p[o + 6])
            f[i] += volts - p[o + WINDING_R] * v[i] - p[o + WINDING_K] * v[i - 1]
            f[i - 1] += p[o + WINDING_K] * v[i]
        else:
            f[i] += u
        o += DRIVE_SIZE
    o = tables.offset[5]
    for k in range(tables.damper.shape[0]):
        i = tables.damper[k]
        f[i] -= p[o] * v[i]
        o += DAMPER_SIZE


@inlined
def probe_state(v, p, o, a, b, pose, parent):
    """One-sided vertical contact of a tip on A pressing down on a point of B.

    Returns penetration (m), its rate (m/s), and the lever arms (m) of the vertical force on A and on B.
    """
    ax, ay = point(pose, a, p[o], p[o + 1])
    bx, by = point(pose, b, p[o + 2], p[o + 3])
    la = ax - pose[a, POSE_X]
    lb = bx - pose[b, POSE_X]
    rate = lb * v[b] - la * v[a]
    if parent[b] >= 0 and parent[parent[b]] == GUIDED:
        rate += v[parent[b]]
    return by - ay, rate, la, lb


@inlined_uncounted
def contact_frame(c, p, tables, pose):
    """Where the numbers of contact ``c`` begin, its penetration (m), unit normal, and point of action (m)."""
    o = contact_offset(tables.offset[1], c)
    x, nx, ny, ax, ay, _, _, _ = gap_geometry(
        pose, p, o, tables.contact[c, 0], tables.contact[c, 1], tables.contact[c, 2]
    )
    r = p[o + A_R] - 0.5 * x
    return o, x, nx, ny, ax - r * nx, ay - r * ny


@uncounted
def contact_state(c, v, p, tables, pose):
    """Normal force, friction force, penetration, its rate and sliding speed of contact ``c`` (N, N, m, m/s, m/s).

    Friction is the force on body A along t = z x n, positive with positive t; it opposes the sliding.
    """
    o, x, nx, ny, px, py = contact_frame(c, p, tables, pose)
    rate = 0.0
    slide = 0.0
    for k in range(tables.contact[c, 3]):
        b = tables.chain[c, k]
        gn, gt = along_chain(pose, tables.parent, b, tables.side[c, k], px, py, nx, ny)
        rate -= gn * v[b]
        slide += gt * v[b]
    fn, _, _ = felt(x, rate, p[o + K_A], p[o + K_B], p[o + K_C], p[o + DAMP])
    ft = 0.0
    if fn > 0.0 and p[o + MU_A] != 0.0:
        mu, _ = friction(slide, 1.0 / p[V_T], p[o + MU_A], p[o + MU_B1], p[o + MU_B2])
        ft = -mu * fn
    return fn, ft, x, rate, slide


@inlined
def contact_forces(v, p, tables, pose, f):
    """Add the forces of all touching contacts and probes to ``f`` (n,); return how many contacts touch."""
    touching = 0
    for c in range(tables.contact.shape[0]):
        o, x, nx, ny, px, py = contact_frame(c, p, tables, pose)
        if x <= 0.0:
            continue
        touching += 1
        count = tables.contact[c, 3]
        rate = 0.0
        slide = 0.0
        for k in range(count):
            b = tables.chain[c, k]
            gn, gt = along_chain(pose, tables.parent, b, tables.side[c, k], px, py, nx, ny)
            rate -= gn * v[b]
            slide += gt * v[b]
        fn, _, _ = felt(x, rate, p[o + K_A], p[o + K_B], p[o + K_C], p[o + DAMP])
        if fn == 0.0:
            continue
        ft = 0.0
        if p[o + MU_A] != 0.0:
            mu, _ = friction(slide, 1.0 / p[V_T], p[o + MU_A], p[o + MU_B1], p[o + MU_B2])
            ft = -mu * fn
        for k in range(count):
            b = tables.chain[c, k]
            gn, gt = along_chain(pose, tables.parent, b, tables.side[c, k], px, py, nx, ny)
            f[b] += fn * gn + ft * gt
    o = tables.offset[3]
    for k in range(tables.probe.shape[0]):
        a = tables.probe[k, 0]
        b = tables.probe[k, 1]
        x, rate, la, lb = probe_state(v, p, o, a, b, pose, tables.parent)
        fn, _, _ = felt(x, rate, p[o + 4], p[o + 5], p[o + 6], p[o + 7])
        f[a] += fn * la
        f[b] -= fn * lb
        if tables.parent[b] >= 0 and tables.parent[tables.parent[b]] == GUIDED:
            f[tables.parent[b]] -= fn
        o += PROBE_SIZE
    return touching


@kernel
def acceleration(q, v, u, p, tables, equations):
    """Fill ``equations`` at (q, v) under input u; return how many contacts touch."""
    pose, m_diag, m_up, f, a = equations
    place(q, v, p, tables.parent, pose)
    mass_matrix(pose, p, tables.parent, m_diag, m_up)
    inertia_and_joint_forces(q, v, u, p, tables, pose, f)
    touching = contact_forces(v, p, tables, pose, f)
    solve_mass(m_diag, m_up, tables.parent, f, a)
    return touching
