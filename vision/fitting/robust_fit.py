"""Robust linear least squares: pixels that are occluded, duplicated or glossy are outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.fitting.template import MOST_CONDITION

F64 = NDArray[np.float64]

PIXELS = 6000  # of a body that are fitted, those that tell most: choice, of time
ROUNDS = 2  # of fits: one to find what lies far off, one without it
OUTLYING = 3.5  # standard deviations by the median, beyond which a residual is left out: 1 in 2000 of normal noise
PIXELS_PER_COLUMN = 10  # least, that agree: fewer leave the scatter unknown
LEAST_SPREAD_GREY = 1e-3
"""Standard deviation of residuals that is taken at least, grey: a drawn picture without noise leaves none."""


class RobustFit:
    """Fits of differences of grey values by the columns of one ``design`` (p, n)."""

    def __init__(self, design: F64) -> None:
        self._scale = 1.0 / np.sqrt(np.maximum(np.sum(design**2, axis=1), 1e-300))
        self._columns = design * self._scale[:, None]
        self._normal = self._columns @ self._columns.T  # of all pixels: few are left out of a fit

    def fit(self, difference: F64, usable: NDArray[np.bool_]) -> tuple[F64, F64] | None:
        """Amplitudes (p,) of the columns in a difference of grey values (n,), and their covariance (p, p); None with
        too few ``usable`` pixels, or where the columns are not told apart."""
        columns, scale, kept = self._columns, self._scale, usable
        for _ in range(ROUNDS):
            out = columns[:, ~kept]
            if kept.size - out.shape[1] < PIXELS_PER_COLUMN * len(columns):
                return None
            normal = self._normal - out @ out.T
            least, *_, most = np.linalg.eigvalsh(normal)
            if not most <= MOST_CONDITION * least:
                return None
            inverse = np.linalg.inv(normal)
            amplitude: F64 = inverse @ (columns @ np.where(kept, difference, 0.0))
            rest = np.abs(difference - amplitude @ columns)
            spread = max(1.4826 * float(np.median(rest[kept])), LEAST_SPREAD_GREY)
            kept = usable & (rest <= OUTLYING * spread)
        return np.asarray(amplitude * scale), np.asarray(inverse * spread**2 * scale[:, None] * scale)
