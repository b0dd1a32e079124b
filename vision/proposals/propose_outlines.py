"""Outlines proposed from the film itself, for the user to inspect and correct.

Meant for the first film of a camera setting; the tracker never uses a proposal that nobody has seen.

Method: textured points are followed through the film (`point_tracks`) and sorted into rigid motions (`motion_groups`),
which fits refine (`refined_motions`); the pixels that each motion explains become its region (`regions`); pins and
overlaps tell parents and layers (`joints`). Where most points are lost before the film ends (large turns, glare), its
beginning is tried as well; where nothing moves by a pixel, smaller motions are looked for; the attempt whose outlines
hold most points that move with them is given. Bodies that never move relative to each other are one outline; what shows
no texture and no edge is not found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from vision.bodies.outlines import Body, signed_distance
from vision.errors import TrackingError
from vision.film.source import FrameSource
from vision.proposals.joints import layers_of, parents_of
from vision.proposals.motion_groups import USUAL, Distances, Groups, group_by_motion
from vision.proposals.point_tracks import PointTracks, track_points
from vision.proposals.refined_motions import refined
from vision.proposals.regions import outlines, regions

LEAST_FRAMES = 4
LOST = 0.6
"""Share of the points still followed in the last frame below which the film's beginning is tried as well."""
STILL_FOLLOWED = (0.6, 0.4, 0.3)
"""The beginning lasts while such shares of the points are followed."""
NOISES = 5.0
"""Smallest motion that is looked for, over the noise of a followed point."""
LEAST_FACTOR = 0.06
SHAKEN = 0.6
"""Share of the points that shift alike from which a motion of less than a pixel is the camera's."""


def propose_bodies(film: FrameSource) -> list[Body]:
    """Outlines of the rigid bodies that move, largest first, named ``body1``, ``body2``, …

    Parameters
    ----------
    film : FrameSource
        Outlines are drawn on its first frame.

    Returns
    -------
    list of Body
        To be looked at, corrected and named: outlines of at most 20 corners that do not overlap, with the parent a body
        is pinned to and the layer it lies in, where the film tells.

    Raises
    ------
    TrackingError
        Nothing moves as a rigid textured body; the reason is said.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     vision.propose_bodies(film)[0].name
    'body1'
    """
    if film.n_frames < LEAST_FRAMES:
        raise TrackingError(f"{film.path}: {film.n_frames} frames; a proposal needs at least {LEAST_FRAMES}")
    tracks = track_points(film)
    whole = _attempt(tracks, USUAL)
    others = [_attempt(tracks.beginning(n), USUAL) for n in _shorter(tracks)]
    if not whole.bodies and not any(other.bodies for other in others) and _rests(tracks, whole.groups):
        within = USUAL.scaled(_finer(tracks))
        if not _shakes(tracks, within.rests_px):
            others.append(_attempt(tracks, within))
    best = max([whole, *others], key=lambda attempt: attempt.points)
    if not best.bodies:
        raise TrackingError(f"{film.path}: {_reason(tracks, whole.groups)}; draw outlines by hand")
    return best.bodies


@dataclass(frozen=True)
class _Attempt:
    """Bodies found, and how many points lie in the outline of the body they move with."""

    bodies: list[Body]
    points: int
    groups: Groups


def _attempt(tracks: PointTracks, within: Distances) -> _Attempt:
    groups = refined(tracks, group_by_motion(tracks, within))
    found = regions(tracks, groups) if len(groups.motions) > 1 else []
    polygons = outlines([mask for _, mask in found])
    kept = [(region, polygon) for region, polygon in zip(found, polygons, strict=True) if polygon is not None]
    if not kept:
        return _Attempt([], 0, groups)
    own = [region for region, _ in kept]
    parents, layers = parents_of(own), layers_of(tracks, groups.key, own)
    names = [f"body{i + 1}" for i in range(len(kept))]
    bodies = [
        Body(name, polygon, None if parent is None else names[parent], layer)
        for name, (_, polygon), parent, layer in zip(names, kept, parents, layers, strict=True)
    ]
    points = 0
    for (motion, _), polygon in kept:
        which = next(i for i, other in enumerate(groups.motions) if other is motion)
        x, y = np.rint(tracks.place_px[groups.group == which, 0]).astype(int).T
        points += int(np.count_nonzero(signed_distance(polygon, *tracks.reference.shape)[y, x] > 0.0))
    return _Attempt(bodies, points, groups)


def _shorter(tracks: PointTracks) -> list[int]:
    """Numbers of frames after which the points of the first frame have become few."""
    followed = np.isfinite(tracks.place_px[..., 0]).sum(axis=0) / max(len(tracks.place_px), 1)
    if followed[-1] > LOST:
        return []
    ends = {int(np.count_nonzero(followed > share)) for share in STILL_FOLLOWED}
    return sorted(n for n in ends if LEAST_FRAMES <= n < tracks.frame.size)


def _rests(tracks: PointTracks, groups: Groups) -> bool:
    return len(groups.motions) == 1 and bool(np.count_nonzero(groups.group == 0) > 0.5 * len(tracks.place_px))


def _shakes(tracks: PointTracks, rests_px: float) -> bool:
    """Whether most points only shift, all alike: the camera moves."""
    place = tracks.place_px[:, np.isfinite(tracks.place_px[..., 0]).any(axis=0)]
    moved = place - place[:, :1]
    off = np.hypot(*np.moveaxis(moved - np.nanmedian(moved, axis=0), 2, 0))
    return float(np.mean(np.nanquantile(off, 0.8, axis=1) < rests_px)) > SHAKEN


def _finer(tracks: PointTracks) -> float:
    """Share of the usual distances that the noise of the followed points permits: neighbours move alike."""
    moved = tracks.place_px - tracks.place_px[:, :1]
    _, near = KDTree(tracks.place_px[:, 0]).query(tracks.place_px[:, 0], 2)
    apart = np.abs(moved - moved[near[:, 1]])[:, 1:]
    noise = 1.4826 * float(np.nanmedian(apart)) / np.sqrt(2.0)
    return float(np.clip(NOISES * noise / USUAL.rests_px, LEAST_FACTOR, 1.0))


def _reason(tracks: PointTracks, groups: Groups) -> str:
    """Why no outline is proposed."""
    n = len(tracks.place_px)
    if n == 0:
        return "no part of the picture has texture that could be followed"
    resting = int(np.count_nonzero(groups.group == 0))
    if len(groups.motions) == 1 and resting > 0.5 * n:
        least = USUAL.rests_px
        return f"{resting} of {n} textured points move by less than {least:g} px and the others not as a rigid body"
    return f"of {n} textured points {n - resting} move, but too few of them as one rigid body with an area of its own"
