"""Detect that the action is at rest again after a blow.

Each encoder stays within ±``counts`` of one value for a whole window, and the force's mean over the window is within a
band about its mean over the quiet time before the blow. A body that rests slightly off its first position (friction) is
at rest all the same.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray


class RestDetector:
    """Examines the last ``window`` samples once sample ``earliest`` has passed; stores only those.

    Parameters
    ----------
    window : samples that must be at rest
    earliest : first sample that may belong to the rest
    baseline : samples at the beginning of the trial whose mean force is the reference
    counts : allowed deviation of each encoder from the middle, counts
    force_n : half width of the band for the mean force, N
    """

    def __init__(self, *, window: int, earliest: int, baseline: int, counts: int, force_n: float) -> None:
        self._window, self._earliest, self._baseline = window, earliest, baseline
        self._counts, self._force_n = counts, force_n
        self._samples = 0
        self._baseline_sum_n = 0.0
        self._recent: deque[tuple[NDArray[np.float64], NDArray[np.int64]]] = deque()

    def add(self, force_n: NDArray[np.float64], encoder_count: NDArray[np.int64]) -> bool:
        """Take the next samples, force (m,), N, and counts (m, 3); return whether they end a window at rest."""
        if (missing := self._baseline - self._samples) > 0:
            self._baseline_sum_n += float(force_n[:missing].sum())
        self._samples += force_n.shape[0]
        self._recent.append((force_n, encoder_count))
        while sum(force.shape[0] for force, _ in self._recent) - self._recent[0][0].shape[0] >= self._window:
            self._recent.popleft()
        if self._samples < max(self._earliest + self._window, self._baseline):
            return False
        count = np.concatenate([count for _, count in self._recent])[-self._window :]
        if np.any(count.max(axis=0) - count.min(axis=0) > 2 * self._counts):
            return False
        force = np.concatenate([force for force, _ in self._recent])[-self._window :]
        return bool(abs(force.mean() - self._baseline_sum_n / self._baseline) <= self._force_n)
