"""Pictures to check a tracking by eye: an overlay film, and a contact sheet of the worst frames.

Drawn with OpenCV: the outlines are moved to the poses found; a body lost in a frame is drawn red where it was last
seen. A result that does not belong to the film, or a path that cannot be written, raises `VisionInputError`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.angles import ccw_to_picture
from vision.bodies.masks import build_masks
from vision.bodies.outlines import Body
from vision.errors import VisionInputError
from vision.film.avi_writer import write_avi
from vision.film.source import FrameSource
from vision.output.outline_drawing import write_picture
from vision.results.track_result import TrackResult

COLOURS = ((0, 220, 255), (120, 255, 60), (255, 180, 40), (255, 80, 255), (200, 200, 200))
LOST = (60, 60, 255)
SUBPIXEL_BITS = 4


def write_overlay(
    path: str | os.PathLike[str],
    film: FrameSource,
    bodies: Sequence[Body],
    result: TrackResult,
    *,
    every: int = 1,
    playback_hz: float = 25.0,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write an AVI (MJPEG) of the film with the tracked outlines drawn in.

    Parameters
    ----------
    path : path
        Ends in ``.avi``.
    film, bodies, result
        What was tracked and what came out.
    every : int
        Show one tracked frame out of this many.
    playback_hz : float
    progress : callable, optional
        Called with (frames done, frames in all).

    Returns
    -------
    int
        Number of frames written.

    Examples
    --------
    >>> import vision
    >>> bodies = vision.load_bodies("bodies.toml")
    >>> result = vision.track("film.mraw", bodies, every=10)
    >>> with vision.open_film("film.mraw") as film:
    ...     vision.write_overlay("tracked.avi", film, bodies, result)
    15
    """
    draw = _Drawer(film, bodies, result)
    rows = range(0, result.frame.size, every)

    def pictures() -> Iterator[NDArray[Any]]:
        for row in rows:
            yield draw.picture(row)

    report = None if progress is None else (lambda done: progress(done, len(rows)))
    return write_avi(path, pictures(), playback_hz, quality=90, progress=report)


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
    draw = _Drawer(film, bodies, result)
    rows = worst_rows(result, count)
    tiles = [draw.picture(row) for row in rows]
    blank = np.zeros_like(tiles[0])
    tiles += [blank] * (-len(tiles) % columns)
    sheet = np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])
    write_picture(path, sheet)
    return [int(result.frame[row]) for row in rows]


def worst_rows(result: TrackResult, count: int) -> list[int]:
    """Rows of the result to inspect first: most bodies lost, then lowest correlation of any body.

    Neighbours show the same, so rows that are not lost and close to one already chosen come last.
    """
    lost = result.failed.sum(axis=1)
    correlation = np.where(np.isfinite(result.zncc), result.zncc, 1.0).min(axis=1)
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


class _Drawer:
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
        """Frame of a row of the result in colour, shape (height, width, 3)."""
        result, film = self._result, self._film
        frame = film.read(int(result.frame[row]))
        grey = (frame >> max(0, film.bit_depth - 8)).astype(np.uint8) if frame.dtype != np.uint8 else frame
        colour = cv2.cvtColor(np.ascontiguousarray(grey), cv2.COLOR_GRAY2BGR)
        for i, shape in enumerate(self._shapes):
            lost = bool(result.failed[row, i])
            before = self._found[i][self._found[i] <= row]
            if before.size == 0:
                continue
            at = int(before[-1])
            phi = float(ccw_to_picture(result.angle_rad[at, i]))
            c, s = np.cos(phi), np.sin(phi)
            points = shape @ np.array([[c, s], [-s, c]]) + (result.x_px[at, i], result.y_px[at, i])
            whole = np.rint(points * 2**SUBPIXEL_BITS).astype(np.int32)
            tint = LOST if lost else COLOURS[i % len(COLOURS)]
            cv2.polylines(colour, [whole], True, tint, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        words = f"{int(result.frame[row])}  {result.time_s[row] * 1e3:.2f} ms"
        cv2.putText(colour, words, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
        return colour
