"""Single pixels of the sensor that are always bright or always dark, replaced by their neighbours.

In the reference such a pixel has by far the steepest slopes, which do not move with the body: the fit is held back and
thinks itself more certain than it is. A pixel is taken for a defect where it differs from its neighbours by far more
than pixels do, in the same sense in frames from all over the film. A film without any is not touched.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import Film, FrameSource

FAR = 2.5
"""Difference from the median of three by three, over that which 98 of 100 pixels do not reach."""
LEAST_GREY = 12.0
"""Smallest such difference, of 255."""
FRAMES, AGREE = 6, 5
"""Frames that are looked at, and how many must show a defect."""
MOST_SHARE = 0.01
"""Of all pixels; more are a texture, not defects."""
NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=np.uint8)
"""A defect stands alone: beyond every one of them by half as much as beyond their median."""
AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class WithoutDefects(Film):
    """A film whose defect pixels (rows, columns) have the median grey value of their neighbours."""

    def __init__(self, film: FrameSource, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> None:
        self.film, self.rows, self.columns = film, rows, columns
        self.path, self.n_frames, self.height, self.width = film.path, film.n_frames, film.height, film.width
        self.bit_depth, self.frame_rate_hz, self.exposure_s = film.bit_depth, film.frame_rate_hz, film.exposure_s
        self.compression = film.compression
        self.in_order = getattr(film, "in_order", True)

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """As of the film."""
        return self.film.frame_time_s

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        return self.read_region(index, 0, self.height, 0, self.width)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame."""
        grey = np.array(self.film.read_region(index, y0, y1, x0, x1))
        inside = (self.rows >= y0) & (self.rows < y1) & (self.columns >= x0) & (self.columns < x1)
        rows, columns = self.rows[inside] - y0, self.columns[inside] - x0
        if rows.size:
            last_y, last_x = grey.shape[0] - 1, grey.shape[1] - 1
            near = [grey[np.clip(rows + dy, 0, last_y), np.clip(columns + dx, 0, last_x)] for dy, dx in AROUND]
            grey[rows, columns] = np.median(np.stack(near), axis=0)
        return grey


def without_defects(film: FrameSource) -> FrameSource:
    """The film itself, or less its defect pixels where it has any."""
    first = _apart(film.read(0), film.bit_depth)
    count = np.count_nonzero(first)
    if not 0 < count <= MOST_SHARE * first.size:
        return film
    # of a film that must be decoded in order only the beginning is near
    last = FRAMES - 1 if getattr(film, "in_order", True) else film.n_frames - 1
    frames = np.unique(np.linspace(0, min(last, film.n_frames - 1), FRAMES).astype(int))
    alike = sum((_apart(film.read(int(k)), film.bit_depth) == first).astype(int) for k in frames)
    rows, columns = np.nonzero((first != 0) & (alike >= min(AGREE, frames.size)))
    return WithoutDefects(film, rows, columns) if rows.size else film


def _apart(frame: NDArray[Any], bit_depth: int) -> NDArray[np.int8]:
    """1 where a pixel is far brighter than its neighbours, -1 where far darker, else 0."""
    grey = np.ascontiguousarray(frame)
    if grey.dtype not in (np.uint8, np.uint16):
        return np.zeros(grey.shape, dtype=np.int8)
    off = grey.astype(np.int32) - cv2.medianBlur(grey, 3)
    above, below = (
        grey.astype(np.int32) - cv2.dilate(grey, NEIGHBOURS),
        cv2.erode(grey, NEIGHBOURS) - grey.astype(np.int32),
    )
    limit = max(FAR * float(np.percentile(np.abs(off), 98.0)), LEAST_GREY * 2.0 ** (bit_depth - 8))
    bright, dark = (off > limit) & (above > 0.5 * limit), (off < -limit) & (below > 0.5 * limit)
    return bright.astype(np.int8) - dark.astype(np.int8)
