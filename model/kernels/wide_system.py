"""Linear algebra of a step where joints give: all coordinates, the directions in which joints give after the others.

The places of matrices and vectors are in `model.kernels.workspace`; ``n`` is the number of coordinates. Loops over
whole matrices, where the kernels of other scenes have a line for each entry that can be filled: fifteen coordinates
would be thousands of lines to compile.
"""

from model.kernels.compile import inlined
from model.kernels.workspace import (
    P_ALLOWANCE,
    P_DAMP,
    P_FORCE,
    P_INPUT,
    P_KNOWN,
    P_LU,
    P_MASS,
    P_STIFF,
    P_WAY,
    P_WORK,
    WIDE,
)

LONGEST_OF_STAGE = 5.0  # steps over gamma times the step, at most: no method has a gamma below 0.2


@inlined
def cleared(w, n):
    """Empty K, D and M."""
    for i in range(n):
        for j in range(n):
            w[P_STIFF + WIDE * i + j] = 0.0
            w[P_DAMP + WIDE * i + j] = 0.0
            w[P_MASS + WIDE * i + j] = 0.0


@inlined
def accelerated(w, mass, n):
    """Solve M a = f: f at `P_FORCE` becomes a. Of M, at ``mass``, the lower triangle is read, and kept."""
    for i in range(n):
        for j in range(i + 1):
            w[P_WORK + WIDE * i + j] = w[mass + WIDE * i + j]
    for k in range(n):
        pivot = 1.0 / w[P_WORK + WIDE * k + k]
        for i in range(k + 1, n):
            x = w[P_WORK + WIDE * i + k]
            if x == 0.0:
                continue
            x *= pivot
            for j in range(k + 1, i + 1):
                w[P_WORK + WIDE * i + j] -= x * w[P_WORK + WIDE * j + k]
            w[P_FORCE + i] -= x * w[P_FORCE + k]
    for k in range(n - 1, -1, -1):
        x = w[P_FORCE + k]
        for i in range(k + 1, n):
            x -= w[P_WORK + WIDE * i + k] * w[P_FORCE + i]
        w[P_FORCE + k] = x / w[P_WORK + WIDE * k + k]


@inlined
def assembled(w, inverse, gh, n):
    """The matrix M / (gamma h) - D - gamma h K of a step, at `P_LU`."""
    for i in range(n):
        for j in range(n):
            mass = w[P_MASS + WIDE * i + j] if j <= i else w[P_MASS + WIDE * j + i]
            w[P_LU + WIDE * i + j] = inverse * mass - w[P_DAMP + WIDE * i + j] - gh * w[P_STIFF + WIDE * i + j]


@inlined
def factored(w, n):
    """Its factors in its place, without exchanges; the diagonal holds reciprocals. 0 where that loses six digits."""
    for i in range(n):
        w[P_WORK + i] = 1e-6 * abs(w[P_LU + WIDE * i + i])
    for k in range(n):
        if not abs(w[P_LU + WIDE * k + k]) > w[P_WORK + k]:
            return 0
        pivot = 1.0 / w[P_LU + WIDE * k + k]
        w[P_LU + WIDE * k + k] = pivot
        for i in range(k + 1, n):
            x = w[P_LU + WIDE * i + k]
            if x == 0.0:
                continue
            x *= pivot
            w[P_LU + WIDE * i + k] = x
            for j in range(k + 1, n):
                w[P_LU + WIDE * i + j] -= x * w[P_LU + WIDE * k + j]
    return 1


@inlined
def known(w, gh, ft, n):
    """Known side of a stage at `P_KNOWN`: M a + ft df/du + gamma h K b, a at `P_FORCE` and b at `P_WAY`."""
    for i in range(n):
        x = ft * w[P_INPUT + i]
        for j in range(n):
            mass = w[P_MASS + WIDE * i + j] if j <= i else w[P_MASS + WIDE * j + i]
            x += mass * w[P_FORCE + j] + gh * w[P_STIFF + WIDE * i + j] * w[P_WAY + j]
        w[P_KNOWN + i] = x


@inlined
def solved(w, n):
    """The speeds of a stage in place of its known side."""
    for i in range(n):
        x = w[P_KNOWN + i]
        for j in range(i):
            x -= w[P_LU + WIDE * i + j] * w[P_KNOWN + j]
        w[P_KNOWN + i] = x
    for i in range(n - 1, -1, -1):
        x = w[P_KNOWN + i]
        for j in range(i + 1, n):
            x -= w[P_LU + WIDE * i + j] * w[P_KNOWN + j]
        w[P_KNOWN + i] = x * w[P_LU + WIDE * i + i]


@inlined
def allowed(w, i, speed, acceleration, gh):
    """How far coordinate ``i`` may move within the step before contacts that were left out must be evaluated."""
    step = LONGEST_OF_STAGE * gh
    w[P_ALLOWANCE + i] = 1.5 * step * abs(speed) + step * step * abs(acceleration) + 1e-7
