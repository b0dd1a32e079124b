"""Contact forces and penetrations along a motion where joints give: poses moved by what the joints give.

``give`` and ``rate`` (m, g) belong to the rows of ``Tables.pin``.
"""

import numpy as np

from model.kernels.compile import kernel
from model.kernels.laws import felt, friction
from model.kernels.layout import (
    BODY_SIZE,
    DAMP,
    GLOBALS,
    GUIDED,
    K_A,
    K_B,
    K_C,
    MU_A,
    MU_B1,
    MU_B2,
    PIVOT_X,
    PIVOT_Y,
    POSE_C,
    POSE_CX,
    POSE_CY,
    POSE_OMEGA,
    POSE_S,
    POSE_SIZE,
    POSE_X,
    POSE_Y,
    V_T,
)
from model.kernels.trajectory.dynamics import contact_frame
from model.kernels.trajectory.kinematics import place


@kernel
def placed(q, v, give, rate, p, tables, pose, moving):
    """Fill ``pose`` and ``moving`` (n, 2), the velocity of each pivot, m/s."""
    n = q.shape[0]
    place(q, v, p, tables.parent, pose)
    for turn in range(2 * n):  # what hangs from the ground, or a guide, first
        i = turn % n
        w = tables.parent[i]
        carried = w >= 0 and tables.parent[w] != GUIDED
        if carried != (turn >= n):
            continue
        x = 0.0
        y = 0.0
        moving[i, 0] = 0.0
        moving[i, 1] = v[i] if w == GUIDED else 0.0
        if w >= 0 and not carried:
            moving[i, 1] = v[w]
        if carried:
            o = GLOBALS + BODY_SIZE * i
            ax = pose[w, POSE_C] * p[o + PIVOT_X] - pose[w, POSE_S] * p[o + PIVOT_Y]
            ay = pose[w, POSE_S] * p[o + PIVOT_X] + pose[w, POSE_C] * p[o + PIVOT_Y]
            moving[i, 0] = moving[w, 0] - pose[w, POSE_OMEGA] * ay
            moving[i, 1] = moving[w, 1] + pose[w, POSE_OMEGA] * ax
            x = pose[w, POSE_X] + ax - pose[i, POSE_X]  # what the carrier has been moved by
            y = pose[w, POSE_Y] + ay - pose[i, POSE_Y]
        for g in range(tables.pin.shape[0]):
            if tables.pin[g, 0] == i:
                moving[i, tables.pin[g, 1]] += rate[g]
                if tables.pin[g, 1] == 0:
                    x += give[g]
                else:
                    y += give[g]
        pose[i, POSE_X] += x
        pose[i, POSE_CX] += x
        pose[i, POSE_Y] += y
        pose[i, POSE_CY] += y


@kernel
def giving_contacts_along(q, v, give, rate, p, tables, force, depth):
    """Fill ``force`` (m, c, 2), normal and friction, N, and ``depth`` (m, c, 2), m and m/s, from states (m, n)."""
    n = q.shape[1]
    pose = np.zeros((n, POSE_SIZE))
    moving = np.zeros((n, 2))
    for row in range(q.shape[0]):
        placed(q[row], v[row], give[row], rate[row], p, tables, pose, moving)
        for c in range(tables.contact.shape[0]):
            o, x, nx, ny, px, py = contact_frame(c, p, tables, pose)
            ux = 0.0
            uy = 0.0
            for end in range(2):
                i = tables.contact[c, end]
                if i < 0:
                    continue
                sign = 1.0 if end == 0 else -1.0
                turn = pose[i, POSE_OMEGA]
                ux += sign * (moving[i, 0] - turn * (py - pose[i, POSE_Y]))
                uy += sign * (moving[i, 1] + turn * (px - pose[i, POSE_X]))
            closing = -(ux * nx + uy * ny)
            slide = uy * nx - ux * ny
            fn, _, _ = felt(x, closing, p[o + K_A], p[o + K_B], p[o + K_C], p[o + DAMP])
            ft = 0.0
            if fn > 0.0 and p[o + MU_A] != 0.0:
                mu, _ = friction(slide, 1.0 / p[V_T], p[o + MU_A], p[o + MU_B1], p[o + MU_B2])
                ft = -mu * fn
            force[row, c, 0] = fn
            force[row, c, 1] = ft
            depth[row, c, 0] = x
            depth[row, c, 1] = closing
