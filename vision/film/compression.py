"""How a film was compressed: the quantisation table of JPEG frames, or frames predicted from others.

JPEG (ITU-T T.81, annex A.3) stores every block of 8 x 8 pixels as cosine coefficients rounded to multiples of a table's
steps. What that adds to the error of an angle is in `vision.uncertainty.compression_noise`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ZIGZAG = sorted(
    ((row, column) for row in range(8) for column in range(8)),
    key=lambda at: (sum(at), at[0] if sum(at) % 2 else at[1]),
)
"""Rows and columns of the 64 coefficients in the order in which a file stores them (T.81, figure A.6)."""


@dataclass(frozen=True)
class Compression:
    """How a film was compressed.

    Attributes
    ----------
    steps : ndarray, shape (8, 8), or None
        Steps of the luminance table, grey, lowest frequency first; None when frames are predicted from others.
    """

    steps: NDArray[np.float64] | None


def jpeg_steps(data: bytes) -> NDArray[np.float64] | None:
    """Luminance steps of a JPEG picture, shape (8, 8); None when it holds no table."""
    at = data.find(b"\xff\xdb")
    if at < 0 or len(data) < at + 5:
        return None
    kind = np.dtype(">u2") if data[at + 4] >> 4 else np.dtype(np.uint8)
    if len(data) < at + 5 + 64 * kind.itemsize:
        return None
    values = np.frombuffer(data, dtype=kind, count=64, offset=at + 5)
    steps = np.empty((8, 8))
    for (row, column), value in zip(ZIGZAG, values, strict=True):
        steps[row, column] = value
    return steps
