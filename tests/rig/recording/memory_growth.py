"""What memory a recording takes."""

from __future__ import annotations

import tracemalloc
from typing import Any, Self

import pytest


class Growth:
    """Progress of a recording that keeps ``mb``, the most memory it took beyond that at ``after_s``."""

    def __init__(self, after_s: float) -> None:
        self.after_s = after_s
        self.began: int | None = None

    def __enter__(self) -> Self:
        tracemalloc.start()
        return self

    def __call__(self, at: Any) -> None:
        if at.time_s > self.after_s and self.began is None:
            tracemalloc.reset_peak()
            self.began = tracemalloc.get_traced_memory()[0]

    def __exit__(self, *raised: object) -> None:
        self.mb = (tracemalloc.get_traced_memory()[1] - (self.began or 0)) / 1e6
        tracemalloc.stop()


class EachMinute(list[float]):
    """Progress that keeps the process's peak memory in MB after each minute."""

    def __call__(self, at: Any) -> None:
        if at.time_s > 60.0 * (1 + len(self)):
            self.append(peak_mb())


def peak_mb() -> float:
    resource = pytest.importorskip("resource")
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
