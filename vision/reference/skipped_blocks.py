"""Whether a film has been compressed heavily, though its file does not say so.

Codecs that predict frames (MPEG-4, H.264) leave out squares of 16 pixels that hardly change: the next frame repeats
them byte for byte, however noisy the camera is, and what moves slowly is shown standing still, which no residual tells.
JPEG repeats squares of 8 pixels; four at once only where its quality is so low that the same care is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource

BLOCK_PX = 16
PAIRS = 8
TEXTURE_GREY = 3.0
"""Least standard deviation in a square that is looked at: flat ones may repeat."""
LEAST = 0.025
"""Share of repeated squares from which a codec is believed: MPEG-4 gave 0.04 to 0.2, JPEG of quality 50 and more 0."""
NOISY_GREY = 0.3
"""Below this noise pictures repeat by themselves."""


def skips_blocks(film: FrameSource, box: tuple[int, int, int, int], noise_grey: float) -> bool:
    """Whether frames repeat textured squares of the frame before, inside a rectangle (y0, y1, x0, x1)."""
    if film.compression is not None or noise_grey < NOISY_GREY or film.n_frames < 3:
        return False
    y0, x0 = (-(-edge // BLOCK_PX) * BLOCK_PX for edge in (box[0], box[2]))
    y1, x1 = (edge // BLOCK_PX * BLOCK_PX for edge in (box[1], box[3]))
    if y1 <= y0 or x1 <= x0:
        return False
    shares = []
    for index in np.unique(np.linspace(1, film.n_frames - 1, PAIRS).astype(int)):
        before, here = (film.read_region(int(k), y0, y1, x0, x1) for k in (index - 1, index))
        textured = _squares(here).std(axis=-1) > TEXTURE_GREY
        # a frame that is repeated as a whole tells nothing
        if textured.any() and not np.array_equal(before, here):
            shares.append(float(np.mean(_squares(np.equal(before, here))[textured].all(axis=-1))))
    return bool(shares) and float(np.mean(shares)) > LEAST


def _squares(picture: NDArray[Any]) -> NDArray[Any]:
    """Pixels of every square, (rows, columns, 256)."""
    rows, columns = (size // BLOCK_PX for size in picture.shape)
    squares = picture.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
    return squares.reshape(rows, columns, BLOCK_PX * BLOCK_PX)
