"""How inertia and weight of a body change with its numbers and with gravity, at one state of motion.

On a coordinate that moves the centre of mass by an arm, a body of mass 1 takes arm x (acceleration + g).
"""

from model.kernels import layout as L
from model.kernels.compile import inlined_uncounted
from model.kernels.trajectory.kinematics import direction
from model.kernels.workspace import ACC, V


@inlined_uncounted
def swing(alpha, omega, x, y):
    """Acceleration of a point at (x, y) from the pivot of a body that turns."""
    return -alpha * y - omega * omega * x, alpha * x - omega * omega * y


@inlined_uncounted
def turning(i, w, parent):
    """Angular speed and acceleration of body ``i`` from ground."""
    omega, alpha = w[V + i], w[ACC + i]
    if parent[i] >= 0 and parent[parent[i]] != L.GUIDED:
        omega += w[V + parent[i]]
        alpha += w[ACC + parent[i]]
    return omega, alpha


@inlined_uncounted
def lag(push, arm_x, arm_y, force, change):
    """Take from ``push`` the part of a force at an arm, of a mass of 1: (force x, force y), and of a change of both."""
    return push - (-arm_y * force[0] + arm_x * force[1]) - (-change[1] * force[0] + change[0] * force[1])


@inlined_uncounted
def body_change(i, number, w, p, tables, space):
    """What inertia and weight of body ``i`` do when its mass, inertia, centre of mass or pivot changes."""
    parent, pose, push = tables.parent, space.pose, space.push
    o = L.GLOBALS + L.BODY_SIZE * i
    g, mass, up = p[L.GRAVITY], p[o + L.MASS], parent[i]
    if up == L.GUIDED:
        if number == L.MASS:
            push[i] -= w[ACC + i] + g
        return
    omega, alpha = turning(i, w, parent)
    rx, ry = pose[i, L.POSE_CX] - pose[i, L.POSE_X], pose[i, L.POSE_CY] - pose[i, L.POSE_Y]
    ax, ay = swing(alpha, omega, rx, ry)
    ay += g
    carried = up >= 0 and parent[up] != L.GUIDED  # by a body that turns
    ex, ey = rx, ry
    if carried:
        dx, dy = pose[i, L.POSE_X] - pose[up, L.POSE_X], pose[i, L.POSE_Y] - pose[up, L.POSE_Y]
        ex += dx
        ey += dy
        bx, by = swing(w[ACC + up], w[V + up], dx, dy)
        ax += bx
        ay += by
    elif up >= 0:
        ay += w[ACC + up]
    if number == L.INERTIA:
        push[i] -= alpha
        if carried:
            push[up] -= alpha
        return
    if number == L.MASS:
        push[i] = lag(push[i], rx, ry, (ax, ay), (0.0, 0.0))
        if carried:
            push[up] = lag(push[up], ex, ey, (ax, ay), (0.0, 0.0))
        elif up >= 0:
            push[up] -= ay
        return
    along_x = number == L.COM_X or number == L.PIVOT_X
    x, y = (1.0, 0.0) if along_x else (0.0, 1.0)
    if number == L.COM_X or number == L.COM_Y:
        sx, sy = direction(pose, i, x, y)
        jx, jy = swing(alpha, omega, sx, sy)
        own = -ry * jx + rx * jy - sy * ax + sx * ay
    elif carried:
        sx, sy = direction(pose, up, x, y)
        jx, jy = swing(w[ACC + up], w[V + up], sx, sy)
        own = -ry * jx + rx * jy
    else:
        return
    push[i] -= mass * own
    if carried:
        push[up] -= mass * (-ey * jx + ex * jy - sy * ax + sx * ay)
    elif up >= 0:
        push[up] -= mass * jy


@inlined_uncounted
def weight_change(w, p, tables, space):
    """What more gravity does."""
    parent, pose, push = tables.parent, space.pose, space.push
    for i in range(parent.shape[0]):
        mass, up = p[L.GLOBALS + L.BODY_SIZE * i + L.MASS], parent[i]
        if up == L.GUIDED:
            push[i] -= mass
            continue
        push[i] -= mass * (pose[i, L.POSE_CX] - pose[i, L.POSE_X])
        if up >= 0:
            push[up] -= mass if parent[up] == L.GUIDED else mass * (pose[i, L.POSE_CX] - pose[up, L.POSE_X])
