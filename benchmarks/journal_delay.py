"""Delay from sample to journal: a journal that records the times, for recording_numbers.py and the tests."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from rig.session.journal.writer import JournalWriter


class Timed(JournalWriter):
    """A journal that notes when each block arrived and when it was committed."""

    log: list[tuple[int, int, float, float]] = []

    def append(self, block: Any) -> int:
        """Write the block, recording the times before and after."""
        before = time.monotonic()
        committed = super().append(block)
        Timed.log.append((block.first_sample, block.force_n.size, before, time.monotonic()))
        return committed

    @staticmethod
    def ages_s() -> np.ndarray:
        """Delay from sample to journal, s, of every sample in the log."""
        ages: list[np.ndarray] = []
        start = [k for k, entry in enumerate(Timed.log) if entry[0] == 0] + [len(Timed.log)]
        for first, end in zip(start, start[1:], strict=False):
            part = Timed.log[first:end]
            # the block with the shortest delay after its last sample defines the start of the sample clock
            zero = min(came - (at + n) / 5000.0 for at, n, came, _ in part)
            ages += [done - zero - (at + np.arange(n)) / 5000.0 for at, n, _, done in part]
        return np.concatenate(ages)
