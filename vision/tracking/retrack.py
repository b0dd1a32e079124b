"""Fit single frames: again from corrected poses, or a preview before the whole film is tracked."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import ccw_to_picture
from vision.bodies.outlines import BodiesLike, as_bodies
from vision.errors import VisionInputError
from vision.film.open import open_or_use
from vision.film.source import FrameSource
from vision.fitting.pose_covariance import PATTERN_EXCESS
from vision.keywords import make_options
from vision.reference.prepared_film import PreparedFilm
from vision.results.pose_table import PoseTable
from vision.results.track_result import TrackResult
from vision.tracking.assemble_result import Zero, assemble_result, estimate_zero
from vision.tracking.moving_parts import confirm_hidden
from vision.tracking.options import FitOptions, FitSettings
from vision.tracking.passes import refit_row
from vision.tracking.picture_stretch import prior_stretch_uncertainty
from vision.tracking.prepare import frame_times, prepare
from vision.tracking.segments import find_segment_starts
from vision.tracking.sensor_pattern import residual_variance
from vision.tracking.square_film import prepare_square_film

Places = Mapping[str, tuple[float, float, float]]
"""Where bodies are, by name: angle (rad, counter-clockwise from the zero), x and y of the region's centre (px)."""


def retrack_frames(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: BodiesLike,
    frames: Sequence[int],
    places: Sequence[Places],
    frame_time_s: ArrayLike | None = None,
    **options: Unpack[FitOptions],
) -> TrackResult:
    """Fit the frames numbered ``frames`` again, each by itself, from ``places``: per frame a dict of every body's name
    to (angle, rad, counter-clockwise, x and y, px), as in the result. Rows of these frames only; NaN with a flag where
    that fails.

    Parameters
    ----------
    path_or_source, bodies, frame_time_s
        As for `track`.
    frames : sequence of int
        Frame numbers.
    places : sequence of dict
        Per frame: body name to (angle rad, x px, y px) from which the fit starts; every body must be named. The row
        of a good neighbour, or an estimate by eye, is near enough: 4 degrees and 4 px, backed by a wide search.
    frame_rate_hz, first_frame, last_frame, n_still, max_pixels
        As for `track`.
    camera, u_time_s, rows_per_s, pixel_aspect, deinterlace, first_field
        As for `track`, and with the same values; the zero is found anew from the still frames.

    Returns
    -------
    TrackResult
        With the rows of ``frames`` only; frames that still fail are NaN with a flag. The frames beside each are fitted
        for the terms of the budget that need the motion (shutter, rows, synchronisation).

    Raises
    ------
    VisionInputError
        Frames that the film has not, or that are named twice; places that do not name every body; or as for `track`.

    Examples
    --------
    >>> import vision
    >>> bodies = vision.load_bodies("bodies.toml")
    >>> first = vision.track("film.mraw", bodies, every=10)
    >>> angle, x, y = first.angle_rad[5], first.x_px[5], first.y_px[5]
    >>> near = {body: (angle[k], x[k], y[k]) for k, body in enumerate(first.bodies)}
    >>> vision.retrack_frames("film.mraw", bodies, [50], [near]).frame
    array([50])
    """
    settings = make_options(FitSettings, "vision.retrack_frames", options)
    with open_or_use(path_or_source, settings.first_frame, settings.last_frame) as film:
        time_s = frame_times(film, frame_time_s, settings.frame_rate_hz)
        wrong = [frame for frame in frames if not 0 <= frame < film.n_frames]
        if wrong or not len(frames) or len(frames) != len(places) or len(set(frames)) < len(frames):
            found = f"frame {wrong[0]}" if wrong else f"{len(frames)} frames with {len(places)} places"
            raise VisionInputError(
                f"{film.path}: {found} to track again; allowed 0..{film.n_frames - 1}, each once, one place per frame"
            )
        u_stretch = prior_stretch_uncertainty(film, settings)
        film, bodies = prepare_square_film(film, as_bodies(bodies), settings)
        ready = prepare(film, bodies, settings.n_still, settings.max_pixels)
        zero = estimate_zero(ready)

        start: dict[int, list[NDArray[np.float64]]] = {}
        for frame, place in zip(frames, places, strict=True):
            pose = []
            for template, zero_rad in zip(ready.templates, zero.turn_rad, strict=True):
                there = np.ravel(place.get(template.name, ()))
                if there.size != 3 or not np.all(np.isfinite(there)):
                    raise VisionInputError(f"{film.path}: frame {frame}: no place given for body {template.name}")
                angle, x, y = there.tolist()
                if ready.rectified_film is not None:
                    x, y = ready.rectified_film.rectify(np.array([x, y])).tolist()
                phi = float(ccw_to_picture(angle)) + zero_rad
                pose.append(np.array([phi, x - template.centre_px[0], y - template.centre_px[1]]))
            start[int(frame)] = pose
        return _fit_frames(ready, zero, frames, start, time_s, settings, u_stretch, "retracked")


def preview(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: BodiesLike,
    count: int = 3,  # choice: after a third, two thirds, and the last
    frame_time_s: ArrayLike | None = None,
    **options: Unpack[FitOptions],
) -> TrackResult:
    """Fit ``count`` frames at equal distances up to the last, the first left out, to see whether outlines and film suit
    each other before all is tracked; rows of these frames only, lost from where a walk to them loses a body.

    Parameters
    ----------
    path_or_source, bodies, frame_time_s
        As for `track`.
    count : int
        Frames, spread over the film up to its last.
    frame_rate_hz, first_frame, last_frame, n_still, max_pixels
        As for `track`.
    camera, u_time_s, rows_per_s, pixel_aspect, deinterlace, first_field
        As for `track`.

    Returns
    -------
    TrackResult
        With the rows of these frames only, as of `retrack_frames`. A quick walk finds where the bodies are; from where
        it loses one, all further frames are lost.

    Raises
    ------
    VisionInputError
        Fewer than one frame, or as for `track`.

    Examples
    --------
    >>> import vision
    >>> result = vision.preview("film.mraw", vision.load_bodies("bodies.toml"), 3)
    >>> len(result.frame), int(result.is_lost.sum())
    (3, 0)
    """
    settings = make_options(FitSettings, "vision.preview", options)
    with open_or_use(path_or_source, settings.first_frame, settings.last_frame) as film:
        time_s = frame_times(film, frame_time_s, settings.frame_rate_hz)
        if isinstance(count, bool) or count < 1:
            raise VisionInputError(f"{film.path}: {count} frames to preview; allowed 1..{film.n_frames - 1}")
        u_stretch = prior_stretch_uncertainty(film, settings)
        film, bodies = prepare_square_film(film, as_bodies(bodies), settings)
        ready = prepare(film, bodies, settings.n_still, settings.max_pixels)
        chosen = np.unique(np.rint(np.linspace(0, film.n_frames - 1, count + 1)[1:]).astype(np.int64))
        walked = find_segment_starts(ready, np.arange(film.n_frames), (chosen + 1).tolist())
        start = {frame: list(pose) for frame, (_, pose) in zip(chosen.tolist(), walked, strict=False)}
        return _fit_frames(ready, estimate_zero(ready), chosen, start, time_s, settings, u_stretch, "preview")


def _fit_frames(
    ready: PreparedFilm,
    zero: Zero,
    frames: ArrayLike,
    start_poses: Mapping[int, Sequence[NDArray[np.float64]]],
    time_s: NDArray[np.float64],
    settings: FitSettings,
    u_stretch: float,
    info_key: str,
) -> TrackResult:
    """Fit some ``frames`` (k,), and those beside each, from the poses (turn, x, y) of all bodies by frame; a frame
    without poses is lost. The result has the rows of ``frames`` only.

    ``u_stretch``: standard uncertainty of the picture's stretch, which few frames do not measure; ``info_key``: entry
    of the result's ``info`` under which the frames are listed.
    """
    frames, start, last = np.asarray(frames, dtype=np.int64), dict(start_poses), time_s.size - 1
    for frame, pose in start_poses.items():
        first = min(max(frame - 1, 0), max(last - 2, 0))
        start = dict.fromkeys(range(first, min(first + 2, last) + 1), pose) | start
    rows = np.unique([*start, *frames])
    table = PoseTable.empty(rows, len(ready.bodies))
    for row in np.flatnonzero(np.isin(rows, list(start))).tolist():
        refit_row(ready, table, row, start[int(rows[row])])
    confirm_hidden(ready, table, residual_variance(ready, table) > PATTERN_EXCESS)
    result = assemble_result(ready, zero, table, time_s, settings, {info_key: frames.tolist()}, u_stretch=u_stretch)
    return _select_rows(result, np.searchsorted(rows, frames))


def _select_rows(result: TrackResult, rows: NDArray[np.intp]) -> TrackResult:
    """The result with some of its rows only, by their indices (k,), in this order."""
    of_rows = ("frame", "time_s", "angle_rad", "u_angle_rad", "x_px", "y_px", "zncc", "inlier", "noise_grey")
    chosen = {name: getattr(result, name)[rows] for name in (*of_rows, "flag", "covariance")}
    budget = result.budget
    absolute, relative = (
        {name: term[rows] for name, term in terms.items()} for terms in (budget.absolute, budget.relative)
    )
    return replace(result, **chosen, budget=replace(budget, absolute=absolute, relative=relative))
