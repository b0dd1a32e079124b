"""Outlines proposed from the film itself, for the user to inspect and correct.

Meant for the first film of a camera setting; the tracker never uses a proposal that nobody has seen.

Method: textured points are followed through the film (`point_tracks`) and sorted into rigid motions (`motion_groups`),
which fits refine (`refined_motions`); the pixels that each motion explains become its region (`regions`); pins and
overlaps tell parents and layers (`joints`). Bodies that never move relative to each other are one outline; what shows
no texture and no edge is not found.
"""

from __future__ import annotations

import numpy as np

from vision.bodies.outlines import Body
from vision.errors import TrackingError
from vision.film.source import FrameSource
from vision.proposals.joints import layers_of, parents_of
from vision.proposals.motion_groups import RESTS_PX, Groups, group_by_motion
from vision.proposals.point_tracks import PointTracks, track_points
from vision.proposals.refined_motions import refined
from vision.proposals.regions import outlines, regions

LEAST_FRAMES = 4


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
    groups = refined(tracks, group_by_motion(tracks))
    found = regions(tracks, groups) if len(groups.motions) > 1 else []
    polygons = outlines([mask for _, mask in found])
    kept = [(region, polygon) for region, polygon in zip(found, polygons, strict=True) if polygon is not None]
    if not kept:
        raise TrackingError(f"{film.path}: {_reason(tracks, groups)}; draw outlines by hand")
    parents = parents_of([region for region, _ in kept])
    layers = layers_of(tracks, groups.key, [region for region, _ in kept])
    names = [f"body{i + 1}" for i in range(len(kept))]
    return [
        Body(name, polygon, None if parent is None else names[parent], layer)
        for name, (_, polygon), parent, layer in zip(names, kept, parents, layers, strict=True)
    ]


def _reason(tracks: PointTracks, groups: Groups) -> str:
    """Why no outline is proposed."""
    n = len(tracks.place_px)
    if n == 0:
        return "no part of the picture has texture that could be followed"
    resting = int(np.count_nonzero(groups.group == 0))
    if len(groups.motions) == 1 and resting > 0.5 * n:
        return f"{resting} of {n} textured points move by less than {RESTS_PX:g} px and the others not as a rigid body"
    return f"of {n} textured points {n - resting} move, but too few of them as one rigid body with an area of its own"
