"""A curve as text: two by four dots per character cell (braille), or one by two where a terminal has no braille."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])


PLAIN = (" ", "'", ".", ":")


def curve(values: NDArray[np.float64], width: int = 72, height: int = 8, braille: bool = True) -> list[str]:
    """Draw evenly spaced values as ``height`` lines of ``width`` characters, minimum to maximum within each column.

    The lowest value is at the bottom, the highest at the top; a constant is a line in the middle. Without ``braille``
    the signs are ``'``, ``.`` and ``:``, the upper, the lower and both halves of a cell.
    """
    across, down = (2, 4) if braille else (1, 2)
    columns, rows = across * width, down * height
    low, high = float(np.min(values)), float(np.max(values))
    span = high - low
    cells = np.zeros((height, width), dtype=int)
    edges = np.linspace(0, values.size, columns + 1)
    for column in range(columns):
        first = min(int(edges[column]), values.size - 1)
        part = values[first : max(int(np.ceil(edges[column + 1])), first + 1)]
        ends = np.array([part.max(), part.min()])
        level = (high - ends) / span if span > 0 else np.array([0.5, 0.5])
        top, bottom = np.minimum((level * rows).astype(int), rows - 1)
        for row in range(top, bottom + 1):
            dot = DOTS[row % 4, column % 2] if braille else 1 + row % 2
            cells[row // down, column // across] |= int(dot)
    if not braille:
        return ["".join(PLAIN[cell] for cell in line) for line in cells]
    return ["".join(chr(0x2800 + int(cell)) for cell in line) for line in cells]
