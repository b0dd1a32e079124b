"""What memory a recording takes."""

from __future__ import annotations

import tracemalloc
from typing import Any, Self


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
