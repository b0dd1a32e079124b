"""Estimate the exposure delay between even and odd rows of a film from the bodies' motion.

Method: in rows of fast motion each field alone is interpolated at the places where the body's pixels were found, and
one Gauss–Newton step is made in pose, gain and offset. What the steps of the two fields differ by is regressed on the
motion per frame, all in the body's own axes and weighted by the inverse covariance of the difference. What they differ
by at rest, because half of the rows tell less of a texture, is taken off first. The slope is the lag in frames: 1/2
where even rows come first, -1/2 where odd ones do, 0 where all rows are of one time. Its standard uncertainty is
enlarged by the root of chi-squared over the degrees of freedom, the Birge ratio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.film.source import FrameSource, saturated_grey
from vision.fitting.base import SURE_U
from vision.fitting.bspline import coefficients
from vision.fitting.robust_fit import PIXELS, RobustFit
from vision.fitting.template import Template, thin_template
from vision.reference.prepared_film import PreparedFilm
from vision.reference.rectified_film import MARGIN_PX, sample_spline
from vision.results.pose_table import PoseTable
from vision.tracking.moving_parts import ROWS
from vision.tracking.segments import AGREE_PX

MOST_STILL = 8  # rows at rest of each body that are looked at
LEAST_ROWS = 3  # their scatter must be known
BETWEEN = 0.25  # half way from rows of one time to fields half a frame apart


@dataclass(frozen=True)
class FieldLag:
    """Delay of the odd rows behind the even ones."""

    frames: float
    """Delay in frames."""
    u: float
    """Its standard uncertainty; infinite where nothing moves."""

    @property
    def first_field(self) -> str | None:
        """Rows that were exposed first: ``even``, ``odd``, ``none`` where all are of one time; None if not known."""
        if SURE_U * self.u > BETWEEN:
            return None
        return "none" if abs(self.frames) < BETWEEN else "even" if self.frames > 0.0 else "odd"


UNKNOWN_LAG = FieldLag(0.0, math.inf)


def measure_field_lag(ready: PreparedFilm, table: PoseTable, time_s: NDArray[np.float64]) -> FieldLag:
    """Delay of a film's odd rows behind the even ones, in frames, by the poses found, and its standard uncertainty,
    infinite where nothing moves; ``time_s`` (n_frames,) of all frames of the film."""
    at = time_s[table.frame] / (float(np.median(np.diff(time_s))) if time_s.size > 1 else 1.0)
    right, normal, chi2, degrees = 0.0, 0.0, 0.0, 0
    for i, template in enumerate(ready.templates):
        found = _field_differences(ready, table, i, thin_template(template, PIXELS), at)
        if found is None:
            continue
        motion, difference, weight = found
        right += float(np.einsum("ki,kij,kj->", motion, weight, difference))
        normal += float(np.einsum("ki,kij,kj->", motion, weight, motion))
        chi2 += float(np.einsum("ki,kij,kj->", difference, weight, difference))
        degrees += motion.size
    if not normal > 0.0:
        return UNKNOWN_LAG
    birge = max(1.0, (chi2 - right**2 / normal) / max(degrees - 1, 1))
    return FieldLag(right / normal, math.sqrt(birge / normal))


def _field_differences(
    ready: PreparedFilm, table: PoseTable, body: int, template: Template, at: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """Of k rows in which a body moves: motion per frame (k, 3), difference of the fields' steps less that at rest (k,
    3), in the body's axes, and the inverse of its covariance (k, 3, 3); None of too few. ``at`` (n,): times of all rows
    in frames."""
    pose, frame, known = table.pose[:, body], table.frame, ~table.is_lost[:, body]
    if frame.size < LEAST_ROWS:
        return None
    apart, motion = at[2:] - at[:-2], np.zeros_like(pose)
    motion[1:-1] = (pose[2:] - pose[:-2]) / apart[:, None]
    inner = np.zeros(frame.size, dtype=bool)
    # beside a gap the motion in between is not known
    inner[1:-1] = known[1:-1] & known[2:] & known[:-2] & (apart < 1.5 * np.median(apart))
    size = np.hypot(motion[:, 0] * template.radius_px, np.hypot(motion[:, 1], motion[:, 2]))
    size = np.where(inner & (frame >= ready.reference.n_averaged), np.nan_to_num(size), 0.0)
    moving = np.argsort(-size, kind="stable")[:ROWS]
    moving = np.sort(moving[size[moving] > AGREE_PX])  # in the order in which films decode
    still = np.flatnonzero(known & (frame < ready.reference.n_averaged))[:MOST_STILL]
    if moving.size < LEAST_ROWS:
        return None
    fit = RobustFit(np.vstack([template.columns.astype(float), np.ones(template.n_pixels)]))
    steps = [_field_difference(ready, int(frame[row]), pose[row], template, fit) for row in (*still, *moving)]
    at_rest = [step[0] for step in steps[: still.size] if step is not None]
    zero = np.mean(at_rest, axis=0) if at_rest else np.zeros(3)
    rows = [
        (np.array([motion[row, 0], *(motion[row, 1:] @ turn_matrix(pose[row, 0]))]), step[0] - zero, step[1])
        for row, step in zip(moving, steps[still.size :], strict=True)
        if step is not None
    ]
    if len(rows) < LEAST_ROWS:
        return None
    motions, differences, weights = (np.array(values) for values in zip(*rows, strict=True))
    return motions, differences, weights


def _field_difference(
    ready: PreparedFilm, frame: int, pose: NDArray[np.float64], template: Template, fit: RobustFit
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Pose of a frame's odd rows less that of its even ones, (3,): turn and shift in the body's own axes, and the
    inverse of its covariance; ``fit`` has the template's columns and an offset. None where a fit fails or too little is
    inside."""
    rectified = ready.rectified_film
    film: FrameSource = ready.film if rectified is None else rectified.film
    dx, dy = template.offset_px.astype(float)
    c, s = math.cos(pose[0]), math.sin(pose[0])
    x = template.centre_px[0] + pose[1] + c * dx - s * dy
    y = template.centre_px[1] + pose[2] + s * dx + c * dy
    if rectified is not None:
        x, y = rectified.to_film(np.stack([x, y], axis=-1)).T
    edges = [np.clip([math.floor(at.min()) - 2 * MARGIN_PX, math.ceil(at.max()) + 2 * MARGIN_PX], 0, size)
             for at, size in ((x, film.width), (y, film.height))]  # fmt: skip
    (left, right), (top, bottom) = ((int(low), int(high)) for low, high in edges)
    if right - left < 2 * MARGIN_PX or bottom - top < 4 * MARGIN_PX:
        return None
    picture = np.ascontiguousarray(film.read_region(frame, top, bottom, left, right), dtype=np.float32)
    white = np.float32(saturated_grey(film))
    expected = template.columns[3].astype(float) + template.mean_grey
    steps, covariance = [], np.zeros((3, 3))
    for parity in (0, 1):
        start = (parity - top) % 2
        field = np.ascontiguousarray(picture[start::2])
        seen = np.empty((1, x.size), dtype=np.float32)
        sample_spline(coefficients(field), field, x[None] - left, (y[None] - top - start) / 2.0, white, seen)
        found = fit.fit(seen[0].astype(float) - expected, seen[0] < white)
        if found is None:
            return None
        steps.append(-found[0][:3])  # what a picture is behind its template has moved on
        covariance += found[1][:3, :3]
    return steps[1] - steps[0], np.asarray(np.linalg.inv(covariance), dtype=np.float64)
