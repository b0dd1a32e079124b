"""Covariance of a pose from its normal matrix, compiled: `template.invert_normal` and two products in one call."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64 = NDArray[np.float64]
MOST = 1e9
"""Largest element of the inverse of a normal matrix whose columns are scaled to length one."""


@njit(cache=True)
def inverse_and_covariance(
    normal: F64, noise_normal: F64, share: float, factor: float, inverse: F64, covariance: F64
) -> bool:
    """Invert ``normal`` less ``share`` of ``noise_normal``, each (5, 5), into ``inverse``; ``covariance`` (3, 3)
    becomes ``factor`` times inverse, ``normal`` and inverse multiplied. False when the columns do not fix all five
    parameters.
    """
    scale, work = np.empty(5), np.zeros((5, 10))
    for i in range(5):
        diagonal = normal[i, i] - share * noise_normal[i, i]
        if not (diagonal > 0.0 and np.isfinite(diagonal)):
            return False
        scale[i] = 1.0 / np.sqrt(diagonal)
    for i in range(5):
        for j in range(5):
            work[i, j] = (normal[i, j] - share * noise_normal[i, j]) * scale[i] * scale[j]
        work[i, 5 + i] = 1.0
    # Gauss-Jordan without exchange of rows: the matrix is positive where this succeeds
    for i in range(5):
        pivot = work[i, i]
        if not pivot > 1.0 / MOST:
            return False
        for k in range(10):  # whole rows at once would compile a message about their shapes, for 1.5 s
            work[i, k] /= pivot
        for row in range(5):
            if row != i:
                share_of_row = work[row, i]
                for k in range(10):
                    work[row, k] -= share_of_row * work[i, k]
    for i in range(5):
        for j in range(5):
            if not abs(work[i, 5 + j]) < MOST:
                return False
            inverse[i, j] = work[i, 5 + j] * scale[i] * scale[j]
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(5):
                for m in range(5):
                    total += inverse[i, k] * normal[k, m] * inverse[m, j]
            covariance[i, j] = factor * total
    return True
