"""Prescribed motion of a coordinate: a piecewise polynomial in time, kept in a scene's parameter vector.

A scene whose key is prescribed takes the time itself as its input u; kernels read angle, speed, acceleration and jerk
here, so that df/du is the time derivative a Rosenbrock step needs. Block at ``o``: number of pieces m, then m + 1
increasing breaks (s), then m rows of `ORDER` coefficients, highest power first, in the time since the row's break.
Outside the breaks the first or last polynomial goes on.
"""

from model.kernels.compile import inlined, kernel

ORDER = 6  # coefficients of a piece: a quintic


@inlined
def piece_at(p, o, t, k):
    """Index of the piece that holds time ``t``, searched from ``k`` on."""
    last = int(p[o]) - 1
    k = min(max(k, 0), last)
    while k < last and t >= p[o + 2 + k]:
        k += 1
    while k > 0 and t < p[o + 1 + k]:
        k -= 1
    return k


@inlined
def motion_at(p, o, t, k):
    """Angle and its first three derivatives at ``t`` on piece ``k``; rad, rad/s, rad/s^2, rad/s^3."""
    x = t - p[o + 1 + k]
    c = o + 2 + int(p[o]) + ORDER * k
    a, b, d, e, f, g = p[c], p[c + 1], p[c + 2], p[c + 3], p[c + 4], p[c + 5]
    return (
        ((((a * x + b) * x + d) * x + e) * x + f) * x + g,
        (((5.0 * a * x + 4.0 * b) * x + 3.0 * d) * x + 2.0 * e) * x + f,
        ((20.0 * a * x + 12.0 * b) * x + 6.0 * d) * x + 2.0 * e,
        (60.0 * a * x + 24.0 * b) * x + 6.0 * d,
    )


@kernel
def motion_along(times, p, o, out):
    """Fill ``out`` (m, 3) with angle, speed and acceleration at ``times`` (m,)."""
    k = 0
    for i in range(times.shape[0]):
        k = piece_at(p, o, times[i], k)
        out[i, 0], out[i, 1], out[i, 2], _ = motion_at(p, o, times[i], k)
