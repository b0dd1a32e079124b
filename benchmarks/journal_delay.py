"""How long a sample takes to the journal: a journal that keeps the times, for recording_numbers.py and the tests."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from rig.session.journal import JournalWriter


class Timed(JournalWriter):
    """A journal that notes when each block came and when it was committed."""

    log: list[tuple[int, int, float, float]] = []

    def append(self, block: Any) -> int:
        """Hand on, with the times before and after."""
        before = time.monotonic()
        committed = super().append(block)
        Timed.log.append((block.first_sample, block.force_n.size, before, time.monotonic()))
        return committed

    @staticmethod
    def ages_s() -> np.ndarray:
        """From sample to journal, s, of every sample in the log."""
        ages: list[np.ndarray] = []
        start = [k for k, entry in enumerate(Timed.log) if entry[0] == 0] + [len(Timed.log)]
        for first, end in zip(start, start[1:], strict=False):
            part = Timed.log[first:end]
            # the sample clock began when the block that came soonest after its last sample says it did
            zero = min(came - (at + n) / 5000.0 for at, n, came, _ in part)
            ages += [done - zero - (at + np.arange(n)) / 5000.0 for at, n, _, done in part]
        return np.concatenate(ages)
