"""Where bodies and contact surfaces are: poses, gap, common normal and point of action.

Called by ``dynamics``. World frame: x right, y up, metres, angles counter-clockwise.
Source: thesis Section 2.2.1; open points decided in docs/decisions/0008-model-open-points.md.
"""

from math import cos, sin, sqrt

from model.kernels.compile import inlined_uncounted
from model.kernels.layout import (
    A_R,
    A_X,
    A_Y,
    B_R,
    B_X,
    B_Y,
    BODY_SIZE,
    CIRCLE,
    COM_X,
    COM_Y,
    CONTACT_SIZE,
    E_X,
    E_Y,
    GLOBALS,
    GUIDED,
    LINE,
    N_X,
    N_Y,
    PIVOT_X,
    PIVOT_Y,
    POSE_C,
    POSE_CX,
    POSE_CY,
    POSE_OMEGA,
    POSE_PHI,
    POSE_S,
    POSE_X,
    POSE_Y,
)


@inlined_uncounted
def place(q, v, p, parent, pose):
    """Fill ``pose`` (n, POSE_SIZE): pivot, orientation, centre of mass and angular speed of each body."""
    n = q.shape[0]
    for turn in range(2 * n):  # what hangs from the ground first
        i = turn % n
        w = parent[i]
        if (w >= 0) != (turn >= n):
            continue
        o = GLOBALS + BODY_SIZE * i
        px = p[o + PIVOT_X]
        py = p[o + PIVOT_Y]
        if w == GUIDED:
            phi = 0.0
            omega = 0.0
            x = px
            y = py + q[i]
        elif w < 0:
            phi = q[i]
            omega = v[i]
            x = px
            y = py
        else:
            phi = q[i] + pose[w, POSE_PHI]
            omega = v[i] + pose[w, POSE_OMEGA]
            c = pose[w, POSE_C]
            s = pose[w, POSE_S]
            x = pose[w, POSE_X] + c * px - s * py
            y = pose[w, POSE_Y] + s * px + c * py
        c = cos(phi)
        s = sin(phi)
        pose[i, POSE_X] = x
        pose[i, POSE_Y] = y
        pose[i, POSE_C] = c
        pose[i, POSE_S] = s
        pose[i, POSE_PHI] = phi
        pose[i, POSE_CX] = x + c * p[o + COM_X] - s * p[o + COM_Y]
        pose[i, POSE_CY] = y + s * p[o + COM_X] + c * p[o + COM_Y]
        pose[i, POSE_OMEGA] = omega


@inlined_uncounted
def point(pose, body, x, y):
    """World coordinates of the point (x, y) of a body's frame; body -1 is ground."""
    if body < 0:
        return x, y
    c = pose[body, POSE_C]
    s = pose[body, POSE_S]
    return pose[body, POSE_X] + c * x - s * y, pose[body, POSE_Y] + s * x + c * y


@inlined_uncounted
def direction(pose, body, x, y):
    """World components of a vector of a body's frame; body -1 is ground."""
    if body < 0:
        return x, y
    c = pose[body, POSE_C]
    s = pose[body, POSE_S]
    return c * x - s * y, s * x + c * y


@inlined_uncounted
def gap_geometry(pose, p, o, body_a, body_b, shape):
    """Penetration and contact frame of one contact.

    Returns
    -------
    x : penetration, m; positive when touching
    nx, ny : unit normal, pointing from surface B into circle A
    ax, ay : centre of circle A
    bx, by : centre of circle or arc B (for a line: its point)
    distance : distance of the two centres, m; 0 where B is locally a line (its normal turns with B)
    """
    ax, ay = point(pose, body_a, p[o + A_X], p[o + A_Y])
    bx, by = point(pose, body_b, p[o + B_X], p[o + B_Y])
    ux = ax - bx
    uy = ay - by
    r = p[o + A_R]
    if shape == LINE:
        nx, ny = direction(pose, body_b, p[o + N_X], p[o + N_Y])
        return r - (ux * nx + uy * ny), nx, ny, ax, ay, bx, by, 0.0
    rho = p[o + B_R]
    if shape != CIRCLE:
        # tangent lines run on from both ends of the arc; the sign of the tangential coordinate decides
        sx, sy = direction(pose, body_b, p[o + N_X], p[o + N_Y])
        ex, ey = direction(pose, body_b, p[o + E_X], p[o + E_Y])
        beyond_start = ux * sy - uy * sx > 0.0
        beyond_end = ey * -ux + ex * uy > 0.0
        gap_start = ux * sx + uy * sy
        gap_end = ux * ex + uy * ey
        if beyond_start and (not beyond_end or gap_start >= gap_end):
            return r + rho - gap_start, sx, sy, ax, ay, bx, by, 0.0
        if beyond_end:
            return r + rho - gap_end, ex, ey, ax, ay, bx, by, 0.0
    distance = sqrt(ux * ux + uy * uy)
    return r + rho - distance, ux / distance, uy / distance, ax, ay, bx, by, distance


@inlined_uncounted
def along_chain(pose, parent, b, side, px, py, nx, ny):
    """Generalised direction on coordinate ``b`` of a force at (px, py): along the normal and along t = z x n."""
    if parent[b] == GUIDED:
        return side * ny, side * nx
    lx = px - pose[b, POSE_X]
    ly = py - pose[b, POSE_Y]
    return side * (lx * ny - ly * nx), side * (lx * nx + ly * ny)


@inlined_uncounted
def contact_offset(start, contact):
    """Where the numbers of a contact begin in the parameter vector."""
    return start + CONTACT_SIZE * contact
