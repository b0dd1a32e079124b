"""A film to check a tracking by eye: its frames with the outlines at the poses found.

Drawn with OpenCV: the outlines are moved to the poses found; a body lost in a frame is drawn red where it was last
seen. A result that does not belong to the film, or a path that cannot be written, raises `VisionInputError`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
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
from vision.output.colours import LOST, bgr, colour_of
from vision.results.track_result import TrackResult

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
    draw = OutlineDrawer(film, bodies, result)
    rows = range(0, result.frame.size, every)

    def pictures() -> Iterator[NDArray[Any]]:
        for row in rows:
            picture = draw.picture(row)
            words = f"{int(result.frame[row])}  {result.time_s[row] * 1e3:.2f} ms"
            _write(picture, words, 0, (255, 255, 255))
            for i, body in enumerate(result.bodies):
                lost = bool(result.failed[row, i])
                _write(picture, f"{body} lost" if lost else body, i + 1, bgr(LOST if lost else colour_of(body, i)))
            yield picture

    report = None if progress is None else (lambda done: progress(done, len(rows)))
    return write_avi(path, pictures(), playback_hz, quality=90, progress=report)


def _write(picture: NDArray[Any], text: str, line: int, colour: tuple[int, int, int]) -> None:
    """A line of text in the upper left corner, with a dark rim that keeps it readable on any grey."""
    for shade, width in (((0, 0, 0), 3), (colour, 1)):
        at = (4, 12 + 14 * line)
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, shade, width, cv2.LINE_AA)


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
            tint = bgr(LOST if lost else colour_of(result.bodies[i], i))
            cv2.polylines(colour, [whole], True, tint, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        return colour
