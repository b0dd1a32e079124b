"""From the plane of motion to the picture: a planar homography, then radial distortion.

Conventions: points (x, y) in pixels, y down. *Rectified* points are what a perfect camera, square to the
plane, would show; *seen* points are those of the film. About the picture's centre c: ``h = H (q - c)``
(homogeneous, 3 x 3), then ``p = c + h (1 + k |h|^2 / R^2)`` with R half the picture's diagonal, so that ``k``
is the displacement at the corner as a fraction of its distance. Brown's radial model with its first term;
the tilt is that of an ideal camera at a stated distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers, as_points
from vision.errors import VisionInputError

MAX_DISTORTION = 0.25


@dataclass(frozen=True)
class Projection:
    """How a camera shows the plane of motion.

    Parameters
    ----------
    width, height : int
        Of the picture, px.
    homography : ndarray, shape (3, 3)
        About the picture's centre, ``homography[2, 2] = 1``; the identity for a camera square to the plane.
    radial : float
        Displacement at the corner as a fraction of its distance from the centre; positive moves outwards.
    """

    width: int
    height: int
    homography: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    radial: float = 0.0

    def __post_init__(self) -> None:
        matrix = as_numbers(self.homography, "homography")
        if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)) or abs(np.linalg.det(matrix)) < 1e-12:
            raise VisionInputError("homography must be a finite, invertible 3 x 3 matrix")
        if not abs(self.radial) <= MAX_DISTORTION:
            raise VisionInputError(f"radial distortion {self.radial:g} at the corner; allowed up to {MAX_DISTORTION}")
        object.__setattr__(self, "homography", matrix)

    @property
    def centre_px(self) -> NDArray[np.float64]:
        """Middle of the picture (x, y)."""
        return np.array([0.5 * (self.width - 1), 0.5 * (self.height - 1)])

    @property
    def half_diagonal_px(self) -> float:
        """Distance from the centre to a corner pixel."""
        return float(np.hypot(*self.centre_px))

    def seen(self, rectified_px: ArrayLike) -> NDArray[np.float64]:
        """Where points of the plane, shape (..., 2), appear in the picture."""
        flat = _project(self.homography, as_points(rectified_px) - self.centre_px)
        if self.radial:
            flat *= 1.0 + self.radial / self.half_diagonal_px**2 * _square(flat)
        flat += self.centre_px
        return flat

    def rectified(self, seen_px: ArrayLike) -> NDArray[np.float64]:
        """Points of the plane that appear at the given points; undoes `seen`."""
        bent = as_points(seen_px) - self.centre_px
        flat: NDArray[np.float64] = bent.copy()
        for _ in range(30):
            better = bent / (1.0 + self.radial / self.half_diagonal_px**2 * _square(flat))
            settled = bool(np.all(np.abs(better - flat) < 1e-11 * self.half_diagonal_px))
            flat = better
            if settled:
                break
        inverse = np.asarray(np.linalg.inv(self.homography), dtype=np.float64)
        return np.asarray(self.centre_px + _project(inverse, flat))


def tilted(tilt_rad: float, direction_rad: float, distance_px: float) -> NDArray[np.float64]:
    """Homography of a camera whose axis leans by ``tilt_rad`` from the normal of the plane.

    The plane recedes towards ``direction_rad`` (from x to y, picture axes); ``distance_px`` is the distance of
    the lens over the size of a pixel on the plane. Points along the direction at u and across it at v appear
    at ``(u cos tilt, v) / (1 + u sin tilt / distance)``.
    """
    c, s = math.cos(direction_rad), math.sin(direction_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    lean = np.array([[math.cos(tilt_rad), 0.0, 0.0], [0.0, 1.0, 0.0], [math.sin(tilt_rad) / distance_px, 0.0, 1.0]])
    return turn.T @ lean @ turn


def _project(homography: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """New points; one expression per coordinate, as NumPy's products with a 2-vector at the end are slow."""
    x, y = points[..., 0], points[..., 1]
    h = homography
    depth = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    mapped = np.empty_like(points)
    np.divide(h[0, 0] * x + h[0, 1] * y + h[0, 2], depth, out=mapped[..., 0])
    np.divide(h[1, 0] * x + h[1, 1] * y + h[1, 2], depth, out=mapped[..., 1])
    return mapped


def _square(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared distance from the origin, shape (..., 1)."""
    x, y = points[..., :1], points[..., 1:]
    return np.asarray(x * x + y * y)
