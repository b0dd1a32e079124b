"""Analog-to-digital conversion of the virtual device: input delay, range, quantisation.

The 9237's decimation filter is modelled by its group delay only (linear interpolation between sample edges); before a
trial starts the force has its value at the first edge. Noise and hum are added after the delay, so that they are read
in their stated size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class DelayLine:
    """A signal known at sample edges, read ``delay_samples`` (≥ 0, need not be whole) earlier."""

    def __init__(self, delay_samples: float) -> None:
        self._delay = delay_samples
        self._history: NDArray[np.float64] | None = None

    def push(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the next n values and return the n delayed ones."""
        if values.size == 0 or self._delay == 0.0:
            return values
        length = int(np.ceil(self._delay)) + 1
        if self._history is None:
            self._history = np.full(length, values[0])
        line = np.concatenate((self._history, values))
        position = np.arange(self._history.size, line.size) - self._delay
        self._history = line[-length:]
        return np.interp(position, np.arange(line.size), line)


def quantise(values: NDArray[np.float64], half_range: float, bits: int) -> NDArray[np.float64]:
    """Clip to ±half_range and round to the converter's steps."""
    step = 2 * half_range / 2**bits
    return np.clip(np.rint(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1) * step
