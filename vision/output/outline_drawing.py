"""Frames of a film with a grid in film pixels, to draw outlines on; pictures written whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.errors import FilmError
from vision.files import whole_file
from vision.film.source import FrameSource

MIN_WIDTH_PX = 800
MARGIN_PX = 44
SCALE_STEP_PX = 60  # least distance of two numbers along a side
WHITE = (255, 255, 255)
Colour = tuple[int, int, int]
"""Blue, green, red."""
GRID = (0, 220, 255)


def _draw_with_scales(picture: ArrayLike, bit_depth: int) -> NDArray[Any]:
    """A grey frame of ``bit_depth`` bits in colour (blue, green, red), enlarged to at least `MIN_WIDTH_PX`, with scales
    of film pixels above and at its left and a grid."""
    grey = grey_picture(picture, bit_depth)
    factor = max(1, -(-MIN_WIDTH_PX // grey.shape[1]))
    large = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    colour: NDArray[Any] = cv2.copyMakeBorder(
        cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), MARGIN_PX, 0, MARGIN_PX, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0)
    )
    _draw_scales(colour, grey.shape, factor)
    return colour


def grey_picture(picture: ArrayLike, bit_depth: int) -> NDArray[np.uint8]:
    grey = as_numbers(picture, "picture", 2)
    if not np.isfinite(grey).all():
        raise FilmError("picture: found grey values that are not finite, allowed finite ones")
    return np.asarray((grey / 2.0 ** (bit_depth - 8)).clip(0, 255).astype(np.uint8))


def _draw_scales(picture: NDArray[Any], shape: tuple[int, ...], factor: int) -> None:
    """Draw scales of film pixels along the upper and left side of ``picture``, and a grid into it; it shows a frame of
    ``shape`` enlarged by ``factor``."""
    step = next(step for step in (10, 20, 50, 100, 200, 500, 1000) if step * factor >= SCALE_STEP_PX or step == 1000)
    for along, size in enumerate((shape[1], shape[0])):
        for value in range(0, size, step):
            at = int((value + 0.5) * factor) + MARGIN_PX
            place = (at, MARGIN_PX) if along == 0 else (MARGIN_PX, at)
            tick = (at, MARGIN_PX - 5) if along == 0 else (MARGIN_PX - 5, at)
            cv2.line(picture, place, tick, WHITE, 1)
            end = (at, picture.shape[0] - 1) if along == 0 else (picture.shape[1] - 1, at)
            line = picture.copy()
            cv2.line(line, place, end, GRID, 1)
            picture[:] = cv2.addWeighted(picture, 0.6, line, 0.4, 0.0)
            _draw_text(
                picture, str(value), *((at, MARGIN_PX - 14) if along == 0 else (MARGIN_PX // 2 - 2, at)), WHITE, 0.4
            )
    _draw_text(picture, "px", MARGIN_PX // 2 - 2, MARGIN_PX - 14, WHITE, 0.4)


def _draw_text(picture: NDArray[Any], text: str, x: int, y: int, colour: Colour, size: float) -> None:
    """Draw text centred on a point (x, y), px, moved into the picture, with a dark rim."""
    wide, high = text_size(text, size)
    at = (
        min(max(x - wide // 2, 2), picture.shape[1] - wide - 2),
        min(max(y + high // 2, high + 2), picture.shape[0] - 4),
    )
    put_text(picture, text, at, colour, size, rim=4)


def text_size(text: str, size: float) -> tuple[int, int]:
    (wide, high), _ = cv2.getTextSize(text.encode("ascii", "replace").decode(), cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    return wide, high


def put_text(picture: NDArray[Any], text: str, at: tuple[int, int], colour: Colour, size: float, rim: int = 0) -> None:
    """Text from a point, its lower left corner, on; a dark rim keeps it readable on any grey."""
    plain = text.encode("ascii", "replace").decode()
    for shade, width in [((0, 0, 0), rim)] * bool(rim) + [(colour, 1)]:
        cv2.putText(picture, plain, at, cv2.FONT_HERSHEY_SIMPLEX, size, shade, width, cv2.LINE_AA)


def write_picture(path: Path, picture: ArrayLike) -> None:
    """Write a picture, grey (h, w) or blue, green, red (h, w, 3), from 0 to 255, as PNG in place of a file that is
    there, whole or not at all.

    Parameters
    ----------
    path : Path
    picture : array_like of uint8, shape (h, w) or (h, w, 3)
        Grey, or colour in the order of OpenCV.

    Raises
    ------
    VisionInputError
        No numbers from 0 to 255; a `FilmError` where the picture cannot be encoded or written.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import vision
    >>> vision.write_picture(Path("grey.png"), np.full((48, 64), 128, np.uint8))
    """
    grey = as_numbers(picture, f"{path}: picture", dtype=np.uint8)
    if grey.ndim not in (2, 3) or 0 in grey.shape or grey.shape[2:] not in ((), (3,)):
        raise FilmError(f"{path}: found a picture of shape {grey.shape}, allowed (h, w) or (h, w, 3)")
    ok, data = cv2.imencode(".png", grey)
    if not ok:
        raise FilmError(f"{path}: the picture cannot be encoded as PNG")
    with whole_file(path, FilmError, "check the folder") as temporary:
        temporary.write_bytes(data.tobytes())


COLUMNS = 2
TITLE_PX = 26


def draw_frames(film: FrameSource, count: int = 4) -> NDArray[np.uint8]:
    """Picture (h, w, 3; blue, green, red) of ``count`` frames spread over a film, the first among them, with scales and
    a grid in film pixels, from which to read the outlines of its bodies.

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
        drawn = _draw_with_scales(film.read(int(index)), film.bit_depth)
        title = np.zeros((TITLE_PX, drawn.shape[1], 3), dtype=np.uint8)
        words = f"frame {index}" + (" (outlines are drawn on this one)" if index == 0 else "")
        put_text(title, words, (8, TITLE_PX - 8), WHITE, 0.5)
        tiles.append(np.vstack([title, drawn]))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    strips = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    return np.asarray(np.vstack(strips), dtype=np.uint8)
