"""Small dense linear algebra in place (LU with partial pivoting), and the scratch arrays of a step."""

import numpy as np

from model.kernels.compile import kernel
from model.kernels.layout import MAX_CHAIN, POSE_SIZE


@kernel
def factorise(a, pivot):
    """LU factors of ``a`` (n, n) in place; returns False where it is singular or not finite."""
    n = a.shape[0]
    for k in range(n):
        best = abs(a[k, k])
        row = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > best:
                best = abs(a[i, k])
                row = i
        if not best > 0.0:
            return False
        pivot[k] = row
        if row != k:
            for j in range(n):
                keep = a[k, j]
                a[k, j] = a[row, j]
                a[row, j] = keep
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            factor = a[i, k] * inverse
            a[i, k] = factor
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
    return True


@kernel
def solve(a, pivot, b):
    """Solve with the factors of ``factorise``; ``b`` (n,) becomes the solution."""
    n = a.shape[0]
    for k in range(n):
        row = pivot[k]
        keep = b[k]
        b[k] = b[row]
        b[row] = keep
    for i in range(1, n):
        s = b[i]
        for j in range(i):
            s -= a[i, j] * b[j]
        b[i] = s
    for i in range(n - 1, -1, -1):
        s = b[i]
        for j in range(i + 1, n):
            s -= a[i, j] * b[j]
        b[i] = s / a[i, i]


@kernel
def workspace(n, s):
    """Scratch of one integration of ``n`` coordinates with ``s`` stages, allocated once."""
    pose = np.zeros((n, POSE_SIZE))
    uq = np.zeros((s, n))
    uv = np.zeros((s, n))
    scratch = np.zeros((15, n))
    stiff = np.zeros((n, n))
    damp = np.zeros((n, n))
    system = np.zeros((n, n))
    work = np.zeros((4, MAX_CHAIN))
    pivot = np.zeros(n, dtype=np.int64)
    return pose, uq, uv, scratch, stiff, damp, system, work, pivot
