"""Pieces that a scene's kernels for lanes are put together from; the physics of `model.kernels.terms` and `laws`.

Where those branch, these compute what any lane needs and choose by a mask. What another lane makes them compute never
reaches a lane: a choice, not a product with zero. Names and arguments are the same, so that one text serves both.
"""

from model.kernels.compile import inlined
from model.kernels.lanes.maths import exponential_near
from model.kernels.lanes.operations import any_of, filled, root, where, with_sign


@inlined
def felt(x, rate, a, b, c, damping):
    """Normal force, its derivative by penetration and by normal speed; (N, N/m, N s/m)."""
    fit = ((a * x + b) * x + c) * x
    factor = 1.0 + damping * rate
    pushes = (x > 0.0) & (fit > 0.0) & (factor > 0.0)
    slope = ((3.0 * a * x + 2.0 * b) * x + c) * factor
    return where(pushes, fit * factor, 0.0), where(pushes, slope, 0.0), where(pushes, fit * damping, 0.0)


@inlined
def friction(s, per, a, b1, b2):
    """Smoothed friction coefficient (or torque) at speed ``s`` and its derivative by ``s``; ``per`` is 1/threshold."""
    z = s * per
    size = abs(z)
    value = filled(1.0, z)
    within = size < 19.5  # beyond, tanh is 1 to the last digit
    if any_of(within):
        e = exponential_near(max(-2.0 * size, -40.0))
        value = where(within, (1.0 - e) / (1.0 + e), 1.0)
    value = with_sign(value, z)
    slope = 1.0 - value * value
    humped = b1 != 0.0
    if any_of(humped):
        z4 = z * z * z * z
        d = 1.0 + b2 * z4
        slope = where(humped, slope + b1 * (1.0 - 3.0 * b2 * z4) / (d * d), slope)
        value = where(humped, value + b1 * z / d, value)
    return a * value, a * slope * per


@inlined
def circle_gap(ux, uy, reach):
    """Penetration (0 where open), normal and centre distance of two circles."""
    square = ux * ux + uy * uy
    near = square < reach * reach
    x = filled(0.0, square)
    nx = x
    ny = x
    distance = x
    if any_of(near):
        distance = root(square)
        inverse = where(distance > 0.0, 1.0 / distance, 0.0)
        x = where(near, reach - distance, 0.0)
        nx = ux * inverse
        ny = uy * inverse
    return x, nx, ny, distance


@inlined
def hybrid_gap(ux, uy, reach, sx, sy, ex, ey):
    """The same against an arc from direction s to e whose tangents run on at both ends; distance 0 on a tangent."""
    beyond_start = ux * sy - uy * sx > 0.0
    beyond_end = ex * uy - ey * ux > 0.0
    gap_start = ux * sx + uy * sy
    gap_end = ux * ex + uy * ey
    on_start = beyond_start & (~beyond_end | (gap_start >= gap_end))
    on_end = beyond_end & ~on_start
    x, nx, ny, distance = circle_gap(ux, uy, reach)
    x = where(on_start, reach - gap_start, where(on_end, reach - gap_end, x))
    nx = where(on_start, sx, where(on_end, ex, nx))
    ny = where(on_start, sy, where(on_end, ey, ny))
    return x, nx, ny, where(on_start | on_end, 0.0, distance)


@inlined
def circle_room(ux, uy, reach):
    """Open gap (0 where touching) and normal of two circles."""
    square = ux * ux + uy * uy
    open_ = square > reach * reach
    distance = root(square)
    inverse = 1.0 / distance
    return (
        where(open_, distance - reach, 0.0),
        where(open_, ux * inverse, 0.0),
        where(open_, uy * inverse, 0.0),
    )


@inlined
def hybrid_room(ux, uy, reach, sx, sy, ex, ey):
    """Open gap and normal against an arc with tangents; never more than the way to where the nearest piece jumps."""
    along_start = uy * sx - ux * sy
    along_end = ex * uy - ey * ux
    out_start = ux * sx + uy * sy
    out_end = ux * ex + uy * ey
    distance = root(ux * ux + uy * uy)
    jump_start = where(out_start < 0.0, abs(along_start), distance)
    jump_end = where(out_end < 0.0, abs(along_end), distance)
    past_end = along_end > 0.0
    on_start = (along_start < 0.0) & (~past_end | (out_start >= out_end))
    on_end = past_end & ~on_start
    on_arc = ~(on_start | on_end)
    inverse = 1.0 / distance
    gap = where(on_start, out_start, where(on_end, out_end, distance)) - reach
    touching = on_arc & (distance <= reach)
    nx = where(touching, 0.0, where(on_start, sx, where(on_end, ex, ux * inverse)))
    ny = where(touching, 0.0, where(on_start, sy, where(on_end, ey, uy * inverse)))
    return where(touching, 0.0, max(0.0, min(gap, min(jump_start, jump_end)))), nx, ny


@inlined
def contact_laws(x, rate, slide, a, b, c, damping, per_v, mu_a, mu_b1, mu_b2):
    """Normal force, its two derivatives, friction coefficient and its derivative."""
    fn, fn_x, fn_rate = felt(x, rate, a, b, c, damping)
    mu = filled(0.0, fn)
    mu_s = mu
    rubs = (fn > 0.0) & (mu_a != 0.0)
    if any_of(rubs):
        mu, mu_s = friction(slide, per_v, mu_a, mu_b1, mu_b2)
        mu = where(rubs, mu, 0.0)
        mu_s = where(rubs, mu_s, 0.0)
    return fn, fn_x, fn_rate, mu, mu_s


@inlined
def contact_force(x, rate, slide, nx, ny, a, b, c, damping, per_v, mu_a, mu_b1, mu_b2):
    """World force on A of a touching contact."""
    fn, _, _ = felt(x, rate, a, b, c, damping)
    ft = filled(0.0, fn)
    rubs = (fn > 0.0) & (mu_a != 0.0)
    if any_of(rubs):
        mu, _ = friction(slide, per_v, mu_a, mu_b1, mu_b2)
        ft = where(rubs, -mu * fn, 0.0)
    return fn * nx - ft * ny, fn * ny + ft * nx


@inlined
def turn_of_first(ax, ay, qx, qy, nx, ny, distance, r, x_j):
    """How the normal (by kappa t) and the point of action move when a joint at (qx, qy) turns body A."""
    vx = -(ay - qy)
    vy = ax - qx
    kappa = where(distance != 0.0, (nx * vy - ny * vx) / distance, 0.0)
    return kappa, vx + 0.5 * x_j * nx + r * kappa * ny, vy + 0.5 * x_j * ny - r * kappa * nx


@inlined
def turn_of_second(bx, by, qx, qy, nx, ny, distance, r, x_j):
    """The same when the joint turns body B."""
    kappa = where(distance != 0.0, -(nx * (bx - qx) + ny * (by - qy)) / distance, 1.0)
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx


@inlined
def lift_of_first(nx, ny, distance, r, x_j):
    """The same when a vertical guide lifts body A."""
    kappa = where(distance != 0.0, nx / distance, 0.0)
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 1.0 + 0.5 * x_j * ny - r * kappa * nx


@inlined
def lift_of_second(nx, ny, distance, r, x_j):
    """The same when a vertical guide lifts body B."""
    kappa = where(distance != 0.0, -nx / distance, 0.0)
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx
