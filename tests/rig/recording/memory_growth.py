"""A bench whose samples cost nothing, and what memory a recording takes on it."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import pytest

from rig.backend import Backend, Block, Capabilities, Timing
from rig.configuration.rig_file import RigConfig

RATE = 5000.0


class PlayedBack(Backend):
    """Hands out ``samples(first, n)``; ``calls`` keeps what was asked of the outputs."""

    hardware = False

    def __init__(self, samples: Callable[[int, int], Block]) -> None:
        self.samples, self.next = samples, 0
        self.calls: list[str] = []

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities("test", True, {"serial_number": "01AB"}, hardware=self.hardware)

    def configure(self, config: RigConfig, command_v: np.ndarray | None) -> Timing:
        return Timing(RATE, 0.0)

    def arm(self, *, enable_drive: bool = True) -> None:
        self.calls.append(f"arm {enable_drive}")

    def start(self) -> None:
        self.next = 0

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        self.next += n_samples
        return self.samples(self.next - n_samples, n_samples)

    def safe_stop(self) -> None:
        self.calls.append("safe")

    def close(self) -> None:
        pass


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
