"""Sums over banded symmetric matrices that SciPy does not have: rows into a normal matrix, selected inverse, variances.

A symmetric matrix with ``b`` diagonals above the main one is kept as SciPy's upper form, (b + 1, n): entry (i, j),
i <= j <= i + b, lies at ``[b + i - j, j]``. Rows of a design have ``b + 1`` neighbouring entries from ``first`` on.
"""

import numpy as np

from model.kernels.compile import kernel


@kernel
def add_outer_products(matrix, first, rows, weight):
    b = matrix.shape[0] - 1
    for r in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            for m in range(k, rows.shape[1]):
                matrix[b + k - m, first[r] + m] += weight[r] * rows[r, k] * rows[r, m]


def add_weighted_rows(vector, first, rows, weight):
    at = first[:, None] + np.arange(rows.shape[1])
    vector += np.bincount(at.ravel(), (weight[:, None] * rows).ravel(), len(vector))


def multiply_rows(vector, first, rows):
    """Product of each row with ``vector``, (r,)."""
    return np.sum(rows * vector[first[:, None] + np.arange(rows.shape[1])], axis=1)


@kernel
def inverse_band(factor):
    """Band of (U^T U)^-1 (Takahashi's recursion) from U, ``factor``; both as SciPy's upper form (b + 1, n): entry (i,
    j) of the matrix at [b + i - j, j]."""
    b = factor.shape[0] - 1
    n = factor.shape[1]
    out = np.zeros_like(factor)
    for i in range(n - 1, -1, -1):
        end = min(n - 1, i + b)
        for j in range(end, i - 1, -1):
            s = 1.0 / factor[b, i] if j == i else 0.0
            for k in range(i + 1, end + 1):
                low, high = (k, j) if k <= j else (j, k)
                s -= factor[b + i - k, k] * out[b + low - high, high]
            out[b + i - j, j] = s / factor[b, i]
    return out


@kernel
def row_variances(inverse, first, rows):
    """Return row · matrix · row^T (r,) for each of ``rows`` (r, k), which begin at columns ``first`` (r,), from the
    band ``inverse`` (b + 1, n), SciPy's upper form, of the symmetric matrix."""
    b = inverse.shape[0] - 1
    out = np.zeros(rows.shape[0])
    for r in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            for m in range(k, rows.shape[1]):
                share = 1.0 if m == k else 2.0
                out[r] += share * rows[r, k] * rows[r, m] * inverse[b + k - m, first[r] + m]
    return out


@kernel
def window_means(x, low, high):
    """Means (r,) of ``x`` from index ``low`` (r,) to before ``high`` (r,)."""
    out = np.zeros(low.shape[0])
    for r in range(low.shape[0]):
        for k in range(low[r], high[r]):
            out[r] += x[k]
        out[r] /= high[r] - low[r]
    return out
