"""A quick walk through a film, to know where the bodies are at the beginning of each of its stretches.

Bodies are fitted by the pixels that tell most, in as few frames as their motion allows: the steps grow while they are
where they were expected and are halved where a body is not found. What it finds is only where a stretch starts from;
the stretch before confirms it (`vision.tracking.stretches`). Where a body is lost even from one row to the next the
walk ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.fitting.template import thinned
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE
from vision.tracking.film_tracker import FilmTracker

PIXELS = 1500
MOST_ROWS = 16
NEAR_PX, FAR_PX = 1.0, 4.0
"""Distance from the expected place below which the steps grow, and above which they shrink."""

Poses = NDArray[np.float64]
"""Of all bodies, (m, 3)."""


def starts(ready: PreparedFilm, frame: NDArray[np.int64], rows: Sequence[int]) -> Iterator[tuple[Poses, Poses]]:
    """Poses in the two rows before each of ``rows``, in order, as far as the walk gets; ``frame`` (n,) of every row."""
    templates = [thinned(template, PIXELS) for template in ready.templates]
    light = replace(ready, templates=templates, occlusion=ready.occlusion.with_templates(templates))
    walk = _Walk(FilmTracker(light), frame)
    for row in rows:
        if not walk.to(row - 2):
            return
        before = walk.pose
        if not walk.to(row - 1):
            return
        yield before, walk.pose


class _Walk:
    """Where the walk is: ``row``, the ``pose`` of all bodies, and how far they move per row."""

    def __init__(self, tracker: FilmTracker, frame: NDArray[np.int64]) -> None:
        self._tracker, self._frame = tracker, frame
        self._radius = np.array([body.template.radius_px for body in tracker.trackers])
        self.row, self.pose = 0, np.zeros((len(tracker.trackers), 3))
        self._speed, self._stride = np.zeros_like(self.pose), 4

    def to(self, row: int) -> bool:
        """Go on to a row; False where a body is lost."""
        while self.row < row:
            step = min(self._stride, row - self.row)
            expected = self.pose + step * self._speed
            found = self._fit(int(self._frame[self.row + step]), expected)
            if found is None:
                if step == 1:
                    return False
                self._stride = max(1, step // 2)
                continue
            off = np.abs(found - expected)
            off[:, 0] *= self._radius
            if off.max() < NEAR_PX:
                self._stride = min(2 * self._stride, MOST_ROWS)
            elif off.max() > FAR_PX:
                self._stride = max(1, self._stride // 2)
            self._speed, self.pose = (found - self.pose) / step, found
            self.row += step
        return True

    def _fit(self, index: int, expected: Poses) -> Poses | None:
        """Poses of all bodies in a frame, None where one is not found."""
        tracker = self._tracker
        tracker.place(-1, expected)
        tracker.step(index, 0, search=False)
        if any(body.flag & FAILURE for body in tracker.trackers):
            return None
        return np.array([body.fit.pose for body in tracker.trackers])
