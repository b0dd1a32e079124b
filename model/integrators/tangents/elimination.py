"""Gauss's elimination with row exchanges, and its use for many right-hand sides side by side in lanes."""

from model.integrators.tangents.loads import LANES
from model.kernels.compile import inlined
from model.kernels.lanes import rows


@inlined
def factor(space, n):
    """Factors of the first ``n`` rows and columns, rows exchanged as ``order`` says; False where singular.

    The upper one in place, inverses of the diagonal and the lower one in ``lower``.
    """
    a, lower, order = space.matrix, space.lower, space.order
    width = a.shape[1] // LANES
    used = -(-n // LANES)
    row = rows(a, LANES)
    for i in range(n):
        order[i] = i
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        if not abs(a[best, k]) > 0.0:
            return False
        if best != k:
            order[k], order[best] = order[best], order[k]
            for j in range(k):
                lower[k, j], lower[best, j] = lower[best, j], lower[k, j]
            for j in range(k // LANES, used):
                row[k * width + j], row[best * width + j] = row[best * width + j], row[k * width + j]
        inverse = 1.0 / a[k, k]
        lower[k, k] = inverse
        for i in range(k + 1, n):
            x = a[i, k] * inverse
            lower[i, k] = x
            if x != 0.0:
                for j in range(k // LANES, used):
                    row[i * width + j] = row[i * width + j] - x * row[k * width + j]
                a[i, k] = 0.0  # what is left of the pivot in row k stays zero, so that whole lanes can be taken
    return True


@inlined
def substitute(space, n, x, first, blocks):
    """Solve with the factors for ``n`` rows of lanes, ``blocks`` apart, in place and in the factors' order."""
    a, lower = space.matrix, space.lower
    for i in range(n):
        sum_ = x[first + i * blocks]
        for j in range(i):
            sum_ = sum_ - lower[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_
    for i in range(n - 1, -1, -1):
        sum_ = x[first + i * blocks]
        for j in range(i + 1, n):
            sum_ = sum_ - a[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_ * lower[i, i]


@inlined
def substitute_four(space, n, x, first, blocks):
    """`substitute` for four blocks at once: one alone waits for each of its sums."""
    a, lower = space.matrix, space.lower
    for i in range(n):
        k = first + i * blocks
        s0, s1, s2, s3 = x[k], x[k + 1], x[k + 2], x[k + 3]
        for j in range(i):
            k = first + j * blocks
            y = lower[i, j]
            s0, s1, s2, s3 = s0 - y * x[k], s1 - y * x[k + 1], s2 - y * x[k + 2], s3 - y * x[k + 3]
        k = first + i * blocks
        x[k], x[k + 1], x[k + 2], x[k + 3] = s0, s1, s2, s3
    for i in range(n - 1, -1, -1):
        k = first + i * blocks
        s0, s1, s2, s3 = x[k], x[k + 1], x[k + 2], x[k + 3]
        for j in range(i + 1, n):
            k = first + j * blocks
            y = a[i, j]
            s0, s1, s2, s3 = s0 - y * x[k], s1 - y * x[k + 1], s2 - y * x[k + 2], s3 - y * x[k + 3]
        k = first + i * blocks
        y = lower[i, i]
        x[k], x[k + 1], x[k + 2], x[k + 3] = s0 * y, s1 * y, s2 * y, s3 * y
