"""Contact sheets of the worst frames, with the tracked outlines."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.angles import ccw_to_picture
from vision.bodies.masks import build_masks
from vision.bodies.outlines import Body
from vision.errors import VisionInputError
from vision.film.source import FrameSource
from vision.output.colours import LOST, body_colour, to_bgr
from vision.output.outline_drawing import WHITE, grey_picture, put_text, text_size, write_picture
from vision.results.flags import FAILURE, FrameFlag
from vision.results.track_result import TrackResult

SUBPIXEL_BITS = 4


class OutlineDrawer:
    """Draws the outlines of one result into frames of its film."""

    def __init__(self, film: FrameSource, bodies: Sequence[Body], result: TrackResult) -> None:
        if tuple(body.name for body in bodies) != result.bodies:
            raise VisionInputError(
                f"{film.path}: the result is of {', '.join(result.bodies)}, the outlines of "
                f"{', '.join(body.name for body in bodies)}; give those that were tracked"
            )
        if result.frame.size and int(result.frame.max()) >= film.n_frames:
            raise VisionInputError(
                f"{film.path}: has {film.n_frames} frames, the result goes to {int(result.frame.max())}"
            )
        self._film, self._result = film, result
        self._shapes = []
        for body, mask in zip(bodies, build_masks(bodies, film.height, film.width), strict=True):
            rows, cols = np.nonzero(mask)
            self._shapes.append(body.polygon_px - (cols.mean(), rows.mean()))
        self._found = [np.flatnonzero(np.isfinite(result.angle_rad[:, i])) for i in range(len(bodies))]

    def picture(self, row: int) -> NDArray[Any]:
        """Frame of a row of the result in colour (blue, green, red), (height, width, 3), with the bodies' outlines as
        tracked; those of a lost body where it was found last, in the colour `LOST`."""
        result, film = self._result, self._film
        colour = cv2.cvtColor(grey_picture(film.read(int(result.frame[row])), film.bit_depth), cv2.COLOR_GRAY2BGR)
        for i, shape in enumerate(self._shapes):
            lost = bool(result.is_lost[row, i])
            before = self._found[i][self._found[i] <= row]
            if before.size == 0:
                continue
            at = int(before[-1])
            phi = float(ccw_to_picture(result.angle_rad[at, i]))
            c, s = np.cos(phi), np.sin(phi)
            # a rigid turn is one of square pixels
            square = np.array([result.info.get("pixel_aspect", 1.0), 1.0])
            turned = (shape * square) @ np.array([[c, s], [-s, c]]) / square
            points = turned + (result.x_px[at, i], result.y_px[at, i])
            whole = np.rint(points * 2**SUBPIXEL_BITS).astype(np.int32)
            tint = to_bgr(LOST if lost else body_colour(result.bodies[i], i))
            cv2.polylines(colour, [whole], True, tint, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        return colour


TILE_WIDTH_PX = 360
LINE_PX = 20
GREY = (170, 170, 170)
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
    """Write a PNG of at most ``count`` frames, ``columns`` side by side, with the tracked outlines: those with most
    bodies lost first, then those of the lowest correlation; returns their numbers in this order.

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
    rows = select_worst_rows(result.is_lost, result.zncc, count)
    tiles = [_tile(draw.picture(row), describe_row(result, row)) for row in rows]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    strips = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    write_picture(path, np.vstack([_legend(strips[0].shape[1], Path(result.film).name, result.bodies), *strips]))
    return [int(result.frame[row]) for row in rows]


def select_worst_rows(failed: NDArray[np.bool_], zncc: NDArray[np.float64], count: int) -> list[int]:
    """Rows to inspect first, at most ``count``, worst first: most bodies lost (``failed`` (n, m)), then lowest
    correlation (``zncc`` (n, m)) of any body; rows that are not lost and near one chosen already come last.

    Neighbours show the same.
    """
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


def describe_row(result: TrackResult, row: int) -> tuple[str, str]:
    first = f"frame {int(result.frame[row])}, {result.time_s[row] * 1e3:.2f} ms"
    return first, describe_problems(result.bodies, result.flag[row], result.zncc[row])


def describe_problems(names: Sequence[str], flag: NDArray[np.integer], zncc: NDArray[np.float64]) -> str:
    """In words, of one frame: each body lost and why, else the body of least correlation with its remarks; by flags
    `FrameFlag` and correlations (m,) of the bodies ``names``."""
    failures = zip(names, (int(one) & int(FAILURE) for one in flag), strict=True)
    if lost := [f"{name} lost: {flag_texts(failure)}" for name, failure in failures if failure]:
        return "; ".join(lost)
    worst = int(np.argmin(zncc))
    remarks = flag_texts(int(flag[worst]))
    return f"{names[worst]} correlates {zncc[worst]:.3f}{', ' if remarks else ''}{remarks}"


def flag_texts(flag: int) -> str:
    return ", ".join(bit.name.lower().replace("_", " ") for bit in FrameFlag if bit and flag & bit and bit.name)


def _tile(picture: Picture, lines: tuple[str, str]) -> Picture:
    """A frame (height, width, 3), enlarged by a whole number to a readable width, below two lines of text."""
    factor = max(1, -(-TILE_WIDTH_PX // picture.shape[1]))
    large = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    strip = np.zeros((2 * LINE_PX + 4, large.shape[1], 3), dtype=np.uint8)
    for line, (text, colour) in enumerate(zip(lines, (WHITE, GREY), strict=True)):
        _write_label(strip, text, (6, (line + 1) * LINE_PX - 4), colour, 0.45)
    return np.vstack([strip, large])


def _legend(width: int, film: str, bodies: tuple[str, ...]) -> Picture:
    strip = np.zeros((LINE_PX + 8, width, 3), dtype=np.uint8)
    at = _write_label(strip, film, (6, LINE_PX), WHITE, 0.5)
    for i, body in enumerate(bodies):
        at = _write_label(strip, body, (at + 16, LINE_PX), to_bgr(body_colour(body, i)), 0.5)
    _write_label(strip, "lost", (at + 16, LINE_PX), to_bgr(LOST), 0.5)
    return strip


def _write_label(strip: Picture, text: str, place: tuple[int, int], colour: tuple[int, int, int], size: float) -> int:
    """Write text in a strip, smaller where it would not fit; returns where it ends."""
    wide, _ = text_size(text, size)
    room = strip.shape[1] - place[0] - 6
    size *= min(1.0, max(room, 10) / max(wide, 1))
    put_text(strip, text, place, colour, size)
    return place[0] + min(wide, room)
