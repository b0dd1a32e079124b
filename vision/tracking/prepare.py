"""Prepare tracking: frame times, static frames, averaged reference, templates."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.bodies.masks import exclude_saturated, masks_from_distances, outline_distances
from vision.bodies.occlusion import Occlusion
from vision.bodies.outlines import Body
from vision.errors import VisionInputError, VisionWarning
from vision.film.source import FrameSource
from vision.film.time_scale import frame_times_at_rate, warn_of_uneven_times
from vision.fitting.template import build_template
from vision.item_map import ItemMap, serial_map
from vision.reference.camera_faults import (
    DefectCorrectedFilm,
    FlickerCorrectedFilm,
    correct_defects,
    correct_row_flicker,
    find_grey_step,
    skips_blocks,
)
from vision.reference.first_light import check_first_light
from vision.reference.prepared_film import PreparedFilm
from vision.reference.rectified_film import RectifiedFilm
from vision.reference.still_average import FIRST_AVERAGED, Reference, average_still_frames, count_still_frames
from vision.reference.temporal_noise import estimate_delay_frames
from vision.tracking.film_tracker import FilmTracker, track_first_frames
from vision.tracking.options import MAX_PIXELS
from vision.tracking.sensor_pattern import PatternCorrectedFilm

WANTED_STILL = 10  # static frames that a reference should average
U_FIELD_ORDER = 0.5 / math.sqrt(2.0)
"""Frames: the even rows of interlaced frames are exposed at their time or half a frame later."""


def prepare(
    film: FrameSource,
    bodies: Sequence[Body],
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    map_items: ItemMap = serial_map,
) -> PreparedFilm:
    """Average the first ``n_still`` frames (None: as many as are still), build masks and templates, of at most
    ``max_pixels`` each, and return the prepared film, less its defect pixels and row flicker. Warns of few or moving
    still frames.

    Warns
    -----
    VisionWarning
        When fewer than ten still frames are found.
    """
    distances = outline_distances(bodies, film.height, film.width, map_items)
    masks = masks_from_distances(bodies, distances)
    region = np.logical_or.reduce(masks)
    check_first_light(film, region)
    film, still = _correct_and_average(film, region, n_still, map_items)

    def build_prepared(reference: Reference) -> PreparedFilm:
        usable = exclude_saturated(bodies, masks, reference.saturated)
        templates = map_items(
            lambda i: build_template(
                *(bodies[i].name, reference.picture, usable[i], reference.n_averaged, max_pixels, reference.noise_grey)
            ),
            range(len(bodies)),
        )
        occlusion = Occlusion(bodies, templates, distances)
        found = PreparedFilm(film, bodies, reference, templates, occlusion)
        field = found.rectified_film
        if field is not None and field.field is not None and field.first_field is None:
            found = replace(found, u_field_frames=U_FIELD_ORDER)
        box = _bounding_box(region)
        skips = skips_blocks(film, box, reference.noise_grey)
        return replace(found, skips_blocks=skips, grey_step=find_grey_step(film, box))

    def measure_delay(found: PreparedFilm) -> PreparedFilm:
        predicted = found.film.compression is not None and found.film.compression.steps is None
        if predicted or found.skips_blocks:
            return found  # the noise of frames predicted from others is correlated whatever the camera did
        return replace(found, delay_frames=estimate_delay_frames(found.film, found.reference.n_averaged))

    if n_still is None:
        candidates = still.n_averaged
        first = build_prepared(average_still_frames(film, region, min(FIRST_AVERAGED, candidates)))
        pose, u = track_first_frames(FilmTracker(first), candidates)
        n_still = count_still_frames(pose.reshape(candidates, -1), u.reshape(candidates, -1))
        if n_still < WANTED_STILL:
            warnings.warn(
                f"{film.path}: only {n_still} still frames at the start, {WANTED_STILL} wanted; the zero is less sure",
                VisionWarning,
                stacklevel=4,
            )
        still = average_still_frames(film, region, n_still)
    elif n_still > FIRST_AVERAGED and not isinstance(film, PatternCorrectedFilm):
        first = build_prepared(average_still_frames(film, region, FIRST_AVERAGED))
        _warn_of_motion(first, n_still)
    return measure_delay(build_prepared(still))


def _warn_of_motion(ready: PreparedFilm, n_still: int) -> None:
    """Warn of each body that moves or is lost within the first ``n_still`` frames, which the user has given as
    still."""
    pose, u = track_first_frames(FilmTracker(ready), n_still)
    for i, template in enumerate(ready.templates):
        count = count_still_frames(pose[:, i], u[:, i])
        if count == n_still:
            continue
        way = pose[count:, i] - pose[:count, i].mean(axis=0)
        if np.isfinite(way).all(axis=1).any():
            turn, px = np.degrees(np.nanmax(np.abs(way[:, 0]))), np.nanmax(np.hypot(way[:, 1], way[:, 2]))
            what = f"moves from about frame {count} on, by up to {turn:.3f} deg and {px:.2f} px"
        else:
            what = f"is lost from frame {count} on"
        warnings.warn(
            f"{ready.film.path}: body {template.name} {what}, within the {n_still} frames given as still: the zero of "
            f"its angle is off by part of that; give `n_still` {count}, or leave it out",
            VisionWarning,
            stacklevel=5,
        )


def _correct_and_average(
    film: FrameSource, region: NDArray[np.bool_], n_still: int | None, map_items: ItemMap
) -> tuple[FrameSource, Reference]:
    """The film, less its defect pixels and its rows' flicker where it has any, and the average of its still frames."""
    if isinstance(film, DefectCorrectedFilm | PatternCorrectedFilm | FlickerCorrectedFilm | RectifiedFilm):
        return film, average_still_frames(film, region, n_still)
    # most films have none, so that the average need not wait for the answer
    found: list[Any] = map_items(
        lambda work: work(), [lambda: correct_defects(film), lambda: average_still_frames(film, region, n_still)]
    )
    without, still = found
    cleaned = correct_row_flicker(without, _bounding_box(region))
    return cleaned, still if cleaned is film else average_still_frames(cleaned, region, n_still)


def _bounding_box(region: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Rectangle (y0, y1, x0, x1) of a region."""
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def frame_times(
    film: FrameSource, given_s: ArrayLike | None, frame_rate_hz: float | None = None
) -> NDArray[np.float64]:
    """Time of each frame, s, shape (n_frames,): those given, by the rate, or the film's own; warns of uneven ones,
    `VisionInputError` where there are none or they do not increase."""
    if frame_rate_hz is not None:
        if given_s is not None:
            raise VisionInputError(f"{film.path}: `frame_rate_hz` and `frame_time_s` are given; leave one out")
        return frame_times_at_rate(film, frame_rate_hz)
    if given_s is None:
        own = film.frame_time_s
        if own is None:
            raise VisionInputError(f"{film.path}: the film states no frame rate; give it (`frame_rate_hz`)")
        warn_of_uneven_times(film, own)
        return own
    time_s = as_numbers(given_s, f"{film.path}: frame times")
    if time_s.shape != (film.n_frames,):
        raise VisionInputError(f"{film.path}: {time_s.size} frame times for {film.n_frames} frames; give one per frame")
    if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0.0):
        raise VisionInputError(f"{film.path}: frame times must be finite and increase from frame to frame")
    warn_of_uneven_times(film, time_s)
    return time_s
