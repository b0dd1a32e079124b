"""What shows a picture upright that is stored turned or mirrored: display matrices and TIFF's orientations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[Any]
Matrix = tuple[int, int, int, int]

MATRICES: dict[int, Matrix] = {
    **{2: (-1, 0, 0, 1), 3: (-1, 0, 0, -1), 4: (1, 0, 0, -1), 5: (0, 1, 1, 0)},
    **{6: (0, 1, -1, 0), 7: (0, -1, -1, 0), 8: (0, -1, 1, 0)},
}
"""Display matrices of TIFF's and EXIF's tag Orientation (TIFF 6.0, page 36), but for 1, which is upright."""


def interpret_display_matrix(matrix: Matrix) -> tuple[str, bool, Callable[[Picture], Picture] | None] | None:
    """What a display matrix (a, b, c, d), which shows a stored point (x, y) at (a x + c y, b x + d y), asks for: in
    words, whether rows become columns, the function that turns a picture upright (None: it is). None for a turn that is
    no right angle."""
    a, b, c, d = (int(np.sign(value)) for value in matrix)
    if a and d and not b and not c:
        if a > 0 and d > 0:
            return "as it is", False, None
        words = {(-1, -1): "turned by 180 deg", (-1, 1): "mirrored", (1, -1): "mirrored top to bottom"}[a, d]
        return words, False, lambda grey: grey[::d, ::a]
    if b and c and not a and not d:
        words = {(1, -1): "turned clockwise", (-1, 1): "turned counter-clockwise"}.get((b, c), "turned and mirrored")
        return words, True, lambda grey: grey.T[::b, ::c]
    return None
