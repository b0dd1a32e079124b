"""A contact sheet of the frames that a tracking fits worst: each with what is wrong, below a legend of the bodies.

Text stands in strips of its own, never over the picture. A result that does not belong to the film, or a path that
cannot be written, raises `VisionInputError`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body
from vision.film.source import FrameSource
from vision.output.colours import LOST, bgr, colour_of
from vision.output.outline_drawing import write_picture
from vision.output.overlay import OutlineDrawer
from vision.results.flags import FAILURE, FrameFlag
from vision.results.track_result import TrackResult

TILE_WIDTH_PX = 360
LINE_PX = 20
WHITE, GREY = (255, 255, 255), (170, 170, 170)
Picture = NDArray[Any]


def write_contact_sheet(
    path: str | os.PathLike[str],
    film: FrameSource,
    bodies: Sequence[Body],
    result: TrackResult,
    *,
    count: int = 12,
    columns: int = 3,
) -> list[int]:
    """Write one picture (PNG) with the worst frames: lost ones first, then those of the lowest correlation.

    Parameters
    ----------
    path : path
        Ends in ``.png``.
    film, bodies, result
        What was tracked and what came out.
    count : int
        Frames to show at most.
    columns : int
        Frames side by side.

    Returns
    -------
    list of int
        Frame numbers shown, worst first.

    Raises
    ------
    VisionInputError
        The result is of other outlines or another film.
    FilmError
        The file cannot be written.

    Examples
    --------
    >>> import vision
    >>> bodies = vision.load_bodies("bodies.toml")
    >>> result = vision.track("film.mraw", bodies, every=10)
    >>> with vision.open_film("film.mraw") as film:
    ...     len(vision.write_contact_sheet("worst.png", film, bodies, result, count=6))
    6
    """
    path = Path(path)
    draw = OutlineDrawer(film, bodies, result)
    rows = worst_rows(result, count)
    tiles = [_tile(draw.picture(row), words_of(result, row)) for row in rows]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    strips = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    write_picture(path, np.vstack([_legend(strips[0].shape[1], Path(result.film).name, result.bodies), *strips]))
    return [int(result.frame[row]) for row in rows]


def worst_rows(result: TrackResult, count: int) -> list[int]:
    """Rows of the result to inspect first: most bodies lost, then lowest correlation of any body.

    Neighbours show the same, so rows that are not lost and close to one already chosen come last.
    """
    return worst_of(result.failed, result.zncc, count)


def worst_of(failed: NDArray[np.bool_], zncc: NDArray[np.float64], count: int) -> list[int]:
    """`worst_rows` of a table: whether each body (m) is lost in each row (n), and its correlation, both (n, m)."""
    lost = failed.sum(axis=1)
    correlation = np.where(np.isfinite(zncc), zncc, 1.0).min(axis=1)
    order = np.lexsort((correlation, -lost))
    apart = lost.size // (4 * count)
    taken: list[int] = []
    later: list[int] = []
    for row in map(int, order):
        near = lost[row] == 0 and any(abs(row - other) <= apart for other in taken)
        (later if near else taken).append(row)
        if len(taken) == count:
            break
    return [*taken, *later][:count]


def words_of(result: TrackResult, row: int) -> tuple[str, str]:
    """Frame and time, and what is wrong: bodies lost with their reason, else the least correlation and its remarks."""
    first = f"frame {int(result.frame[row])}, {result.time_s[row] * 1e3:.2f} ms"
    lost = [
        f"{body} lost: {reasons(int(result.flag[row, i]) & int(FAILURE))}"
        for i, body in enumerate(result.bodies)
        if result.failed[row, i]
    ]
    if lost:
        return first, "; ".join(lost)
    worst = int(np.argmin(result.zncc[row]))
    remarks = reasons(int(result.flag[row, worst]))
    return first, f"{result.bodies[worst]} correlates {result.zncc[row, worst]:.3f}{', ' if remarks else ''}{remarks}"


def reasons(flag: int) -> str:
    """The bits of a flag in words."""
    return ", ".join(bit.name.lower().replace("_", " ") for bit in FrameFlag if bit and flag & bit and bit.name)


def _tile(picture: Picture, words: tuple[str, str]) -> Picture:
    """A frame, enlarged to a readable width, below two lines of text."""
    factor = max(1, -(-TILE_WIDTH_PX // picture.shape[1]))
    large = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    strip = np.zeros((2 * LINE_PX + 4, large.shape[1], 3), dtype=np.uint8)
    for line, (text, colour) in enumerate(zip(words, (WHITE, GREY), strict=True)):
        _write(strip, text, (6, (line + 1) * LINE_PX - 4), colour, 0.45)
    return np.vstack([strip, large])


def _legend(width: int, film: str, bodies: tuple[str, ...]) -> Picture:
    strip = np.zeros((LINE_PX + 8, width, 3), dtype=np.uint8)
    at = _write(strip, film, (6, LINE_PX), WHITE, 0.5)
    for i, body in enumerate(bodies):
        at = _write(strip, body, (at + 16, LINE_PX), bgr(colour_of(body, i)), 0.5)
    _write(strip, "lost", (at + 16, LINE_PX), bgr(LOST), 0.5)
    return strip


def _write(strip: Picture, text: str, place: tuple[int, int], colour: tuple[int, int, int], size: float) -> int:
    """Write text in a strip, smaller where it would not fit; returns where it ends."""
    plain = text.encode("ascii", "replace").decode()
    (wide, _), _ = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    room = strip.shape[1] - place[0] - 6
    size *= min(1.0, max(room, 10) / max(wide, 1))
    cv2.putText(strip, plain, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
    return place[0] + min(wide, room)
