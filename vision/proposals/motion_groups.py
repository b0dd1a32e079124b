"""Motion segmentation: groups of tracked points that move as one rigid body.

Method: sequential consensus (M. Fischler and R. Bolles, Random sample consensus, Commun. ACM 24, 1981) over whole
motions. The neighbours of a point give a rigid motion through all frames; the points that keep to it are counted; the
motion with most of them is refitted to them, they are taken out, and the search goes on in the rest. Points at rest
come first. Two motions that take points to the same places, but for some pixels, are one.

Motions are then refined by fits of the pixels around the points. A followed point drifts where its window holds an edge
or the grain of wood, and whole groups drift with their points. The tracker's own fit (`vision.fitting.icgn`) does not:
it compares each frame with the reference and leaves out what does not agree. It starts in each frame from the frame
before, moved on as the points have moved in between. Motions that turn out to be one are joined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.errors import BodyError
from vision.film.source import ArrayFilm
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template, build_template
from vision.proposals.point_tracks import PointTracks

NEIGHBOURS = 9  # points that give a trial motion
SEEDS = 160  # trial motions per round, spread over the free points
KEY_FRAMES = 20  # in which motions are compared, evenly spread
FOLLOWED = 0.4
"""Share of the frames in which a point must be known."""
LEAST_POINTS = 10  # that make a body
MOST_BODIES = 8  # that are proposed
F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Distances:
    """How far apart places may be and still count as the same, px."""

    rests_px: float = 0.8
    """Up to which a point rests."""
    keeps_px: float = 1.8
    """From a motion, in four of five frames, up to which a point belongs to it."""
    same_px: float = 3.0
    """Up to which two motions are one: points drift by as much along an edge or along the grain of wood."""

    def scale_by(self, factor: float) -> Distances:
        return Distances(self.rests_px * factor, self.keeps_px * factor, self.same_px * factor)


USUAL = Distances()


@dataclass(frozen=True)
class Motion:
    """A rigid motion: ``turn`` (t, 2, 2) and ``shift`` (t, 2) take points of the reference to each key frame."""

    turn: F64
    shift: F64

    def transform(self, points: F64) -> F64:
        """Where points (n, 2) of the reference are, (n, t, 2)."""
        return np.einsum("tij,nj->nti", self.turn, points) + self.shift

    def matrices(self) -> F64:
        """Picture matrices, (t, 2, 3)."""
        return np.concatenate([self.turn, self.shift[:, :, None]], axis=2)


@dataclass(frozen=True)
class Groups:
    """Motions, the first of them rest; ``group`` (n,) of every point, -1 where it keeps to none; ``key``, the steps of
    the tracks that are looked at; ``within``, the distances they were sorted by."""

    motions: list[Motion]
    group: NDArray[np.intp]
    key: NDArray[np.intp]
    within: Distances = USUAL


def group_by_motion(tracks: PointTracks, within: Distances = USUAL) -> Groups:
    """Rest, and the rigid motions that enough points share, those of most points first."""
    key = np.unique(np.linspace(1, tracks.frame.size - 1, KEY_FRAMES).astype(int))
    place, first = tracks.place_px[:, key], tracks.place_px[:, 0]
    known = np.isfinite(place[..., 0])
    usable = known.mean(axis=1) > FOLLOWED
    rest = Motion(np.tile(np.eye(2), (key.size, 1, 1)), np.zeros((key.size, 2)))
    group = np.full(len(first), -1, dtype=np.intp)
    group[usable & (_motion_distance(rest, first, place) < within.rests_px)] = 0
    motions, free = [rest], usable & (group < 0)
    while len(motions) <= MOST_BODIES:
        found = _find_shared_motion(first, place, free, within.keeps_px)
        if found is None:
            break
        keeps = free & (_motion_distance(found, first, place) < within.keeps_px)
        motions.append(found)
        group[keeps] = len(motions) - 1
        free &= ~keeps
    return _merge_groups(Groups(motions, group, key, within), first, place, usable)


def fit_rigid_motion(first: F64, place: F64) -> Motion | None:
    """Least-squares rigid motion of points (n, 2) to their places (n, t, 2), by the points known in each frame; None
    where a frame has fewer than three."""
    known = np.isfinite(place[..., 0])
    weight = known / np.maximum(known.sum(axis=0), 1)
    if known.sum(axis=0).min() < 3:
        return None
    there = np.where(known[..., None], place, 0.0)
    mean0, mean1 = weight.T @ first, np.einsum("nt,nti->ti", weight, there)
    a = first[:, None] - mean0
    b = there - mean1
    along = np.einsum("nt,nti,nti->t", weight, a, b)
    across = np.einsum("nt,nt->t", weight, a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    size = np.maximum(np.hypot(along, across), 1e-12)
    c, s = along / size, across / size
    turn = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    return Motion(turn, mean1 - np.einsum("tij,tj->ti", turn, mean0))


def _motion_distance(motion: Motion, first: F64, place: F64) -> F64:
    """Distance of each point from a motion that four of five of its frames stay below, px; infinite where unknown."""
    distance = np.hypot(*np.moveaxis(motion.transform(first) - place, 2, 0))
    distance = np.sort(np.where(np.isnan(distance), np.inf, distance), axis=1)  # unknown ones last
    count = np.isfinite(distance).sum(axis=1)
    at = np.maximum(np.ceil(0.8 * count).astype(int) - 1, 0)
    return np.asarray(distance[np.arange(len(first)), at])


def _find_shared_motion(first: F64, place: F64, free: NDArray[np.bool_], keeps_px: float) -> Motion | None:
    """The motion that most of the free points share; None where too few share any."""
    at = np.flatnonzero(free)
    if at.size < LEAST_POINTS:
        return None
    best: tuple[int, Motion] | None = None
    for seed in at[np.unique(np.linspace(0, at.size - 1, SEEDS).astype(int))]:
        near = at[np.argsort(np.sum((first[at] - first[seed]) ** 2, axis=1), kind="stable")[:NEIGHBOURS]]
        motion = fit_rigid_motion(first[near], place[near])
        for _ in range(3):  # from the neighbours outwards
            if motion is None:
                break
            keeps = at[_motion_distance(motion, first[at], place[at]) < keeps_px]
            if keeps.size < LEAST_POINTS // 2:
                break
            if best is None or keeps.size > best[0]:
                best = keeps.size, motion
            motion = fit_rigid_motion(first[keeps], place[keeps])
    return best[1] if best is not None and best[0] >= LEAST_POINTS else None


def _merge_groups(groups: Groups, first: F64, place: F64, usable: NDArray[np.bool_]) -> Groups:
    """Motions that are one joined, those of few points left out, and every point with the one it keeps to best."""
    motions, group = groups.motions, groups.group.copy()
    _join(motions, group, first, groups.within.same_px)
    kept = [i for i in range(1, len(motions)) if np.count_nonzero(group == i) >= LEAST_POINTS]
    fitted = [fit_rigid_motion(first[group == i], place[group == i]) for i in kept]
    motions = [motions[0], *(motion for motion in fitted if motion is not None)]
    off = np.stack([_motion_distance(motion, first, place) for motion in motions])
    best = np.argmin(off, axis=0)
    best[~usable | (off.min(axis=0) > 2.0 * groups.within.keeps_px)] = -1
    return Groups(motions, np.asarray(best, dtype=np.intp), groups.key, groups.within)


def _join(motions: list[Motion], group: NDArray[np.intp], first: F64, same_px: float) -> None:
    """Give the points of motions that are one to the first of them, from the last motion on."""
    for i in range(len(motions) - 1, 0, -1):
        for j in range(i):
            if motion_difference(motions[i], motions[j], first[(group == i) | (group == j)]) < same_px:
                group[group == i] = j
                break


def motion_difference(one: Motion, other: Motion, points: F64) -> float:
    """How far two motions bring most points apart in most frames, px."""
    if len(points) == 0:
        return 0.0
    distance = np.hypot(*np.moveaxis(one.transform(points) - other.transform(points), 2, 0))
    return float(np.quantile(np.quantile(distance, 0.9, axis=1), 0.8))


PIXELS = 3000
LEAST_ZNCC = 0.6  # of a refined motion that is kept
LEAST_INLIER = 0.35  # share of pixels in agreement, likewise
FOUND = 0.7
"""Share of the frames in which a fit must hold for its motion to be taken."""


def refine_groups(tracks: PointTracks, groups: Groups) -> Groups:
    motions, group = list(groups.motions), groups.group.copy()
    for i in range(1, len(motions)):
        motions[i] = _refine_motion(tracks, groups, i) or motions[i]
    _join(motions, group, tracks.place_px[:, 0], groups.within.same_px)
    kept = [0, *(i for i in range(1, len(motions)) if np.count_nonzero(group == i) >= LEAST_POINTS)]
    renamed = np.full(len(motions), -1, dtype=np.intp)
    renamed[kept] = np.arange(len(kept))
    group = np.where(group >= 0, renamed[group], -1)
    return replace(groups, motions=[motions[i] for i in kept], group=group)


def _refine_motion(tracks: PointTracks, groups: Groups, i: int) -> Motion | None:
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
        moved = _advance_pose(template, pose[step - 1], points[:, step - 1], points[:, step])
        pose[step] = moved
        for guess in (moved, 2.0 * pose[step - 1] - pose[max(step - 2, 0)]):
            fit = fitter.fit(film, step, guess, None)
            if fit.converged and fit.zncc > LEAST_ZNCC and fit.inlier > LEAST_INLIER:
                pose[step], found[step] = fit.pose, True
                break
            fitter.reset(cautious=True)
    return _motion(template, pose[groups.key]) if found.mean() > FOUND else None


def _advance_pose(
    template: Template, pose: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose carried along by points (n, 2) from one frame to the next."""
    both = np.isfinite(before[:, 0]) & np.isfinite(after[:, 0])
    if np.count_nonzero(both) < 3:
        return pose
    step = fit_rigid_motion(before[both], after[both, None])
    if step is None:
        return pose
    centre = np.array(template.centre_px)
    turn = float(np.arctan2(step.turn[0, 1, 0], step.turn[0, 0, 0]))
    shift = step.turn[0] @ (centre + pose[1:]) + step.shift[0] - centre
    return np.array([pose[0] + turn, *shift])


def _motion(template: Template, pose: NDArray[np.float64]) -> Motion:
    turn, centre = turn_matrix(pose[:, 0]), np.array(template.centre_px)
    return Motion(turn, pose[:, 1:] + centre - turn @ centre)
