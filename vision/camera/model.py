"""Camera models: an assumed one with uncertainties, or a calibrated projection of the plane of motion.

A model lists *variants*: projections one standard uncertainty away from the nominal one, each with a weight and
the budget term it belongs to. The variance of an angle is the weighted sum of its squared differences.

From the plane of motion to the picture it is a planar homography, then radial distortion. Conventions: points (x, y) in
pixels, y down. *Rectified* points are what a perfect camera, square to the plane, would show; *seen* points are those
of the film. About the picture's centre c: ``h = H (q - c)`` (homogeneous, 3 x 3), then ``p = c + h (1 + k |h|^2 /
R^2)`` with R half the picture's diagonal, so that ``k`` is the displacement at the corner as a fraction of its
distance. Brown's radial model with its first term; the tilt is that of an ideal camera at a stated distance.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers, as_points
from vision.errors import VisionInputError
from vision.files import read_toml, toml_text, whole_file

MAX_DISTORTION = 0.25  # radial, at the picture's corner: a fisheye lens has more
CONVERGED = 1e-11  # of half a diagonal, the last step of an inverse: some nanopixels
MAX_TILT_RAD = math.radians(30.0)  # of an assumed camera: more is seen by eye
EXPECTED_TURN_RAD = math.radians(15.0)  # of a body in a blow, for which errors are stated before it is filmed
PLAIN = np.eye(2, 3)
N_PARAMETERS = 5  # stretch, shear, perspective (2), radial distortion


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

    def to_picture(self, rectified_px: ArrayLike) -> NDArray[np.float64]:
        """Points of the film, px, at which rectified points (..., 2) of the plane appear."""
        flat = _apply_homography(self.homography, as_points(rectified_px) - self.centre_px)
        if self.radial:
            flat *= 1.0 + self.radial / self.half_diagonal_px**2 * _squared_norm(flat)
        flat += self.centre_px
        return flat

    def to_plane(self, seen_px: ArrayLike) -> NDArray[np.float64]:
        """Rectified points, px, of the plane that appear at the given points (..., 2) of the film; the inverse of
        `to_picture`."""
        bent = as_points(seen_px) - self.centre_px
        flat: NDArray[np.float64] = bent.copy()
        for _ in range(30):
            better = bent / (1.0 + self.radial / self.half_diagonal_px**2 * _squared_norm(flat))
            settled = bool(np.all(np.abs(better - flat) < CONVERGED * self.half_diagonal_px))
            flat = better
            if settled:
                break
        inverse = np.asarray(np.linalg.inv(self.homography), dtype=np.float64)
        return np.asarray(self.centre_px + _apply_homography(inverse, flat))

    seen, rectified = to_picture, to_plane  # former names, for one release


def project_posed_points(
    camera: Projection,
    points_px: NDArray[np.float64],
    cosine: NDArray[np.float64],
    sine: NDArray[np.float64],
    at_px: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Picture x and y, each (n, k), px from the picture's centre, of points (k, 2), px from a body's centre, of a body
    turned n times (``cosine``, ``sine`` (n,), picture axes), with its centre at ``at_px`` (n, 2), px of the rectified
    plane."""
    x, y, depth = transform_points(points_px, cosine, sine, at_px - camera.centre_px, camera.homography)
    x /= depth
    y /= depth
    if camera.radial:
        factor = 1.0 + camera.radial / camera.half_diagonal_px**2 * (x * x + y * y)
        x *= factor
        y *= factor
    return x, y


def tilt_homography(tilt_rad: float, direction_rad: float, distance_px: float) -> NDArray[np.float64]:
    """Homography (3, 3), about the picture's centre, of a camera whose axis leans by ``tilt_rad`` from the normal of
    the plane, which recedes towards ``direction_rad`` (from x to y, y down); ``distance_px``: of the lens, over a
    pixel's size on the plane.

    Points along the direction at u and across it at v appear at ``(u cos tilt, v) / (1 + u sin tilt / distance)``.
    """
    c, s = math.cos(direction_rad), math.sin(direction_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    lean = np.array([[math.cos(tilt_rad), 0.0, 0.0], [0.0, 1.0, 0.0], [math.sin(tilt_rad) / distance_px, 0.0, 1.0]])
    return turn.T @ lean @ turn


def _apply_homography(homography: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 2) mapped by a homography (3, 3); one expression per coordinate, as NumPy's products with a 2-vector
    at the end are slow."""
    x, y = points[..., 0], points[..., 1]
    h = homography
    depth = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    mapped = np.empty_like(points)
    np.divide(h[0, 0] * x + h[0, 1] * y + h[0, 2], depth, out=mapped[..., 0])
    np.divide(h[1, 0] * x + h[1, 1] * y + h[1, 2], depth, out=mapped[..., 1])
    return mapped


def transform_points(
    points: NDArray[np.float64],
    cosine: NDArray[np.float64],
    sine: NDArray[np.float64],
    at: NDArray[np.float64],
    rows: NDArray[np.float64] = PLAIN,
) -> list[NDArray[np.float64]]:
    """Points (k, 2), turned n times (``cosine``, ``sine`` (n,)) and shifted by ``at`` (n, 2), times each row of a
    matrix (m, 3) on (x, y, 1): m arrays (n, k), by default x and y; each by one product of matrices."""
    basis = np.vstack([points.T, np.ones(len(points))])
    return [
        np.column_stack([a * cosine + b * sine, b * cosine - a * sine, at @ (a, b) + one]) @ basis for a, b, one in rows
    ]


def _squared_norm(points: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = points[..., :1], points[..., 1:]
    return np.asarray(x * x + y * y)


DIRECTIONS = 8  # in which the assumed camera may be tilted


@dataclass(frozen=True)
class Variant:
    """One way in which the camera may differ from its nominal model."""

    term: str
    weight: float
    projection: Projection


class CameraModel(Protocol):
    """Nominal projection and its uncertainty."""

    def nominal(self, width: int, height: int) -> Projection | None:
        """Projection to correct the angles with; None when nothing is known."""
        ...

    def variants(self, width: int, height: int) -> list[Variant]:
        """Projections one standard uncertainty away."""
        ...

    def description(self) -> str:
        """What is assumed or known, for the user."""
        ...


@dataclass(frozen=True)
class AssumedCamera:
    """A camera set up by eye: standard uncertainties of its tilt, in any direction, and of its lens.

    Parameters
    ----------
    u_tilt_rad : float
        Of the angle between the camera's axis and the normal of the plane of motion.
    u_radial : float
        Of the radial displacement at the picture's corner, as a fraction.
    distance_widths : float
        Distance of the lens over the width of the field of view.
    """

    u_tilt_rad: float = math.radians(1.0)
    u_radial: float = 0.001  # choice: a good lens bends by 0.1 % at the corner
    distance_widths: float = 10.0  # choice: two metres from 0.2 m of an action

    def __post_init__(self) -> None:
        if not 0.0 <= self.u_tilt_rad <= MAX_TILT_RAD:
            most = math.degrees(MAX_TILT_RAD)
            raise VisionInputError(f"assumed tilt {math.degrees(self.u_tilt_rad):g} deg; allowed 0 to {most:g}")
        if not 0.0 <= self.u_radial <= MAX_DISTORTION:
            raise VisionInputError(f"assumed distortion {self.u_radial:g}; allowed 0 to {MAX_DISTORTION}")
        if not 1.0 <= self.distance_widths < math.inf:
            raise VisionInputError(f"camera distance of {self.distance_widths:g} picture widths; needs at least 1")

    def nominal(self, width: int, height: int) -> Projection | None:
        """Nothing to correct with."""
        return None

    def variants(self, width: int, height: int) -> list[Variant]:
        """Views that the camera may have of pictures of ``width`` x ``height`` px, for the budget: `Variant` of term
        ``tilt`` in eight directions, together of weight 1/3 at sqrt(3) standard uncertainties, and one of term
        ``distortion``, weight 1.

        Part of the error grows with the square of the tilt; the mean over a normal distribution of the tilt is
        that of the points 0 and sqrt(3) standard uncertainties, with the weights 2/3 and 1/3 (Gauss-Hermite).
        """
        made = []
        for k in range(DIRECTIONS):
            lean = tilt_homography(
                math.sqrt(3.0) * self.u_tilt_rad, 2.0 * math.pi * k / DIRECTIONS, self.distance_widths * width
            )
            made.append(Variant("tilt", 1.0 / (3.0 * DIRECTIONS), Projection(width, height, lean)))
        return [*made, Variant("distortion", 1.0, Projection(width, height, radial=self.u_radial))]

    def description(self) -> str:
        """What is assumed."""
        return (
            f"camera not calibrated: assumed tilt {math.degrees(self.u_tilt_rad):.2g} deg, distortion "
            f"{100 * self.u_radial:.2g} % at the corner (standard uncertainties)"
        )


@dataclass(frozen=True)
class CalibratedCamera:
    """A camera whose view was measured with a target in the plane of motion.

    Parameters
    ----------
    width, height : int
        Of the picture the calibration was made with, px.
    parameters : ndarray, shape (5,)
        Stretch a, shear b, perspective p and q (both 1 / half diagonal), radial distortion k: homography
        ``[[1 + a, b, 0], [b, 1 - a, 0], [p / R, q / R, 1]]``.
    covariance : ndarray, shape (5, 5)
    scale_px_per_m : float
        At the picture's centre.
    u_scale_px_per_m : float
    """

    width: int
    height: int
    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scale_px_per_m: float
    u_scale_px_per_m: float

    def __post_init__(self) -> None:
        parameters = as_numbers(self.parameters, "camera calibration: parameters")
        covariance = as_numbers(self.covariance, "camera calibration: covariance")
        good = parameters.shape == (N_PARAMETERS,) and covariance.shape == (N_PARAMETERS, N_PARAMETERS)
        good = good and bool(np.all(np.isfinite(parameters)) and np.all(np.isfinite(covariance)))
        if not good or np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min() < -1e-9 * np.abs(covariance).max():
            raise VisionInputError("camera calibration: needs 5 finite parameters and their 5 x 5 covariance")
        if not self.scale_px_per_m > 0.0:
            raise VisionInputError(f"camera calibration: scale {self.scale_px_per_m} px/m; needs a positive number")
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "covariance", 0.5 * (covariance + covariance.T))

    def nominal(self, width: int, height: int) -> Projection | None:
        """The measured projection; `VisionInputError` for a film of another size."""
        if (width, height) != (self.width, self.height):
            raise VisionInputError(
                f"camera calibration is for pictures of {self.width} x {self.height}, the film has {width} x {height}; "
                "calibrate with the film's own settings"
            )
        return build_projection(self.parameters, width, height)

    def variants(self, width: int, height: int) -> list[Variant]:
        """One `Variant`, of term ``tilt`` or ``distortion`` and weight 1, along each eigenvector of the five
        parameters' correlations: the projection one standard uncertainty from the nominal one."""
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 1e-30))
        values, vectors = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        made = []
        for value, vector in zip(values, vectors.T, strict=True):
            step = math.sqrt(max(float(value), 0.0)) * vector
            term = "distortion" if abs(step[4]) > np.hypot(*step[2:4]) + np.hypot(*step[:2]) else "tilt"
            made.append(Variant(term, 1.0, build_projection(self.parameters + step * scale, width, height)))
        return made

    def description(self) -> str:
        """What was measured."""
        return f"camera calibrated: {self.scale_px_per_m / 1e3:.3f} px/mm, distortion {100 * self.parameters[4]:.3f} %"


def build_projection(parameters: NDArray[np.float64], width: int, height: int) -> Projection:
    a, b, p, q, k = (float(v) for v in parameters)
    half = float(np.hypot(0.5 * (width - 1), 0.5 * (height - 1)))
    return Projection(width, height, np.array([[1 + a, b, 0.0], [b, 1 - a, 0.0], [p / half, q / half, 1.0]]), k)


def save_calibration(path: str | os.PathLike[str], camera: CalibratedCamera, notes: Mapping[str, Any]) -> None:
    """Write a camera to a TOML file, in place of one that is there, whole or not at all; ``notes``: numbers and texts,
    by name, on how it was made, which are not read again.

    Parameters
    ----------
    path : path
    camera : CalibratedCamera
    notes : mapping
        Numbers and texts that say how it was made; they are not read again.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> seen = vision.CalibratedCamera(280, 212, np.zeros(5), np.zeros((5, 5)), 2240.0, 1.0)
    >>> vision.save_calibration("camera.toml", seen, {"target": "checkerboard", "pitch_mm": 5.0})
    """
    path = Path(path)
    lines = [
        "# View of the plane of motion: homography [[1 + a, b, 0], [b, 1 - a, 0], [p / R, q / R, 1]] about the",
        "# picture's centre, R half its diagonal; then radial distortion k, the displacement at the corner over R.",
        "[camera]",
        f"width_px = {camera.width}",
        f"height_px = {camera.height}",
        f"parameters = {[float(v) for v in camera.parameters]}  # a, b, p, q, k",
        f"covariance = {[[float(v) for v in row] for row in camera.covariance]}",
        f"scale_px_per_m = {float(camera.scale_px_per_m)!r}",
        f"u_scale_px_per_m = {float(camera.u_scale_px_per_m)!r}",
        "",
        "[made_from]",
    ]
    for name, value in notes.items():
        number = value if isinstance(value, int) else repr(float(value)) if isinstance(value, float) else None
        lines.append(f"{name} = {toml_text(str(value)) if number is None else number}")
    with whole_file(path, VisionInputError, "choose a writable folder") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def load_calibration(path: str | os.PathLike[str]) -> CalibratedCamera:
    """Camera of a TOML file that `save_calibration` or ``pianorig calibrate camera`` wrote; `VisionInputError`, with
    the key, where the file is missing or incomplete.

    Parameters
    ----------
    path : path
        Written by `save_calibration` or ``pianorig calibrate camera``.

    Returns
    -------
    CalibratedCamera

    Raises
    ------
    VisionInputError
        The file is missing or incomplete; the message names the key.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> seen = vision.CalibratedCamera(280, 212, np.zeros(5), np.zeros((5, 5)), 2240.0, 1.0)
    >>> vision.save_calibration("camera.toml", seen, {"made": "by hand"})
    >>> vision.load_calibration("camera.toml").scale_px_per_m
    2240.0
    """
    path = Path(path)
    table = read_toml(path, VisionInputError, "give a file of calibrate camera").get("camera")
    if not isinstance(table, dict):
        raise VisionInputError(f"{path}: holds no [camera] table; give a file of calibrate camera")
    try:
        width, height = table["width_px"], table["height_px"]
        if not (isinstance(width, int) and isinstance(height, int) and width > 0 and height > 0):
            raise VisionInputError(f"width_px and height_px are {width!r} and {height!r}, need whole numbers above 0")
        return CalibratedCamera(
            width,
            height,
            table["parameters"],
            table["covariance"],
            float(table["scale_px_per_m"]),
            float(table["u_scale_px_per_m"]),
        )
    except KeyError as error:
        raise VisionInputError(f"{path}: key camera.{error.args[0]} is missing; run calibrate camera again") from None
    except (TypeError, ValueError) as error:
        raise VisionInputError(f"{path}: {error}; run calibrate camera again") from None
