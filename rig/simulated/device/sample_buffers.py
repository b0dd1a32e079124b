"""Sample buffers of a task, as the driver keeps them: one that fills with acquired samples, one that holds written
ones.

A buffer counts samples per channel since the start of its task (acquired and read, or generated), so that overwriting
is found by counting.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.status import DaqStatusError


class InputBuffer:
    """Input buffer of a task: a fixed size, samples acquired, samples read."""

    def __init__(self, size: int, columns: int, *, drops_oldest: bool = False) -> None:
        self.size = size
        self.drops_oldest = drops_oldest
        """Whether a full buffer drops its oldest samples instead of overflowing, as before a reference trigger."""
        self.acquired = 0
        self.read = 0
        self.overwritten = False
        self._blocks: list[NDArray[np.float64]] = []
        self._columns = columns

    @property
    def available(self) -> int:
        """Samples per channel waiting to be read."""
        return self.acquired - self.read

    def put(self, values: NDArray[np.float64]) -> None:
        """Add n samples, shape (n, columns); more unread samples than the buffer holds means loss."""
        self._blocks.append(values)
        self.acquired += values.shape[0]
        if self.available > self.size:
            if self.drops_oldest:
                self.take(self.available - self.size)
            else:
                self.overwritten = True

    def take(self, n: int) -> NDArray[np.float64]:
        """Remove and return the oldest n samples, shape (n, columns)."""
        if self.overwritten:
            raise DaqStatusError(status.SAMPLES_NO_LONGER_AVAILABLE, samples_read=0)
        stored = np.concatenate(self._blocks) if self._blocks else np.empty((0, self._columns))
        self._blocks = [stored[n:]] if stored.shape[0] > n else []
        self.read += n
        return stored[:n]


@dataclass(eq=False)
class OutputBuffer:
    """Output buffer of a task: the samples written, and how many have been generated."""

    samples: NDArray[np.float64] | None = None
    """Shape (n, channels or lines); None before the first write."""
    generated: int = 0
    """Samples per channel generated since the start."""
    size: int = 0
    """Samples per channel the buffer holds while the task runs."""

    @property
    def written(self) -> int:
        """Samples per channel written."""
        return 0 if self.samples is None else self.samples.shape[0]
