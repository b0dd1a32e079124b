"""The motions of groups of points, refined by fits of the pixels around them.

A followed point drifts where its window holds an edge or the grain of wood, and whole groups drift with their points.
The tracker's own fit (`vision.fitting.icgn`) does not: it compares each frame with the reference and leaves out what
does not agree. It starts in each frame from the frame before, moved on as the points have moved in between. Motions
that turn out to be one are joined.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.errors import BodyError
from vision.film.source import ArrayFilm
from vision.fitting.base import Fit
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template, build_template
from vision.proposals.motion_groups import LEAST_POINTS, Groups, Motion, apart, rigid
from vision.proposals.point_tracks import PointTracks

PIXELS = 3000
LEAST_ZNCC = 0.6
LEAST_INLIER = 0.35
FOUND = 0.7
"""Share of the frames in which a fit must hold for its motion to be taken."""


def refined(tracks: PointTracks, groups: Groups) -> Groups:
    """The same groups with refined motions, joined where they are one."""
    motions, group = list(groups.motions), groups.group.copy()
    for i in range(1, len(motions)):
        motions[i] = _refined(tracks, groups, i) or motions[i]
    first = tracks.place_px[:, 0]
    for i in range(len(motions) - 1, 0, -1):
        for j in range(i):
            if apart(motions[i], motions[j], first[(group == i) | (group == j)]) < groups.within.same_px:
                group[group == i] = j
                break
    kept = [0, *(i for i in range(1, len(motions)) if np.count_nonzero(group == i) >= LEAST_POINTS)]
    renamed = np.full(len(motions), -1, dtype=np.intp)
    renamed[kept] = np.arange(len(kept))
    group = np.where(group >= 0, renamed[group], -1)
    return replace(groups, motions=[motions[i] for i in kept], group=group)


def _refined(tracks: PointTracks, groups: Groups, i: int) -> Motion | None:
    """Motion of a group in the key frames by fits; None where they do not hold."""
    points = tracks.place_px[groups.group == i]
    mask = np.zeros(tracks.reference.shape, dtype=np.uint8)
    for x, y in np.rint(points[:, 0]).astype(int):
        cv2.circle(mask, (int(x), int(y)), int(tracks.spacing_px), 1, cv2.FILLED)
    try:
        template = build_template("group", tracks.reference, mask > 0, 1, PIXELS, tracks.noise_grey)
    except BodyError:
        return None
    fitter, film = IcgnFitter(template), ArrayFilm(tracks.pictures)
    pose, found = np.zeros((tracks.frame.size, 3)), np.zeros(tracks.frame.size, dtype=bool)
    found[0] = True
    for step in range(1, tracks.frame.size):
        moved = _moved_on(template, pose[step - 1], points[:, step - 1], points[:, step])
        pose[step] = moved
        for guess in (moved, 2.0 * pose[step - 1] - pose[max(step - 2, 0)]):
            fit = fitter.fit(film, step, guess, None)
            if _holds(fit):
                pose[step], found[step] = fit.pose, True
                break
            fitter.reset(cautious=True)
    return _motion(template, pose[groups.key]) if found.mean() > FOUND else None


def _holds(fit: Fit) -> bool:
    return fit.converged and fit.zncc > LEAST_ZNCC and fit.inlier > LEAST_INLIER


def _moved_on(
    template: Template, pose: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose carried along by points (n, 2) from one frame to the next."""
    both = np.isfinite(before[:, 0]) & np.isfinite(after[:, 0])
    if np.count_nonzero(both) < 3:
        return pose
    step = rigid(before[both], after[both, None])
    if step is None:
        return pose
    centre = np.array(template.centre_px)
    turn = float(np.arctan2(step.turn[0, 1, 0], step.turn[0, 0, 0]))
    shift = step.turn[0] @ (centre + pose[1:]) + step.shift[0] - centre
    return np.array([pose[0] + turn, *shift])


def _motion(template: Template, pose: NDArray[np.float64]) -> Motion:
    c, s = np.cos(pose[:, 0]), np.sin(pose[:, 0])
    turn = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    centre = np.array(template.centre_px)
    return Motion(turn, pose[:, 1:] + centre - turn @ centre)
