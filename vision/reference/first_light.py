"""Detect first frames whose exposure differs from the following ones: a lamp or shutter that starts, a flash.

The template is the mean of the first frames, so that one without light, or with so much that it is clipped, spoils
every angle. Method: each of the first frames is regressed on the median picture of the first `FIRST_FRAMES`, inside the
outlines; the slope is its gain. The tracker follows gains up to `MOST_GAIN`; beyond them a frame is of another light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.errors import TrackingError
from vision.film.source import FIRST_FRAMES, SATURATED_SHARE, FrameSource, saturated_grey
from vision.reference.still_average import MOST_PIXELS

MOST_GAIN = 2.0
"""Of the light of a frame, or of a part of a body, and its inverse: beyond it something else is seen, or too little:
one so dim has four times the variance."""


def check_first_light(film: FrameSource, region: NDArray[np.bool_]) -> None:
    """Raise `TrackingError`, with the numbers of the frames, for a film whose first frames are darker or brighter than
    those after in the pixels of ``region`` (height, width)."""
    n = min(FIRST_FRAMES, film.n_frames)
    if n < 3:
        return
    pixels = np.flatnonzero(region.reshape(-1))
    pixels = pixels[:: pixels.size // MOST_PIXELS + 1]
    grey = np.stack([film.read(k).reshape(-1)[pixels] for k in range(n)]).astype(float)
    usual = np.median(grey, axis=0)
    centred = usual - usual.mean()
    power = float(centred @ centred)
    if not power > 0.0:
        return
    gain = grey @ centred / power
    clipped = np.mean(grey >= saturated_grey(film), axis=1) - np.mean(usual >= saturated_grey(film))
    is_dark, is_bright = gain < 1.0 / MOST_GAIN, (gain > MOST_GAIN) | (clipped > SATURATED_SHARE)
    bad = is_dark | is_bright
    first = int(np.argmin(bad)) if not bad.all() else n
    if not first or first > n // 2:
        return
    which = "frame 0 is" if first == 1 else f"frames 0 to {first - 1} are"
    raise TrackingError(
        f"{film.path}: {which} {'flashed (too bright)' if is_bright[0] else 'dark'}: mean grey value "
        f"{grey[0].mean():.0f}, in the frames after {usual.mean():.0f}; leave them out (`first_frame` {first})"
    )
