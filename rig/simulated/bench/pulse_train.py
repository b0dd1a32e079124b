"""A periodic pulse train: the pulses of a counter output, or the exposure signal of a camera that runs by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PulseTrain:
    """Rising edges at ``first_s + k / rate_hz``, ``count`` of them (may be infinite); high for ``high_s`` each."""

    rate_hz: float
    first_s: float
    count: float
    high_s: float
    before: int = 0
    """Edges that had passed before ``first_s``."""

    def passed(self, time_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return how many rising edges have passed by each time."""
        edges = np.floor((time_s - self.first_s) * self.rate_hz + 1e-9) + 1
        return np.asarray(np.clip(self.before + np.maximum(edges, 0), 0, self.count), dtype=np.int64)

    def passed_at(self, time_s: float) -> int:
        """Return how many rising edges have passed by one time."""
        return int(self.passed(np.array([time_s]))[0])

    def next_after(self, time_s: float) -> float:
        """Return when the next rising edge comes; infinite when there is none."""
        passed = self.passed_at(time_s)
        return self.first_s + (passed - self.before) / self.rate_hz if passed < self.count else float("inf")

    @property
    def end_s(self) -> float:
        """When the last pulse has ended."""
        last = self.count - 1 - self.before
        return self.first_s + last / self.rate_hz + self.high_s if np.isfinite(self.count) else float("inf")
