"""Frames of a film as they lie in memory or in a mapped file, for compiled code that reads them itself."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.film.repeats import Repeats
from vision.film.source import FrameSource

MOST_ROWS = 16
"""Tracked by one compiled call, so that it is heard soon when a run is to end."""
MOST_BYTES = 32 * 1024 * 1024
NEVER = 2**62


class Watch(NamedTuple):
    """Which frames compiled code must not take for new ones: from frame ``first`` on those whose pixels x0 .. x1 - 1 of
    row y, ``line`` (y, x0, x1), are those of the frame before; ``n_still`` frames at the start are at rest."""

    n_still: int
    first: int
    line: tuple[int, int, int]


def watch(repeats: Repeats, n_still: int) -> Watch:
    """What finds the frames that are to be looked at for repeating the one before."""
    return Watch(n_still, max(n_still, 1) if repeats.meaningful else NEVER, repeats.line)


def frames_around(film: FrameSource, index: NDArray[np.int64]) -> tuple[int, NDArray[Any], int] | None:
    """Frames that hold those numbered ``index`` (n,) and the one before each: number of the first, frames read-only,
    and how many of ``index`` they hold; None of a film whose frames do not lie in memory as they are read."""
    # a class that only inherits this may read differently
    if "frames" not in type(film).__dict__ or not index.size:
        return None
    frame_bytes, first = film.width * film.height * (2 if film.bit_depth > 8 else 1), max(int(index[0]) - 1, 0)
    within = int(np.searchsorted(index, first + max(MOST_BYTES // frame_bytes, 2)))
    n = min(within, MOST_ROWS, index.size)
    found = film.frames(first, int(index[n - 1]) + 1) if n else None  # type: ignore[attr-defined]
    return None if found is None else (first, found, n)
