"""Outlines drawn over a picture, and pictures written whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.atomic_write import whole_file
from vision.bodies.outlines import Body
from vision.errors import FilmError

MIN_WIDTH_PX = 800


def draw_bodies(picture: NDArray[Any], bodies: Sequence[Body], bit_depth: int) -> NDArray[np.uint8]:
    """Draw outlines and names over a picture.

    Parameters
    ----------
    picture : ndarray, shape (height, width)
    bodies : sequence of Body
    bit_depth : int
        Of the picture's grey values.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        Colour in the order of OpenCV, enlarged to a width of at least 800 px.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     drawn = vision.draw_bodies(film.read(0), vision.load_bodies("bodies.toml"), film.bit_depth)
    >>> drawn.shape[1] >= 800
    True
    """
    grey = (np.asarray(picture, dtype=float) / 2.0 ** (bit_depth - 8)).clip(0, 255).astype(np.uint8)
    factor = max(1, -(-MIN_WIDTH_PX // grey.shape[1]))
    large = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    colour = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    for i, body in enumerate(bodies):
        hue = np.full((1, 1, 3), ((47 * i + 25) % 180, 220, 255), dtype=np.uint8)
        tint = tuple(int(v) for v in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
        points = np.rint((body.polygon_px + 0.5) * factor).astype(np.int32)
        cv2.polylines(colour, [points], True, tint, 2, cv2.LINE_AA)
        x, y = (int(v) for v in points.mean(axis=0))
        for shade, width in (((0, 0, 0), 4), (tint, 1)):
            cv2.putText(colour, body.name, (x - 24, y), cv2.FONT_HERSHEY_SIMPLEX, 0.6, shade, width, cv2.LINE_AA)
    return np.asarray(colour, dtype=np.uint8)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture as PNG: whole or not at all.

    Parameters
    ----------
    path : Path
    picture : ndarray of uint8, shape (h, w) or (h, w, 3)
        Grey, or colour in the order of OpenCV.

    Raises
    ------
    FilmError
        The picture cannot be encoded.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import vision
    >>> vision.write_picture(Path("grey.png"), np.full((48, 64), 128, np.uint8))
    """
    ok, data = cv2.imencode(".png", picture)
    if not ok:
        raise FilmError(f"{path}: the picture cannot be encoded as PNG")
    with whole_file(path, FilmError, "check the folder") as temporary:
        temporary.write_bytes(data.tobytes())
