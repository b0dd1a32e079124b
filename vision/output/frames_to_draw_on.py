"""Frames of a film as a person draws outlines on them: several, with film pixels along their sides and a grid."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.output.outline_drawing import draw_bodies

COLUMNS = 2
WHITE = (255, 255, 255)
TITLE_PX = 26


def draw_frames(film: FrameSource, count: int = 4) -> NDArray[np.uint8]:
    """Frames spread over a film, from which to read the outlines of its bodies.

    Parameters
    ----------
    film : FrameSource
    count : int
        Frames shown, the first among them, on which outlines are drawn.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        Colour in the order of OpenCV: two frames side by side, each with its number above it, scales in film pixels and
        a grid.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     drawn = vision.draw_frames(film)
    >>> drawn.shape[2]
    3
    """
    chosen = np.unique(np.linspace(0, film.n_frames - 1, count).astype(int))
    tiles = []
    for index in chosen:
        drawn = draw_bodies(film.read(int(index)), [], film.bit_depth, grid=True)
        title = np.zeros((TITLE_PX, drawn.shape[1], 3), dtype=np.uint8)
        words = f"frame {index}" + (" (outlines are drawn on this one)" if index == 0 else "")
        cv2.putText(title, words, (8, TITLE_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, WHITE, 1, cv2.LINE_AA)
        tiles.append(np.vstack([title, drawn]))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    strips = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    return np.asarray(np.vstack(strips), dtype=np.uint8)
