"""Scalar pieces that a scene's generated kernels are put together from: rotation, gaps, contact forces, derivatives.

All are compiled into their callers. Signs and conventions as in ``trajectory.dynamics``, which holds the same
physics as loops over tables; the tests compare both with each other and with the reference equations.
"""

from math import cos, sin, sqrt

from model.kernels.compile import inlined
from model.kernels.laws import felt, friction

_QUARTER_TURN = 0.7853981633974483


@inlined
def cosine_sine(x):
    """Cosine and sine; polynomials of the FreeBSD maths library (fdlibm, < 1 ulp) up to 45 degrees, libm beyond."""
    if abs(x) > _QUARTER_TURN:
        return cos(x), sin(x)
    z = x * x
    s = 1.58969099521155010221e-10
    s = s * z - 2.50507602534068634195e-08
    s = s * z + 2.75573137070700676789e-06
    s = s * z - 1.98412698298579493134e-04
    s = s * z + 8.33333333332248946124e-03
    s = s * z - 1.66666666666666324348e-01
    c = -1.13596475577881948265e-11
    c = c * z + 2.08757232129817482790e-09
    c = c * z - 2.75573143513906633035e-07
    c = c * z + 2.48015872894767294178e-05
    c = c * z - 1.38888888888741095749e-03
    c = c * z + 4.16666666666666019037e-02
    return 1.0 - (0.5 * z - z * z * c), x + x * z * s


@inlined
def circle_gap(ux, uy, reach):
    """Penetration, normal and centre distance of two circles; (ux, uy) between centres, radii add up to ``reach``."""
    square = ux * ux + uy * uy
    if square >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    distance = sqrt(square)
    if distance == 0.0:
        return reach, 0.0, 0.0, 0.0
    inverse = 1.0 / distance
    return reach - distance, ux * inverse, uy * inverse, distance


@inlined
def hybrid_gap(ux, uy, reach, sx, sy, ex, ey):
    """The same against an arc from direction s to e whose tangents run on at both ends; distance 0 on a tangent."""
    beyond_start = ux * sy - uy * sx > 0.0
    beyond_end = ex * uy - ey * ux > 0.0
    gap_start = ux * sx + uy * sy
    gap_end = ux * ex + uy * ey
    if beyond_start and (not beyond_end or gap_start >= gap_end):
        return reach - gap_start, sx, sy, 0.0
    if beyond_end:
        return reach - gap_end, ex, ey, 0.0
    return circle_gap(ux, uy, reach)


@inlined
def circle_room(ux, uy, reach):
    """Open gap (0 where touching) and normal of two circles."""
    square = ux * ux + uy * uy
    if square <= reach * reach:
        return 0.0, 0.0, 0.0
    distance = sqrt(square)
    return distance - reach, ux / distance, uy / distance


@inlined
def hybrid_room(ux, uy, reach, sx, sy, ex, ey):
    """Open gap and normal against an arc with tangents; never more than the way to where the nearest piece jumps.

    Behind the arc's centre the rule that picks arc or tangent jumps across the extensions of its end radii.
    """
    along_start = uy * sx - ux * sy
    along_end = ex * uy - ey * ux
    out_start = ux * sx + uy * sy
    out_end = ux * ex + uy * ey
    distance = sqrt(ux * ux + uy * uy)
    jump_start = abs(along_start) if out_start < 0.0 else distance
    jump_end = abs(along_end) if out_end < 0.0 else distance
    if along_start < 0.0 and (not along_end > 0.0 or out_start >= out_end):
        gap, nx, ny = out_start - reach, sx, sy
    elif along_end > 0.0:
        gap, nx, ny = out_end - reach, ex, ey
    else:
        if distance <= reach:
            return 0.0, 0.0, 0.0
        gap, nx, ny = distance - reach, ux / distance, uy / distance
    return max(0.0, min(gap, min(jump_start, jump_end))), nx, ny


@inlined
def contact_force(x, rate, slide, nx, ny, a, b, c, damping, per_v, mu_a, mu_b1, mu_b2):
    """World force on A of a touching contact."""
    fn, _, _ = felt(x, rate, a, b, c, damping)
    ft = 0.0
    if fn > 0.0 and mu_a != 0.0:
        mu, _ = friction(slide, per_v, mu_a, mu_b1, mu_b2)
        ft = -mu * fn
    return fn * nx - ft * ny, fn * ny + ft * nx


@inlined
def contact_laws(x, rate, slide, a, b, c, damping, per_v, mu_a, mu_b1, mu_b2):
    """Normal force, its two derivatives, friction coefficient and its derivative."""
    fn, fn_x, fn_rate = felt(x, rate, a, b, c, damping)
    mu = 0.0
    mu_s = 0.0
    if fn > 0.0 and mu_a != 0.0:
        mu, mu_s = friction(slide, per_v, mu_a, mu_b1, mu_b2)
    return fn, fn_x, fn_rate, mu, mu_s


@inlined
def felt_energy(x, rate, fn, a, b, c):
    """Elastic energy (J) of felt pressed in by ``x`` and the power (W) it takes beyond that.

    Where a x^2 + b x + c dips below zero the felt does not press, and stores nothing (0022-model-felt-pocket.md).
    """
    stored = x * x * (0.5 * c + x * (b / 3.0 + 0.25 * a * x))
    spread = b * b - 4.0 * a * c
    if b < 0.0 and spread > 0.0 and a > 0.0:
        low = (-b - sqrt(spread)) / (2.0 * a)
        high = min(x, (-b + sqrt(spread)) / (2.0 * a))
        if x > low:
            stored += low * low * (0.5 * c + low * (b / 3.0 + 0.25 * a * low))
            stored -= high * high * (0.5 * c + high * (b / 3.0 + 0.25 * a * high))
    return stored, (fn - max(0.0, ((a * x + b) * x + c) * x)) * rate


@inlined
def turn_of_first(ax, ay, qx, qy, nx, ny, distance, r, x_j):
    """How the normal (by kappa t) and the point of action move when a joint at (qx, qy) turns body A."""
    vx = -(ay - qy)
    vy = ax - qx
    kappa = 0.0
    if distance != 0.0:
        kappa = (nx * vy - ny * vx) / distance
    return kappa, vx + 0.5 * x_j * nx + r * kappa * ny, vy + 0.5 * x_j * ny - r * kappa * nx


@inlined
def turn_of_second(bx, by, qx, qy, nx, ny, distance, r, x_j):
    """The same when the joint turns body B."""
    kappa = 1.0
    if distance != 0.0:
        kappa = -(nx * (bx - qx) + ny * (by - qy)) / distance
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx


@inlined
def lift_of_first(nx, ny, distance, r, x_j):
    """The same when a vertical guide lifts body A."""
    kappa = 0.0
    if distance != 0.0:
        kappa = nx / distance
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 1.0 + 0.5 * x_j * ny - r * kappa * nx


@inlined
def lift_of_second(nx, ny, distance, r, x_j):
    """The same when a vertical guide lifts body B."""
    kappa = 0.0
    if distance != 0.0:
        kappa = -nx / distance
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx


@inlined
def slide_of_first(nx, ny, distance, r, x_j):
    """The same when a pin that gives to the right carries body A."""
    kappa = 0.0
    if distance != 0.0:
        kappa = -ny / distance
    return kappa, 1.0 + 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx


@inlined
def slide_of_second(nx, ny, distance, r, x_j):
    """The same when it carries body B."""
    kappa = 0.0
    if distance != 0.0:
        kappa = ny / distance
    return kappa, 0.5 * x_j * nx + r * kappa * ny, 0.5 * x_j * ny - r * kappa * nx


@inlined
def turn_of_arm(side, mx, my, nx, ny, kappa, lx, ly):
    """Change of a joint's generalised normal and tangential direction when its arm moves by (mx, my)."""
    return (
        side * (mx * ny - my * nx + kappa * (lx * nx + ly * ny)),
        side * (mx * nx + my * ny - kappa * (lx * ny - ly * nx)),
    )
