"""Principal axes of a covariance, each with a sign of its own: LAPACK leaves it open, and draws hang on it.

Components that differ by rounding alone count as equal, so that names in order of size come in the same order on every
processor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array

EQUAL = 1e-6
"""Components of a unit vector closer than this are equal: rounding leaves 1e-12 of a well conditioned covariance."""


def largest_first(vector: Array) -> NDArray[np.int64]:
    """Indices of components (n,) by size, the largest first, equal ones in their own order."""
    return np.argsort(-np.round(np.abs(vector) / EQUAL), kind="stable")


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Variances (n,), rising, and axes (n, n) in columns, the largest component of each positive."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    lead = np.array([largest_first(axis)[0] for axis in axes.T], dtype=np.int64)
    return values, axes * np.sign(axes[lead, np.arange(lead.size)])
