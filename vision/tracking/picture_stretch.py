"""Estimate the aspect error (stretch) of a film's picture from the bodies that turn in it.

Where pixels are not square, or the camera looks askew, a turning body changes its shape in the picture: what was long
along x is longer or shorter along y. With the picture stretched by ``1 + e`` along x and ``1 - e`` along y, a body that
has turned by phi is stretched in its own axes by ``e (cos 2 phi - 1)`` along and sheared by ``-e sin 2 phi``. The
rigid fit reads part of this as a turn of up to ``e sin 2 phi``, so that phi is fitted anew in the stretched picture.

Method: in rows spread over the way, stretch and shear are fitted to the residuals together with pose, scale, light,
gradients of the light and focus. Over all rows and bodies e is then fitted by weighted least squares, with a constant
stretch and shear of each body (the reference's noise), and ones in proportion to its speed (a rolling shutter). Its
standard uncertainty is enlarged by the root of chi-squared
over the degrees of freedom, the Birge ratio. e is believed where it differs from zero at the level `LEVEL`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from vision.film.source import FrameSource, saturated_grey
from vision.fitting.base import region_of
from vision.fitting.bspline import HALF_TAPS, coefficients
from vision.fitting.robust_fit import PIXELS, RobustFit
from vision.fitting.template import MOST_CONDITION, Template, thin_template
from vision.item_map import ItemMap, serial_map
from vision.reference.prepared_film import PreparedFilm
from vision.reference.rectified_film import sample_spline
from vision.results.pose_table import PoseTable
from vision.tracking.options import FitSettings
from vision.tracking.sensor_pattern import MOST_ROWS

LEVEL = 1e-5  # probability that pixels are said not to be square of a film where they are
U_NOT_STATED = 0.004
"""Of the pixel aspect of a file that does not state one. Nearly all cameras have square pixels; a picture that was
resized is found by this test, and where texture and turn cannot tell, 2 % are within 5 u."""
U_STATED = 0.0005  # of a stated one, or of a sensor's own pixels: what a lens and its mount add
LEAST_ROWS = 4  # of a body: its own strain and that of its speed are fitted too
LEAST_INLIER = 0.97
"""Share of a row's pixels that agree with the fit; 0.997 of white noise do. In others something else changes it:
a cover, a second body under the outline, one that bends."""
LINEAR_STRETCH = 0.002  # up to this one a body of 60 px changes its shape by a tenth of a pixel
ROUNDS = 4  # of a first-order correction at most: of the stretch, and of the pose in the stretched picture
N_COLUMNS = 10  # turn, two shifts, gain, offset, two gradients of the light, scale, stretch, shear
BLUR_PX = 0.5  # standard deviation: a little blur, to first order
FIELD_FACTOR = 3.0
"""Of u where one field is tracked: interpolated rows bend a texture alike in neighbouring frames, which their scatter
does not show. Stretch over u had a standard deviation of 2.9 in 15 films of square pixels."""


@dataclass(frozen=True)
class PictureStretch:
    """Stretch of the picture by ``1 + value`` along x and ``1 - value`` along y."""

    value: float
    u: float
    """As measured, with its standard uncertainty."""
    is_significant: bool

    @property
    def effect(self) -> float:
        """What goes into the budget as a standard uncertainty."""
        return math.hypot(self.value, self.u) if self.is_significant else self.u

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel over its height that would explain the stretch."""
        return (1.0 - self.value) / (1.0 + self.value)


def prior_stretch_uncertainty(film: FrameSource, settings: FitSettings) -> float:
    """Standard uncertainty of the picture's stretch before it is measured; 0 of a calibrated camera."""
    if settings.is_calibrated:
        return 0.0
    is_stated = settings.pixel_aspect is not None or getattr(film, "pixel_aspect", None) is not None
    return 0.5 * (U_STATED if is_stated else U_NOT_STATED)


def measure_stretch(
    ready: PreparedFilm, table: PoseTable, u_before: float, map_items: ItemMap = serial_map
) -> PictureStretch:
    """Stretch s of the picture, by 1 + s along x and 1 - s along y, from the strains of bodies that turn, its standard
    uncertainty and whether it is significant; ``u_before``: standard uncertainty without the measurement."""
    found = _measure_remaining_stretch(ready, table, u_before, 0.0, map_items)
    for _ in range(ROUNDS):
        if not found.is_significant or abs(found.value) < LINEAR_STRETCH:
            break
        # a large one is followed to first order only
        more = _measure_remaining_stretch(ready, table, u_before, found.value, map_items)
        found = PictureStretch(found.value + more.value, more.u, True)
        if abs(more.value) < more.u:
            break
    return found


def _measure_remaining_stretch(
    ready: PreparedFilm, table: PoseTable, u_before: float, value: float, map_items: ItemMap
) -> PictureStretch:
    """Stretch of the picture that is left, to first order, after it was stretched by ``value``, from strains of bodies
    that turn; ``u_before``: its standard uncertainty without the measurement."""
    right, normal, chi2, degrees = 0.0, 0.0, 0.0, 0
    for strains in map_items(
        lambda i: _measure_strains(ready, table, i, thin_template(ready.templates[i], PIXELS), value),
        range(len(ready.templates)),
    ):
        if strains is None:
            continue
        turn, speed, strain, weight = strains  # (k,), (k,), (k, 2), (k, 2, 2)
        model = np.stack([np.cos(2.0 * turn) - 1.0, -np.sin(2.0 * turn)], axis=-1)
        # each body's constant strain, and that in proportion to its speed, are fitted with it and eliminated
        own = np.concatenate([np.tile(np.eye(2), (len(turn), 1, 1)), speed[:, None, None] * np.eye(2)], axis=2)
        total = np.einsum("kia,kij,kjb->ab", own, weight, own)
        model, strain = (
            part - own @ np.linalg.lstsq(total, np.einsum("kia,kij,kj->a", own, weight, part), rcond=1e-9)[0]
            for part in (model, strain)
        )
        right += float(np.einsum("ki,kij,kj->", model, weight, strain))
        normal += float(np.einsum("ki,kij,kj->", model, weight, model))
        chi2 += float(np.einsum("ki,kij,kj->", strain, weight, strain))
        degrees += 2 * len(turn) - 4
    if not normal > 0.0:
        return PictureStretch(0.0, u_before, False)
    degrees -= 1
    birge = max(1.0, (chi2 - right**2 / normal) / max(degrees, 1))
    value, u = right / normal, math.sqrt(birge / normal)
    if ready.rectified_film is not None and ready.rectified_film.field is not None:
        u *= FIELD_FACTOR
    limit = -float(ndtri(0.5 * LEVEL))
    is_seen = degrees > 0 and abs(value) > limit * u
    if not is_seen:
        return PictureStretch(value, 1.0 / math.hypot(1.0 / u, 1.0 / u_before), False)
    if abs(value) <= limit * math.hypot(u, 0.5 * U_STATED):
        # no more than sensors and lenses add, or a weak reflection: in u without a line
        return PictureStretch(value, math.hypot(value, u), False)
    return PictureStretch(value, u, True)


def _measure_strains(
    ready: PreparedFilm, table: PoseTable, body: int, template: Template, value: float
) -> tuple[NDArray[np.float64], ...] | None:
    """Of k rows of a body: turns (k,), rad, turns from row to row over the largest turn (k,), stretch and shear (k, 2)
    left after ``value``, and the inverse of their covariance (k, 2, 2); None of too few rows."""
    moving = table.frame >= ready.reference.n_averaged
    rows = np.flatnonzero(~table.is_lost[:, body] & moving & (table.inlier[:, body] >= LEAST_INLIER))
    if rows.size < LEAST_ROWS:
        return None
    rows = rows[np.argsort(np.abs(table.pose[rows, body, 0]), kind="stable")]
    rows = np.sort(rows[np.unique(np.linspace(0, rows.size - 1, MOST_ROWS).astype(int))])
    dx, dy = template.offset_px.astype(float)
    g_turn, gx, gy, grey = template.columns.astype(float)
    light = grey + template.mean_grey
    design = np.stack(
        [g_turn, gx, gy, grey, np.ones_like(dx), light * dx, light * dy, -(gx * dx + gy * dy)]
        + [gy * dy - gx * dx, -(gx * dy + gy * dx)]
    )
    blur = _blur_column(template)
    if blur is not None:
        design = np.vstack([blur, design])
    speed = np.gradient(table.pose[:, body, 0]) / max(float(np.nanmax(np.abs(table.pose[:, body, 0]))), 1e-9)
    fit, found = RobustFit(design), list[tuple[float, float, NDArray[np.float64], NDArray[np.float64]]]()
    for row in rows[np.isfinite(speed[rows])]:
        fitted = _fit_strain(ready, int(table.frame[row]), table.pose[row, body], template, fit, value)
        if fitted is not None and np.all(np.isfinite(fitted[1][-2:, -2:])):
            found.append((fitted[2], float(speed[row]), fitted[0][-2:], fitted[1][-2:, -2:]))
    if len(found) < LEAST_ROWS:
        return None
    turns, speeds, strains, covariances = (np.array(values) for values in zip(*found, strict=True))
    told = np.linalg.cond(covariances) <= MOST_CONDITION
    if np.count_nonzero(told) < LEAST_ROWS:
        return None
    return turns[told], speeds[told], strains[told], np.linalg.inv(covariances[told])


def _blur_column(template: Template) -> NDArray[np.float64] | None:
    """Change of the template's grey values (n,) by a blur of standard deviation `BLUR_PX`; None where the picture
    around the body is not kept."""
    if template.patch is None:
        return None
    change = cv2.GaussianBlur(template.patch, (0, 0), BLUR_PX, borderType=cv2.BORDER_REPLICATE) - template.patch
    dx, dy = template.offset_px.astype(float)
    columns = np.rint(dx + template.centre_px[0] - template.patch_corner_px[0]).astype(np.intp)
    rows = np.rint(dy + template.centre_px[1] - template.patch_corner_px[1]).astype(np.intp)
    return np.asarray(change[rows, columns], dtype=np.float64)


def _fit_strain(
    ready: PreparedFilm,
    frame: int,
    pose: NDArray[np.float64],
    template: Template,
    fit: RobustFit,
    value: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
    """Amplitudes (p,) of the columns of ``fit`` in a frame's residuals, in a picture stretched by ``value``, their
    covariance (p, p), and the body's turn, rad, at which they are taken; None where the fit fails.

    The tracked pose is that of the picture without stretch: its turn may be off by ``value sin(2 turn)``.
    """
    film = ready.film
    box = region_of(template, pose, film.height, film.width, margin_px=HALF_TAPS)
    if box is None:
        return None
    picture = np.ascontiguousarray(film.read_region(frame, *box), dtype=np.float32)
    spline, top = coefficients(picture), np.float32(saturated_grey(film))
    dx, dy = template.offset_px.astype(float)
    seen = np.empty((1, dx.size), dtype=np.float32)
    expected = template.columns[3].astype(float)
    turn, at = float(pose[0]), pose[1:3] + template.centre_px - np.array([box[2], box[0]], dtype=float)
    ratio = (1.0 + value) / (1.0 - value)
    steps = ROUNDS if value else 1  # the turn of a body that does not turn is noise, like its shear
    for step in range(steps):
        c, s = math.cos(turn), math.sin(turn)
        # a turn of the body, seen in the stretched picture
        x, y = at[0] + c * dx - s * ratio * dy, at[1] + s / ratio * dx + c * dy
        sample_spline(spline, picture, x[None], y[None], top, seen)
        target = seen[0].astype(float) - template.mean_grey
        fitted = fit.fit(target - expected, seen[0] < top)
        if fitted is None:
            return None
        amplitude, covariance = fitted
        back, along, across = amplitude[-N_COLUMNS : 3 - N_COLUMNS]
        if step == steps - 1:
            break
        turn -= float(back)
        at = at - np.array([c * along - s * ratio * across, s / ratio * along + c * across])
    return amplitude, covariance, turn
