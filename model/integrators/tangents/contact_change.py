"""How the force of a contact changes with its surfaces, its felt and its friction, at one state of motion.

A change of the surfaces is a ``way``: how far, in the world's frame, each number of `layout` up to E_Y moves what it
places; then how far the pivot moves that carries one of the bodies. Force and signs as in
``model.kernels.trajectory.dynamics``: on coordinate b of the chain it is fn (gn_b - mu gt_b).
"""

from model.kernels import layout as L
from model.kernels.compile import inlined_uncounted
from model.kernels.laws import felt, friction
from model.kernels.trajectory.kinematics import direction, gap_geometry
from model.kernels.workspace import V

WAY_SIZE = L.E_Y + 3  # the last two: of a pivot
# numbers of a contact that pushes: penetration, normal, between the centres, their distance, radius to the point of
# action; normal force and its slopes by penetration and its rate; friction coefficient and its slope; rate, sliding
# speed, static force, which straight piece of B is touched (0 none), by how much the normal force was changed since
# somebody set that to 0; then per coordinate of the chain gn, gt, arm
(
    DEPTH, N_X, N_Y, BETWEEN_X, BETWEEN_Y, DISTANCE, RADIUS, NORMAL, NORMAL_X, NORMAL_RATE, GRIP, SLIDE_GRIP, SQUEEZE,
    SLIDING, FELT_FIT, STRAIGHT, PRESSED,
) = range(17)  # fmt: skip
CHAIN = 17
TOUCH_SIZE = CHAIN + 4 * L.MAX_CHAIN


@inlined_uncounted
def touch_contact(c, w, p, tables, space):
    """Fill row ``c`` of ``space.touch``; its normal force is 0 where the contact does not push."""
    t, pose = space.touch[c], space.pose
    o = tables.offset[1] + L.CONTACT_SIZE * c
    body_b = tables.contact[c, 1]
    x, nx, ny, ax, ay, bx, by, distance = gap_geometry(pose, p, o, tables.contact[c, 0], body_b, tables.contact[c, 2])
    t[NORMAL] = 0.0
    if not x > 0.0:
        return
    r = p[o + L.A_R] - 0.5 * x
    px, py = ax - r * nx, ay - r * ny
    rate = 0.0
    slide = 0.0
    for k in range(tables.contact[c, 3]):
        b, side = tables.chain[c, k], tables.side[c, k]
        at = CHAIN + 4 * k
        if tables.parent[b] == L.GUIDED:
            t[at], t[at + 1] = side * ny, side * nx
        else:
            lx, ly = px - pose[b, L.POSE_X], py - pose[b, L.POSE_Y]
            t[at], t[at + 1] = side * (lx * ny - ly * nx), side * (lx * nx + ly * ny)
            t[at + 2], t[at + 3] = lx, ly
        rate -= t[at] * w[V + b]
        slide += t[at + 1] * w[V + b]
    a, b1, c1, damping = p[o + L.K_A], p[o + L.K_B], p[o + L.K_C], p[o + L.DAMP]
    t[NORMAL], t[NORMAL_X], t[NORMAL_RATE] = felt(x, rate, a, b1, c1, damping)
    t[GRIP], t[SLIDE_GRIP] = friction(slide, 1.0 / p[L.V_T], p[o + L.MU_A], p[o + L.MU_B1], p[o + L.MU_B2])
    t[DEPTH], t[N_X], t[N_Y], t[BETWEEN_X], t[BETWEEN_Y] = x, nx, ny, ax - bx, ay - by
    t[DISTANCE], t[RADIUS], t[SQUEEZE], t[SLIDING] = distance, r, rate, slide
    t[FELT_FIT] = ((a * x + b1) * x + c1) * x
    t[STRAIGHT] = 0.0
    if distance == 0.0:
        sx, sy = direction(pose, body_b, p[o + L.N_X], p[o + L.N_Y])
        t[STRAIGHT] = L.N_X if sx == nx and sy == ny else L.E_X


@inlined_uncounted
def press_change(c, t, force, tables, push):
    """Add what a change of the normal force does."""
    t[PRESSED] += force
    for k in range(tables.contact[c, 3]):
        push[tables.chain[c, k]] += force * (t[CHAIN + 4 * k] - t[GRIP] * t[CHAIN + 4 * k + 1])


@inlined_uncounted
def rub_change(c, t, grip, tables, push):
    """Add what a change of the friction coefficient does."""
    for k in range(tables.contact[c, 3]):
        push[tables.chain[c, k]] -= t[NORMAL] * grip * t[CHAIN + 4 * k + 1]


@inlined_uncounted
def direction_change(c, k, moves, t, tables):
    """Change of a coordinate's normal and tangential direction, from that of the normal and of the point of action."""
    dnx, dny, dpx, dpy = moves
    at, side = CHAIN + 4 * k, tables.side[c, k]
    if tables.parent[tables.chain[c, k]] == L.GUIDED:
        return side * dny, side * dnx
    lx, ly, nx, ny = t[at + 2], t[at + 3], t[N_X], t[N_Y]
    return (
        side * (dpx * ny - dpy * nx + lx * dny - ly * dnx),
        side * (dpx * nx + dpy * ny + lx * dnx + ly * dny),
    )


@inlined_uncounted
def surfaces_moved(t, way):
    """Changes of the penetration, of the normal and of the point of action when the surfaces move by a ``way``."""
    nx, ny, r = t[N_X], t[N_Y], t[RADIUS]
    dux, duy = way[L.A_X] - way[L.B_X], way[L.A_Y] - way[L.B_Y]
    depth = way[L.A_R] + way[L.B_R] - (nx * dux + ny * duy)
    if t[STRAIGHT] == 0.0:
        turn = (nx * duy - ny * dux) / t[DISTANCE]
        dnx, dny = -ny * turn, nx * turn
    else:
        straight = int(t[STRAIGHT])
        dnx, dny = way[straight], way[straight + 1]
        depth -= t[BETWEEN_X] * dnx + t[BETWEEN_Y] * dny
    dr = way[L.A_R] - 0.5 * depth
    return depth, (dnx, dny, way[L.A_X] - dr * nx - r * dnx, way[L.A_Y] - dr * ny - r * dny)


@inlined_uncounted
def change_contact(c, carried, t, way, w, tables, push):
    """Add what moving the surfaces by a ``way`` does; with them moves the pivot of body ``carried``, if any."""
    depth, (dnx, dny, dpx, dpy) = surfaces_moved(t, way)
    rate = 0.0
    slide = 0.0
    for k in range(tables.contact[c, 3]):
        b = tables.chain[c, k]
        moved = carried >= 0 and (b == carried or tables.parent[b] == carried)
        sx, sy = (way[WAY_SIZE - 2], way[WAY_SIZE - 1]) if moved else (0.0, 0.0)
        gn, gt = direction_change(c, k, (dnx, dny, dpx - sx, dpy - sy), t, tables)
        rate -= gn * w[V + b]
        slide += gt * w[V + b]
        push[b] += t[NORMAL] * (gn - t[GRIP] * gt)
    press_change(c, t, t[NORMAL_X] * depth + t[NORMAL_RATE] * rate, tables, push)
    rub_change(c, t, t[SLIDE_GRIP] * slide, tables, push)
