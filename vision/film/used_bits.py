"""Detect how many of 16 stored bits a film uses, at either end.

Where white is must be known, since what is saturated says nothing of the light. Formats without a header of the camera
do not tell.
"""

from __future__ import annotations

import numpy as np

from vision.errors import FilmError
from vision.film.source import Film

STORED_BITS = 16  # of a file whose white is looked for
DEPTHS = (12, 14)
"""Of cameras that fill 16 bits from below; 10 only where its white occurs, since dim films of 12 look the same."""
UNUSED_LOW_BITS = (6, 4, 2)  # of cameras that fill 16 bits from above
SATURATED_PIXELS = 4  # equal to the white of 10 bit, from which it is believed


def find_white(film: Film) -> None:
    """Set ``bit_depth`` (fewer bits used) or ``white_grey`` (lower bits unused) of a film stored in 16 bits by the grey
    values of its first, middle and last frame, or of its first only where frames are decoded in order."""
    if film.bit_depth != STORED_BITS or film.white_grey is not None:
        return
    used, most, n_white_of_10 = 0, 0, 0
    for index in (0,) if film.in_order else sorted({0, film.n_frames // 2, film.n_frames - 1}):
        try:
            grey = film.read(index)
        except FilmError:
            continue  # said when the frame is asked for
        used |= int(np.bitwise_or.reduce(grey, axis=None))
        most = max(most, int(grey.max()))
        n_white_of_10 += int(np.count_nonzero(grey == 1023))
    if not most:
        return
    if most == 1023 and n_white_of_10 >= SATURATED_PIXELS:
        film.bit_depth = 10  # bits
        return
    for depth in DEPTHS:
        if most < 1 << depth:
            film.bit_depth = depth
            return
    for low in UNUSED_LOW_BITS:
        if used & ((1 << low) - 1) == 0:
            film.white_grey = ((1 << (STORED_BITS - low)) - 1) << low
            return
