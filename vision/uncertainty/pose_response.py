"""What a distorted or tilted picture does to a tracked pose.

Method: the fit gives the pose that is nearest to the true displacement of the pixels in the sense of its own
normal equations, ``delta = N^-1 sum J (grad I . d)``, with the displacement d that no rigid motion in the
picture explains. d is smooth, so the sums over pixels are made once per cell of `CELL_PX` and serve all
frames. First order in d: a camera tilted by 5 degrees is represented to 1 % of its effect (tested with
films).

Conventions: poses as in `vision.fitting.base`, shape (n, 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.camera.projection import Projection
from vision.fitting.template import Template

CELL_PX = 12
"""Error of the sums: at most 1 % of a tilt's effect, as with 8 px."""
CORRECTION_ROUNDS = 3
ROWS_AT_ONCE = 256
"""Poses worked on together: bounds the memory on a long film and stays in the processor's cache."""


class PoseResponse:
    """How the pose of one body follows small displacements of its pixels."""

    def __init__(self, template: Template) -> None:
        self.template = template
        offset = template.offset_px.astype(float)
        cell = np.floor_divide(offset - offset.min(axis=1, keepdims=True), CELL_PX).astype(int)
        number = cell[1] * (cell[0].max() + 1) + cell[0]
        _, place, count = np.unique(number, return_inverse=True, return_counts=True)
        self._at = np.stack([np.bincount(place, offset[k]) / count for k in range(2)], axis=-1)
        columns = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        influence = np.linalg.solve(template.normal, columns)[:3]
        # one (cells, 3) per axis: pose per displacement of a cell along x and along y
        self._gain_x, self._gain_y = (
            np.stack([np.bincount(place, influence[k] * columns[1 + axis]) for k in range(3)], axis=-1)
            for axis in range(2)
        )

    def error(self, camera: Projection, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tracked pose less the pose a perfect camera would give, shape (n, 3), in the body's own axes for the shift.

        ``pose`` is the motion seen by the perfect camera (to first order the tracked one); NaN stays NaN.
        """
        centre = np.array(self.template.centre_px)
        flat, flat_centre = camera.rectified(centre + self._at), camera.rectified(centre)
        result = np.empty((len(pose), 3))
        for start in range(0, len(pose), ROWS_AT_ONCE):
            rows = pose[start : start + ROWS_AT_ONCE]
            c, s = np.cos(rows[:, 0]), np.sin(rows[:, 0])
            moved_centre = centre + rows[:, 1:]
            apart = camera.seen(_moved(flat - flat_centre, c, s, camera.rectified(moved_centre)))
            apart -= _moved(self._at, c, s, moved_centre)
            result[start : start + ROWS_AT_ONCE] = self._of(apart, c, s)
        return result

    def read_late(
        self, pose: NDArray[np.float64], speed: NDArray[np.float64], rows_per_s: float
    ) -> NDArray[np.float64]:
        """Tracked pose less that at the time of the picture's first row, of pictures that are read row by row, (n, 3).

        ``speed`` (n, 3) is that of ``pose``, rad/s and px/s. A row is as late as its number over ``rows_per_s``, and
        what it shows has moved on by then.
        """
        centre = np.array(self.template.centre_px)
        result = np.empty((len(pose), 3))
        for start in range(0, len(pose), ROWS_AT_ONCE):
            rows, rate = pose[start : start + ROWS_AT_ONCE], speed[start : start + ROWS_AT_ONCE, :, None]
            c, s = np.cos(rows[:, 0]), np.sin(rows[:, 0])
            place = _moved(self._at, c, s, np.zeros((len(rows), 2)))
            late = (place[..., 1] + centre[1] + rows[:, 2:]) / rows_per_s
            x, y = rate[:, 1] - rate[:, 0] * place[..., 1], rate[:, 2] + rate[:, 0] * place[..., 0]
            result[start : start + ROWS_AT_ONCE] = self._of(late[..., None] * np.stack([x, y], axis=-1), c, s)
        return result

    def _of(self, apart: NDArray[np.float64], c: NDArray[np.float64], s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pose (n, 3), in the body's own axes for the shift, by displacements (n, cells, 2) in the picture's."""
        # summed along the picture's axes first, then turned into the template's: c and s leave the sum
        x, y = apart[..., 0], apart[..., 1]
        along = x @ self._gain_x + y @ self._gain_y
        across = y @ self._gain_x - x @ self._gain_y
        return c[:, None] * along + s[:, None] * across

    def without_error(self, camera: Projection, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn, rad, shape (n,), that a perfect camera would give for tracked poses."""
        turn = pose[:, 0].copy()
        for _ in range(CORRECTION_ROUNDS):
            turn = pose[:, 0] - self.error(camera, np.column_stack([turn, pose[:, 1:]]))[:, 0]
        return turn


def displacement(
    template: Template, camera: Projection, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far each template pixel is off a rigid motion at a pose (3,), px along the template's x and y, each (n,)."""
    centre, offset = np.array(template.centre_px), template.offset_px.T.astype(float)
    flat, flat_centre = camera.rectified(centre + offset), camera.rectified(centre)
    c, s, moved_centre = np.cos(pose[:1]), np.sin(pose[:1]), centre + pose[None, 1:]
    apart = camera.seen(_moved(flat - flat_centre, c, s, camera.rectified(moved_centre)))
    apart = (apart - _moved(offset, c, s, moved_centre))[0]
    return c * apart[:, 0] + s * apart[:, 1], c * apart[:, 1] - s * apart[:, 0]


def _moved(
    points: NDArray[np.float64], c: NDArray[np.float64], s: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points (k, 2) turned by each of n angles of cosine c and sine s and set on n centres (n, 2): shape (n, k, 2).

    One matrix product per coordinate; in memory all x stand before all y, which suits what follows.
    """
    basis = np.vstack([points.T, np.ones(len(points))])
    moved = np.empty((2, len(c), len(points)))
    np.matmul(np.column_stack([c, -s, centre[:, 0]]), basis, out=moved[0])
    np.matmul(np.column_stack([s, c, centre[:, 1]]), basis, out=moved[1])
    return np.moveaxis(moved, 0, -1)
