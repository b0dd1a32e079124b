"""Rows that the reference no longer fits, fitted against a later frame of the film.

A body that goes out of focus, or is lit from elsewhere, stops looking like the still frames. Method: where a body is
lost for some rows after it was found without a flag, a template is made of the newest such frame, at the pose found
there, and the body is followed with it until it is found as before; where that template fails too, the next is made of
the last frame it fitted. Each change brings in the error of the pose it starts from: its covariance is added, so that u
grows with the number of templates. Such rows have the flag `RENEWED`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.bodies.masks import build_masks
from vision.errors import BodyError
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import IcgnFitter
from vision.fitting.pose_covariance import predicted_u_angle
from vision.fitting.template import Template, build_template
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.body_tracker import BodyTracker
from vision.uncertainty.coherence_widening import variance_factor, widened

LEAST_ROWS = 3
"""Fewer lost rows are a flash or a passing hand, not a change of appearance."""
WHOLE = 0.9
"""Share of the usual agreeing pixels that a frame needs to become a reference."""
MOST = 12
"""Templates one after the other."""
KEEPS = FrameFlag.IMPRECISE | FrameFlag.WIDENED | FrameFlag.REACQUIRED | FrameFlag.RENEWED
"""Flags that a frame may have to become a reference."""
OTHERWISE = np.uint16(int(FrameFlag.REPEATED))
"""Flag of rows that are lost for another reason than what the body looks like."""
UNCONFIRMED = np.uint16(int(FrameFlag.UNCONFIRMED))
"""Of rows that are lost for another reason, too, but before others: where a body leaves the plane of focus the backward
pass, which begins with lost rows, does not confirm the last that the forward pass could follow."""
F64 = NDArray[np.float64]


def renew(ready: PreparedFilm, table: PoseTable) -> int:
    """Fill in lost rows by later references; returns the number of rows and bodies found."""
    return sum(_renewed(ready, table, i, start) for i in range(len(ready.bodies)) for start in _runs(table, i))


def _runs(table: PoseTable, i: int) -> list[int]:
    """First rows of the stretches of lost rows of a body after a row that may become a reference."""
    lost = table.failed[:, i] & ((table.flag[:, i] & OTHERWISE) == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(np.int8), [0]])))
    usual = np.nanmedian(table.inlier[:, i]) if not table.failed[:, i].all() else np.nan
    return [
        int(start)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        if start > 1
        and np.count_nonzero((table.flag[start:end, i] & UNCONFIRMED) == 0) >= LEAST_ROWS
        and _may_serve(table, int(start) - 1, i, float(usual))
    ]


def _may_serve(table: PoseTable, row: int, i: int, usual: float) -> bool:
    flag = FrameFlag(int(table.flag[row, i]))
    return not flag & ~KEEPS and bool(table.inlier[row, i] >= WHOLE * usual)


def _renewed(ready: PreparedFilm, table: PoseTable, i: int, start: int) -> int:
    """Rows found of the stretch that begins at ``start``."""
    usual, found, n = float(np.nanmedian(table.inlier[:, i])), 0, table.frame.size
    for _ in range(MOST):
        row = start - 1
        template = _template_of(ready, table, row, i) if _may_serve(table, row, i, usual) else None
        if template is None:
            break
        before = start
        start = _followed(ready, table, i, (row, template))
        found += start - before
        if start in (before, n) or not table.failed[start, i] or table.flag[start, i] & OTHERWISE:
            break
    return found


def _template_of(ready: PreparedFilm, table: PoseTable, row: int, i: int) -> Template | None:
    """Template of a body in a row; None where another body is lost, or too little of this one is left."""
    if table.failed[row].any():
        return None
    bodies = []
    for body, template, pose in zip(ready.bodies, ready.templates, table.pose[row], strict=True):
        centre = np.array(template.centre_px)
        bodies.append(replace(body, polygon_px=(body.polygon_px - centre) @ _turn(pose[0]).T + centre + pose[1:]))
    film, own, noise = ready.film, ready.templates[i], ready.reference.noise_grey
    picture = film.read(int(table.frame[row])).astype(np.float32)
    try:
        mask = build_masks(bodies, film.height, film.width)[i]
        template = build_template(own.name, picture, mask, 1, own.n_pixels, noise)
    except BodyError:
        return None
    # one frame has more noise than the still frames' mean: it may hide the texture
    return template if np.isfinite(predicted_u_angle(template, noise)) else None


def _followed(ready: PreparedFilm, table: PoseTable, i: int, reference: tuple[int, Template]) -> int:
    """Follow a body through lost rows with the template of a row; returns the first row not found."""
    row, template = reference
    film, occlusion = ready.film, ready.occlusion
    templates = [template if k == i else other for k, other in enumerate(ready.templates)]
    occlusion = occlusion.with_templates(templates)
    tracker = BodyTracker(IcgnFitter(template, FrameSpline(film)))
    tracker.start()
    if not table.failed[row - 1, i]:
        tracker.absolute.clear()
        tracker.place(-2, _seen_from(ready.templates[i], template, table.pose[row, i], table.pose[row - 1, i]))
        tracker.place(-1, np.zeros(3))
    # what is coherent in the residuals of the frame that becomes the reference moves all that are fitted to it
    factor = variance_factor(table.ratio[: row + 1, i : i + 1], table.blocks[: row + 1, i : i + 1])[-1:]
    drift = widened(table.covariance[row : row + 1, i : i + 1], factor)[0, 0]
    for step, now in enumerate(range(row + 1, table.frame.size)):
        if not table.failed[now, i] or table.flag[now, i] & OTHERWISE:
            return now
        others = {j: table.pose[now, j] for j in occlusion.in_front[i] if not table.failed[now, j]}
        expected = tracker.predict(step)
        covered = occlusion.covered(i, expected, others) if others else None
        fit = tracker.step(film, int(table.frame[now]), step, expected, covered, search=False)
        if tracker.flag & FAILURE:
            return now
        pose = _seen_from(template, ready.templates[i], None, fit.pose, table.pose[row, i])
        table.store(
            now, i, replace(fit, pose=pose, covariance=fit.covariance + drift), tracker.flag | FrameFlag.RENEWED
        )
    return table.frame.size


def _turn(angle: float) -> F64:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _seen_from(template: Template, other: Template, at: F64 | None, pose: F64, reference: F64 | None = None) -> F64:
    """Pose of a template at ``pose`` as that of another of the same body.

    Either ``other`` was made where ``template`` was at pose ``at``, or ``template`` where ``other`` was at pose
    ``reference``.
    """
    mine, its = np.array(template.centre_px), np.array(other.centre_px)
    if at is not None:
        turn, place = pose[0] - at[0], mine + pose[1:]
        return np.array([turn, *(place + _turn(turn) @ (its - mine - at[1:]) - its)])
    assert reference is not None
    place = mine + pose[1:] + _turn(pose[0]) @ (its + reference[1:] - mine)
    return np.array([reference[0] + pose[0], *(place - its)])
