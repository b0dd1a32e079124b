"""Light that differs between the even and the odd rows of a frame, taken off before anything is fitted.

A camera that reads two half pictures one after the other sees a flickering lamp twice: even rows are brighter by some
per cent, or darker, another amount in each frame. No gain and no gradient follows that; it counts as noise, widens the
uncertainty and ends the still frames. Method: what rows differ by from the mean of their neighbours, regressed on that
mean, is the amplitude; texture adds the same to all frames at rest, so that a film is touched only where the amplitude
changes among its first frames by far more than pixels explain.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import Film, FrameSource, saturated_grey

FIRST = 8
"""Frames at the start that are looked at."""
SURE = 5.0
"""Scatter of the amplitude over its standard uncertainty from which it is believed."""
LEAST = 0.002
"""Smallest scatter that matters: a quarter of a grey level in a hundred."""
OUTLYING = 3.0
"""Pixels that differ by more than this many times the usual difference are texture, not flicker."""
ROUNDS = 3


class WithoutRowFlicker(Film):
    """A film whose even and odd rows are brought to the same light, frame by frame; saturated pixels stay so.

    Grey values are float32. ``box`` (y0, y1, x0, x1) is where the light is looked at.
    """

    def __init__(self, film: FrameSource, box: tuple[int, int, int, int]) -> None:
        self.film, self.box = film, box
        self.path, self.n_frames, self.height, self.width = film.path, film.n_frames, film.height, film.width
        self.bit_depth, self.frame_rate_hz, self.exposure_s = film.bit_depth, film.frame_rate_hz, film.exposure_s
        self.compression = film.compression
        self.in_order = getattr(film, "in_order", True)
        self._top = saturated_grey(film.bit_depth)
        self._amplitudes: dict[int, float] = {}

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """As of the film."""
        return self.film.frame_time_s

    def amplitude(self, index: int) -> float:
        """By how much the even rows of a frame are brighter than the mean of all, as a share."""
        if index not in self._amplitudes:
            grey = self.film.read_region(index, *self.box)
            self._amplitudes[index] = alternation(grey, self.box[0], self._top)[0]
        return self._amplitudes[index]

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        return self.read_region(index, 0, self.height, 0, self.width)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame."""
        grey = self.film.read_region(index, y0, y1, x0, x1)
        factor = (1.0 / (1.0 + self.amplitude(index) * even_rows(y0, y1))).astype(np.float32)
        return np.where(grey >= self._top, np.float32(self._top), grey * factor[:, None])


def without_row_flicker(film: FrameSource, box: tuple[int, int, int, int]) -> FrameSource:
    """The film itself, or with even light in its rows where that flickers inside a rectangle (y0, y1, x0, x1)."""
    if film.n_frames < 3 or box[1] - box[0] < 8:
        return film
    top = saturated_grey(film.bit_depth)
    frames = range(min(FIRST, film.n_frames))
    amplitude, u = np.array([alternation(film.read_region(k, *box), box[0], top) for k in frames]).T
    changing = float(np.std(amplitude))
    return WithoutRowFlicker(film, box) if changing > max(LEAST, SURE * float(u.max())) else film


def even_rows(y0: int, y1: int) -> NDArray[np.float64]:
    """1 for the even and -1 for the odd of rows ``y0..y1-1``."""
    return np.asarray(1.0 - 2.0 * (np.arange(y0, y1) % 2), dtype=np.float64)


def alternation(grey: NDArray[Any], first_row: int, top: int) -> tuple[float, float]:
    """Share by which the even rows of a rectangle are brighter than the mean of all, and its standard uncertainty.

    Pixels at or above ``top`` are left out. Zero and infinite where nothing can be said.
    """
    light = np.asarray(grey, dtype=np.float64)
    beside = light[:-2] + light[2:]
    # of a row and its neighbours, the mean does not change with the amplitude and the difference is all of it
    mean, off = 0.25 * (2.0 * light[1:-1] + beside), 0.25 * (2.0 * light[1:-1] - beside)
    off *= even_rows(first_row + 1, first_row + grey.shape[0] - 1)[:, None]
    below = light < top
    use = below[1:-1] & below[:-2] & below[2:] & (mean > 0.0)
    share = 0.0
    for _ in range(ROUNDS):
        left = off - share * mean
        near = use & (np.abs(left) <= OUTLYING * max(float(np.median(np.abs(left[use]))), 1e-9) if use.any() else use)
        power = float(np.sum(mean[near] ** 2))
        if not power > 0.0:
            return 0.0, float("inf")
        share = float(np.sum(mean[near] * off[near])) / power
    # row by row: what a row is read with is common to its pixels
    left = np.sum(np.where(near, mean * (off - share * mean), 0.0), axis=1)
    return share, float(np.sqrt(np.sum(left**2))) / power
