"""Synthetic bodies and the pictures they make: exact poses, motion blur, flicker, noise.

Truth: a texture is tabulated from its formula at two points per pixel and sampled by cubic splines, which
differs from the formula by less than 0.03 grey; whatever the table holds *is* the body, so the pose is exact.
Motion blur is the mean over equally spaced instants of the exposure; the truth of a blurred frame is both the
angle at its middle and the mean angle.

Conventions: picture axes (y down); bodies are listed from back to front; a pose is a counter-clockwise angle
(rad, y up) and the place of the body's origin (px).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import ccw_to_picture, turn_matrix
from vision.bodies.outlines import signed_distance
from vision.camera.model import Projection
from vision.errors import VisionInputError
from vision.fitting.bspline import coefficients
from vision.synthetic.kernels import PlanarPose, PlanePoints, TextureTable, composite
from vision.synthetic.textures import BlobTexture


def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
    """Rectangle between two corners."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


def thick_line(points: ArrayLike, thickness: float | ArrayLike) -> NDArray[np.float64]:
    """Outline (2 m, 2) of a bent bar along the centre line ``points`` (m, 2), of full width ``thickness``, one or (m,),
    in the units of the points: one side from the first point on, then the other back.

    Parameters
    ----------
    points : array_like, shape (m, 2), centre line
    thickness : float or array_like, shape (m,), full width, one for all points or one each

    Returns
    -------
    ndarray, shape (2 m, 2)
    """
    line = np.asarray(points, dtype=float)
    half = 0.5 * np.broadcast_to(np.asarray(thickness, dtype=float), (len(line),))
    step = np.diff(line, axis=0)
    step /= np.hypot(step[:, 0], step[:, 1])[:, None]
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    at_points = np.vstack([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    at_points /= np.hypot(at_points[:, 0], at_points[:, 1])[:, None]
    # a mitre: the corner moves out so that both arms keep their width
    cosine = np.einsum("ij,ij->i", at_points, np.vstack([normal[:1], normal]))
    offset = at_points * (half / np.maximum(cosine, SHARPEST))[:, None]
    return np.vstack([line + offset, (line - offset)[::-1]])


SHARPEST = 0.3  # cosine of half a corner, down to which a line's corner is mitred: its tip stays near


def transform_points(points: ArrayLike, phi_rad: float, pivot: tuple[float, float]) -> NDArray[np.float64]:
    """Points turned by ``[[cos, -sin], [sin, cos]]`` about the origin and moved to a pivot."""
    return np.asarray(points, dtype=float) @ turn_matrix(phi_rad).T + np.asarray(pivot, dtype=float)


OVERSAMPLING = 2  # points of a texture's table a pixel: a spline lies between them, and the tables stay in the cache
RIM_PX = 3.0  # of the table around an outline: what blending and the spline reach


@dataclass(frozen=True)
class SyntheticBody:
    """A textured rigid body.

    Parameters
    ----------
    polygon_px : (m, 2) outline in the body's axes at angle zero (x right, y down), origin at the point given by a pose
    texture : in the same axes
    """

    name: str
    polygon_px: NDArray[np.float64]
    texture: BlobTexture

    @cached_property
    def table(self) -> TextureTable:
        """Texture as spline coefficients, and opacity of the body, 1 inside, 0 outside, over one pixel at the edge, on
        a grid in the body's axes."""
        margin = RIM_PX + 2.0
        x0, y0 = (float(v) for v in np.floor(self.polygon_px.min(axis=0) - margin))
        x1, y1 = np.ceil(self.polygon_px.max(axis=0) + margin)
        columns, rows = int((x1 - x0) * OVERSAMPLING) + 1, int((y1 - y0) * OVERSAMPLING) + 1
        grey = self.texture.evaluate_grid(x0, y0, 1.0 / OVERSAMPLING, rows, columns)
        distance = signed_distance((self.polygon_px - (x0, y0)) * OVERSAMPLING, rows, columns) / OVERSAMPLING
        alpha = np.clip(0.5 + distance, 0.0, 1.0).astype(np.float32)
        return TextureTable(coefficients(grey), alpha, float(OVERSAMPLING), x0, y0)

    def outline(self, angle_rad: float, x_px: float, y_px: float) -> NDArray[np.float64]:
        """Outline in the picture at a pose."""
        return transform_points(self.polygon_px, float(ccw_to_picture(angle_rad)), (x_px, y_px))


@dataclass(frozen=True)
class Scene:
    """Bodies before a background.

    Parameters
    ----------
    bodies : from back to front
    background : ndarray of float32, shape (height, width)
    lens : camera that sees the plane of motion tilted or distorted; poses are those on the plane. The background is
        taken as seen.
    """

    bodies: Sequence[SyntheticBody]
    background: NDArray[np.float32]
    lens: Projection | None = None

    def __post_init__(self) -> None:
        if self.lens is not None and (self.lens.height, self.lens.width) != self.background.shape:
            raise VisionInputError(
                f"lens for {self.lens.width} x {self.lens.height} px before a background of shape "
                f"{self.background.shape}; make both the same"
            )

    @cached_property
    def _points_shown(self) -> PlanePoints:
        y, x = np.indices(self.background.shape, dtype=float)
        pixel = np.stack([x, y], axis=-1)
        point = pixel if self.lens is None else self.lens.to_plane(pixel)
        bend = int(np.ceil(np.abs(point - pixel).max()))
        return PlanePoints(np.ascontiguousarray(point[..., 0]), np.ascontiguousarray(point[..., 1]), bend)

    def light(self, poses: NDArray[np.float64]) -> NDArray[np.float32]:
        """Noise-free picture (height, width), averaged over the instants of one exposure, for poses (instants, bodies,
        3) of all bodies: angle, rad, counter-clockwise, and x and y, px, of the body's origin.

        Parameters
        ----------
        poses : (n_instants, n_bodies, 3), angle (rad, counter-clockwise), x and y (px) of every body's origin

        Returns
        -------
        ndarray of float32, shape (height, width)
        """
        poses = np.asarray(poses, dtype=float)
        total: NDArray[np.float32] | None = None
        for instant in poses:
            picture = self.background.copy()
            for body, (angle, x, y) in zip(self.bodies, instant, strict=True):
                pose = PlanarPose(float(x), float(y), float(ccw_to_picture(angle)))
                composite(picture, body.table, self._points_shown, pose)
            total = picture if total is None else total + picture
        assert total is not None, "an exposure has at least one instant"
        return total if len(poses) == 1 else total / np.float32(len(poses))


BACKGROUND_PX = 8.0  # blur of what stands behind the plane of focus: choice


def background(
    height: int,
    width: int,
    seed: int,
    *,
    mean_grey: float = 60.0,  # choice: darker than the bodies
    contrast_grey: float = 6.0,  # choice: weaker than theirs
) -> NDArray[np.float32]:
    """Picture (height, width) of an out-of-focus background, grey of 8 bit: Gaussian noise, drawn with ``seed``,
    smoothed, of mean ``mean_grey`` and standard deviation ``contrast_grey``."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), BACKGROUND_PX)
    return (mean_grey + contrast_grey * noise / max(float(noise.std()), 1e-6)).astype(np.float32)


class Sensor:
    """Turns light into stored grey values: gain (flicker), Gaussian noise, rounding, saturation.

    Parameters
    ----------
    noise_grey : standard deviation per pixel, grey of 8 bit
    bit_depth : 8, 12 or 16; stored values are 8-bit greys times ``2**(bit_depth - 8)``
    """

    def __init__(self, noise_grey: float, bit_depth: int, seed: int) -> None:
        self._noise, self._unit = np.float32(noise_grey), np.float32(2 ** (bit_depth - 8))
        self._top = float(2**bit_depth - 1)
        self._type = np.uint8 if bit_depth == 8 else np.uint16
        self._rng = np.random.default_rng(seed)

    def expose(self, light: NDArray[np.float32], gain: float = 1.0) -> NDArray[Any]:
        """Stored frame (height, width) of a noise-free picture, grey of 8 bit, times ``gain``: noise drawn and added,
        brought to the sensor's bits, rounded and clipped."""
        frame = self._draw_noise(light.shape)
        frame *= self._noise
        frame += light * np.float32(gain)
        frame *= self._unit
        np.rint(frame, out=frame)
        np.clip(frame, 0.0, self._top, out=frame)
        return frame.astype(self._type)

    def _draw_noise(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Standard normal deviates, each independent."""
        return self._rng.standard_normal(shape, dtype=np.float32)


def total_noise(noise_grey: float, bit_depth: int) -> float:
    """Standard deviation of a stored grey value with rounding, in grey of 8 bit."""
    return float(np.hypot(noise_grey, 2.0 ** (8 - bit_depth) / np.sqrt(12.0)))
