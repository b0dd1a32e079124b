"""Prepare a film so that a rigid body keeps its shape: pixel aspect, fields, camera distortion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body
from vision.camera.model import Projection
from vision.errors import VisionInputError
from vision.film.source import FrameSource
from vision.reference.camera_faults import correct_defects, correct_row_flicker
from vision.reference.rectified_film import RectifiedFilm
from vision.tracking.options import FitSettings

LINEAR_PX = 0.2
"""Change of a body's shape up to which the fit follows it to first order: the slope of a grain of 1.3 px then changes
by a hundredth, and of a correction of 0.1 degrees one mdeg is left."""


def refuse_interlaced(film: FrameSource) -> None:
    """Refuse a film whose file says that its frames are interlaced (`VisionInputError`)."""
    if getattr(film, "is_interlaced", False):
        raise VisionInputError(
            f"{film.path}: frames are interlaced: even and odd rows were exposed half a frame apart; give the "
            "progressive film, or track bodies by one field of each frame (`deinterlace`)"
        )


def prepare_square_film(
    film: FrameSource, bodies: Sequence[Body], settings: FitSettings
) -> tuple[FrameSource, Sequence[Body]]:
    """The film and the outlines as they are to be tracked: resampled to square pixels or one field where that is
    needed; `VisionInputError` for interlaced frames without a field to track."""
    # "none": frames whose rows were found to be of one time
    is_field = settings.deinterlace and settings.first_field != "none"
    if not (is_field or settings.first_field == "none"):
        refuse_interlaced(film)
    projection, aspect = None, settings.pixel_aspect or getattr(film, "pixel_aspect", None) or 1.0
    if settings.is_calibrated:
        # a target seen with the same pixels has measured their aspect with all else
        projection, aspect = settings.camera_model.nominal(film.width, film.height), 1.0
        if projection is not None and not _changes_shape(projection, bodies):
            projection = None
    if projection is None and aspect == 1.0 and not is_field:
        return film, bodies
    cleaned = correct_defects(film)
    if not is_field:
        cleaned = correct_row_flicker(cleaned, _box(film, bodies))
    first = settings.first_field or getattr(film, "first_field", None) or "even"
    rectified = RectifiedFilm(cleaned, aspect, projection, int(first == "odd") if is_field else None)
    rectified.first_field = settings.first_field or rectified.first_field
    return rectified, rectified.rectified_bodies(bodies)


def _changes_shape(projection: Projection, bodies: Sequence[Body]) -> bool:
    """Whether a camera shows any outline by more than `LINEAR_PX` off one that is turned, scaled and shifted."""
    for body in bodies:
        plane = body.polygon_px - body.polygon_px.mean(axis=0)
        seen = projection.to_picture(body.polygon_px)
        seen = seen - seen.mean(axis=0)
        z, w = plane @ (1.0, 1.0j), seen @ (1.0, 1.0j)
        off = w - z * np.sum(w * z.conj()) / np.sum(np.abs(z) ** 2)
        if float(np.abs(off).max()) > LINEAR_PX:
            return True
    return False


def _box(film: FrameSource, bodies: Sequence[Body]) -> tuple[int, int, int, int]:
    """Rectangle (y0, y1, x0, x1) of the film that holds the outlines."""
    points: NDArray[np.float64] = np.concatenate([body.polygon_px for body in bodies])
    low = np.clip(np.floor(points.min(axis=0)), 0, [film.width - 1, film.height - 1]).astype(int)
    high = np.clip(np.ceil(points.max(axis=0)) + 1, low + 1, [film.width, film.height]).astype(int)
    return int(low[1]), int(high[1]), int(low[0]), int(high[0])
