"""What both film writers ask of a frame before they store it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.errors import FilmError, VisionInputError


def check_frame(
    path: Path, frame: ArrayLike, shape: tuple[int, ...] | None, bit_depth: int, number: int, colour: bool = False
) -> NDArray[Any]:
    """A frame that fits the film, as whole numbers; ``shape`` is that of the first frame, None for the first itself.

    Raises
    ------
    FilmError
        The frame has another shape, is not of whole numbers, or exceeds ``bit_depth`` bits.
    """
    if not (isinstance(frame, np.ndarray) and frame.dtype.kind in "iu"):
        try:
            frame = as_numbers(frame, f"{path}: frame {number}", dtype=np.int64)
        except VisionInputError as error:
            raise FilmError(str(error)) from None
    if shape is not None and frame.shape != shape:
        raise FilmError(f"{path}: frame {number} has shape {frame.shape}, the first has {shape}")
    if shape is None and (frame.ndim not in (2, 3) or 0 in frame.shape or frame.shape[2:] not in ((), (3,) * colour)):
        raise FilmError(f"{path}: frame {number} has shape {frame.shape}, needs (height, width)")
    top = (1 << bit_depth) - 1
    if 8 * frame.dtype.itemsize > bit_depth or frame.dtype.kind == "i":
        low, high = int(frame.min()), int(frame.max())
        if low < 0 or high > top:
            raise FilmError(f"{path}: frame {number} holds {low}..{high}, {bit_depth} bit hold 0..{top}")
    return frame
