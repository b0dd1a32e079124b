"""Track a film: from frames and outlines to angles with uncertainty. The public entrance of tracking.

Steps: average the still frames and build a template per body, state the expected budget, track the bodies frame by
frame, parents first, confirm backward where in doubt, set the zero on the still frames, take out what a calibrated
camera is known to do, turn picture rotations into counter-clockwise angles. Memory does not grow with the film beyond
the result's own columns.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.bodies.outlines import BodiesLike, Body, as_bodies
from vision.errors import VisionWarning
from vision.film.open import open_or_use
from vision.film.source import Corrected, FrameSource
from vision.film.time_scale import count_missing_frames
from vision.fitting.pose_covariance import PATTERN_EXCESS, predicted_u_angle
from vision.keywords import make_options
from vision.reference.camera_faults import DefectCorrectedFilm
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable
from vision.results.track_result import TrackResult
from vision.tracking.assemble_result import Zero, assemble_result, estimate_zero, estimate_zero_from_rows
from vision.tracking.checkpoint import Checkpoint, job_hash
from vision.tracking.field_lag import UNKNOWN_LAG, FieldLag, measure_field_lag
from vision.tracking.film_tracker import FilmTracker
from vision.tracking.moving_parts import confirm_hidden, find_moving_parts
from vision.tracking.options import TrackOptions, TrackSettings
from vision.tracking.passes import confirm_backward, rereference_lost_rows, track_forward
from vision.tracking.picture_stretch import PictureStretch, measure_stretch, prior_stretch_uncertainty
from vision.tracking.prepare import frame_times, prepare
from vision.tracking.repeated_frames import reject_repeated
from vision.tracking.segments import is_thread_safe, segment_starts
from vision.tracking.sensor_pattern import (
    TRACKED_AGAIN,
    PatternCorrectedFilm,
    correct_pattern,
    is_improvement,
    is_pattern_suspected,
    pattern_bias_variance,
    residual_pattern_inflation,
    residual_variance,
)
from vision.tracking.square_film import prepare_square_film
from vision.tracking.workers import usable_threads, workers
from vision.uncertainty.budget_terms import expected_budget
from vision.uncertainty.coherence import inflate_covariance


def track(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: BodiesLike,
    frame_time_s: ArrayLike | None = None,
    **options: Unpack[TrackOptions],
) -> TrackResult:
    """Track rigid bodies through a film from their outlines on its first, still frames: each body's angle, rad,
    counter-clockwise from rest, place, standard uncertainty and flag in every frame; NaN where it is lost.

    Parameters
    ----------
    path_or_source : path or FrameSource
    bodies : sequence of Body, or path
        Outlines on the still frames at the start of the film, or the TOML file that holds them.
    frame_time_s : array_like, shape (n_frames,), optional
        Middle of each exposure, s; the film's own times when None.
    frame_rate_hz : float or None
        True rate of a film that does not state it, or states its play-back rate (`frame_times_at_rate`).
    first_frame, last_frame : int
        Frames that are used, numbered from 0 in the result; all by default. Times are those of the whole film.
    every : int
        Track one frame out of this many; 1 by default.
    n_still : int or None
        Still frames at the start; found from the film when None.
    max_pixels : int or None
        Most pixels fitted per body.
    confirm : {"doubtful", "all", "none"}
        Rows that a second pass, backward in time, must confirm: those around lost, reacquired and freshly covered
        ones (default), all, or none.
    camera : CameraModel, optional
        A calibrated camera corrects the angles; without one `AssumedCamera` stands in the budget.
    u_time_s : float
        Standard uncertainty of the frame times, for the budget.
    rows_per_s : float or None
        Rows that the sensor's rolling shutter reads per second, first the top one, for the budget; infinity for a
        global shutter, None (default) where it is not declared: no film shows it.
    pixel_aspect : float or None
        Width of a pixel over its height; None (default) takes what the film states, else 1.
    deinterlace : bool
        Track one field of interlaced frames, which are refused otherwise.
    first_field : {"even", "odd", "none"}, optional
        Rows of interlaced frames that were exposed first, and are tracked; by the file and the motion when None.
    threads : int or None
        Threads that track parts of the film at the same time; None takes what the computer has, at most 8. The result
        is the same to the bit.
    checkpoint : path, optional
        File that stores the rows done; an interrupted run resumes from it. Removed at the end.
    expected : callable, optional
        Called with the expected budget before the first frame is tracked.
    progress : callable, optional
        Called with (frames done, frames in all).

    Returns
    -------
    TrackResult
        A frame in which a body is lost is NaN with a flag.

    Raises
    ------
    VisionInputError
        Film, outlines, times or settings that cannot be used.

    Examples
    --------
    >>> import vision
    >>> result = vision.track("film.mraw", "bodies.toml", every=10)
    >>> result.bodies, result.angle_rad.shape, result["jack"].shape
    (('whippen', 'jack', 'repetition'), (15, 3), (15,))
    >>> angle_rad, u_rad, flag = result.relative("jack")
    >>> ax = result.plot()
    >>> path = result.save("angles.csv")
    """
    settings = make_options(TrackSettings, "vision.track", options)
    with open_or_use(path_or_source, settings.first_frame, settings.last_frame) as film:
        return _track(film, as_bodies(bodies), frame_time_s, settings)


def _track(
    film: FrameSource, bodies: Sequence[Body], frame_time_s: ArrayLike | None, settings: TrackSettings
) -> TrackResult:
    """Track bodies: passes, fixed pattern, fields, uncertainty; all again where the motion shows another field to be
    first. Writes and removes the checkpoint, gives ``settings.expected`` the budget to expect, warns of faults of the
    film."""
    given = film, bodies, frame_time_s
    time_s, camera = frame_times(film, frame_time_s, settings.frame_rate_hz), settings.camera_model
    u_stretch = prior_stretch_uncertainty(film, settings)
    film, bodies = prepare_square_film(film, bodies, settings)
    threads = settings.threads or usable_threads()
    with workers(threads if is_thread_safe(film) else 1) as crew:
        ready = prepare(film, bodies, settings.n_still, settings.max_pixels, crew.map_items)
    if settings.expected is not None:
        expected = expected_budget(
            ready, camera, settings.u_time_s, rows_per_s=settings.rows_per_s, u_stretch=u_stretch
        )
        settings.expected(expected)
    frame = np.arange(0, film.n_frames, settings.every)
    checkpoint = None
    if settings.checkpoint is not None:
        job = job_hash(film, bodies, (settings.every, segment_starts(film, frame.size)), ready.templates)
        checkpoint = Checkpoint(settings.checkpoint, job)
    done = _run_both_passes(ready, frame, settings, checkpoint)
    ready, done, pattern_grey = _retrack_without_pattern(ready, done, settings)
    table = done.table
    ready, lag, first_field = _settle_fields(ready, table, time_s, settings)
    if first_field is not None:
        return _track(*given, replace(settings, first_field=first_field, expected=None))
    reject_repeated(ready, table)
    doubted = residual_variance(ready, table) > PATTERN_EXCESS
    confirmed = confirm_hidden(ready, table, doubted)
    table.covariance[..., [0, 1, 2], [0, 1, 2]] += pattern_bias_variance(ready, table)
    _reject_untextured(ready, table)
    if ready.skips_blocks:
        warnings.warn(
            f"{film.path}: squares of the picture repeat byte for byte from frame to frame, as codecs leave them that "
            "predict frames; slow motion may be hidden: u is widened; use the film as the camera took it",
            VisionWarning,
            stacklevel=3,
        )
    repeated = np.any(table.flag & np.uint16(int(FrameFlag.REPEATED)), axis=1)
    if repeated.any():
        first = table.frame[repeated][0] + getattr(film, "first_frame", 0)
        warnings.warn(
            f"{film.path}: {int(repeated.sum())} frames repeat the one before (first: {first}) and "
            "are lost (flag 1024); the camera may have dropped frames: check the frame clock",
            VisionWarning,
            stacklevel=3,
        )
    stretch = _measure_stretch(ready, table, settings, u_stretch)
    apart = find_moving_parts(ready, table)
    for name, parts in apart.items():
        if parts.bends:
            warnings.warn(
                f"{film.path}: body {name} bends: its ends move by up to {parts.most_px:.1f} px across its length "
                "against its middle; its angle is a mean over the outline (draw a shorter one there)",
                VisionWarning,
                stacklevel=3,
            )
            continue
        warnings.warn(
            f"{film.path}: body {name}: {100.0 * parts.share:.0f} % of its outline moves by up to {parts.most_px:.1f} "
            f"px against the pose found, most at x {parts.at_px[0]:.0f}, y {parts.at_px[1]:.0f}; the outline lies over "
            "two bodies or one with a joint (draw one outline for each), or a reflection holds the fit",
            VisionWarning,
            stacklevel=3,
        )
    info = {
        **done.info,
        "rows_repeated": int(repeated.sum()),
        "pattern_grey": pattern_grey,
        "rows_uncovered": confirmed,
        "defect_pixels": count_defects(ready),
        "skips_blocks": ready.skips_blocks,
        "delay_frames": ready.delay_frames,
        "first_field": tracked_field(ready),
        "field_lag_frames": lag.frames,
        "missing_after": count_missing_frames(time_s) if settings.every == 1 else {},
        "pixel_aspect": 1.0 if ready.rectified_film is None else ready.rectified_film.aspect,
        "moving_parts": {name: asdict(parts) for name, parts in apart.items()},
    }
    with workers(threads) as crew:
        result = assemble_result(ready, done.zero, table, time_s, settings, info, crew.map_items, stretch.effect)
    _warn_of_delay(result, ready)
    if checkpoint is not None:
        checkpoint.clear()
    return result


def tracked_field(ready: PreparedFilm) -> str:
    """Rows of interlaced frames that are tracked; ``none`` where whole frames are."""
    rectified = ready.rectified_film
    return "none" if rectified is None or rectified.field is None else ("even", "odd")[rectified.field]


def _settle_fields(
    ready: PreparedFilm, table: PoseTable, time_s: NDArray[np.float64], settings: TrackSettings
) -> tuple[PreparedFilm, FieldLag, str | None]:
    """Film with the standard uncertainty of when its rows were exposed, lag of its odd rows by the bodies' motion, and
    field to track instead (None: go on); warns of what the motion shows."""
    film, tracked = ready.film, tracked_field(ready)
    if getattr(film, "has_camera_times", False):
        return ready, UNKNOWN_LAG, None  # cameras that write their own times read whole frames
    lag = measure_field_lag(ready, table, time_s)
    found = lag.first_field
    if found is None:
        return ready, lag, None
    if found == tracked:
        return replace(ready, u_field_frames=0.0), lag, None
    stated = getattr(film, "first_field", None)
    first, later = ("odd", "even") if found == "odd" else ("even", "odd")
    told = (
        f"frames are interlaced: {later} rows were exposed {abs(lag.frames):.2f} frames after the {first} ones (u "
        f"{lag.u:.2f}), as bodies that move show"
        if found != "none"
        else f"all rows of its frames are of one time (they lag by {lag.frames:.2f} frames, u {lag.u:.2f})"
    )
    if tracked == "none":
        words = f"{told}, and its file says nothing of it: angles are about {abs(lag.frames) / 2.0:.2f} frames late, "
        words += "which is in u (term interlace): track one field (`deinterlace`)"
        ready, found = replace(ready, u_field_frames=abs(lag.frames) / 2.0), None
    elif settings.first_field is not None:
        words = f"{told}, {settings.first_field} rows are given as first; what that may cost is in u (term interlace)"
        ready, found = replace(ready, u_field_frames=0.5), None
    elif found == "none":
        words = f"{told}: whole frames are tracked"
    elif stated is not None:
        words = f"{told}; its file says {stated} rows first, {first} ones are tracked"
    else:
        return ready, lag, found
    warnings.warn(f"{film.path}: {words}", VisionWarning, stacklevel=4)
    return ready, lag, found


def count_defects(ready: PreparedFilm) -> int:
    """Number of the sensor's pixels that were replaced by their neighbours."""
    film = ready.film
    while isinstance(film, Corrected) and not isinstance(film, DefectCorrectedFilm):
        film = film.film
    return int(film.rows.size) if isinstance(film, DefectCorrectedFilm) else 0


def _reject_untextured(ready: PreparedFilm, table: PoseTable) -> None:
    """Lose the rows of bodies whose texture cannot be told from noise, with a warning: what fits them fits anywhere."""
    for i, template in enumerate(ready.templates):
        if np.isfinite(predicted_u_angle(template, ready.reference.noise_grey)):
            continue
        warnings.warn(
            f"{ready.film.path}: body {template.name}: the noise ({ready.reference.noise_grey:.1f} grey) hides its "
            "texture, so that all its rows are lost; film with more light, or more frames at rest (`n_still`)",
            VisionWarning,
            stacklevel=4,
        )
        for row in range(table.frame.size):
            table.reject(row, i, FrameFlag.NO_COVARIANCE)


def _measure_stretch(ready: PreparedFilm, table: PoseTable, settings: TrackSettings, u_before: float) -> PictureStretch:
    """The picture's stretch, with a warning where it is significant; 0 without uncertainty for a calibrated camera,
    which has it."""
    if settings.is_calibrated:
        return PictureStretch(0.0, 0.0, False)
    with workers(settings.threads or usable_threads() if is_thread_safe(ready.film) else 1) as crew:
        stretch = measure_stretch(ready, table, u_before, crew.map_items)
    if stretch.is_significant:
        used = 1.0 if ready.rectified_film is None else ready.rectified_film.aspect
        warnings.warn(
            f"{ready.film.path}: bodies change their shape with their angle, as in a picture stretched along x against "
            f"y by {1.0 / stretch.pixel_aspect:.4f} (u {2.0 * stretch.u:.4f}); the error of the angles is in u (term "
            f"aspect). Pixels of width over height {used * stretch.pixel_aspect:.4f}, not {used:g}, would do so "
            "(`pixel_aspect`), and so would a lens or a tilted camera (`camera`), and a body that bends",
            VisionWarning,
            stacklevel=4,
        )
    return stretch


def _warn_of_delay(result: TrackResult, ready: PreparedFilm) -> None:
    """Warn of how late motion may be shown by filtering in time, frames and degrees, where rows are flagged
    `TIME_FILTERED`."""
    late = np.any(result.flag & np.uint16(int(FrameFlag.TIME_FILTERED)), axis=1)
    if not late.any() or not ready.delay_frames:
        return
    most = np.degrees(np.nanmax(result.budget.absolute["lag"]))
    warnings.warn(
        f"{ready.film.path}: the noise of the still frames is correlated in time, as of a camera that averages frames "
        f"(noise reduction, blended frames): motion may be shown up to {ready.delay_frames:.2f} frames late, "
        f"{most:.3f} deg at most; it is in u (term lag), and {int(late.sum())} rows are flagged (8192): switch the "
        "filter off",
        VisionWarning,
        stacklevel=4,
    )


@dataclass(frozen=True)
class _PassResult:
    """Poses and zero of both passes, and what they counted."""

    table: PoseTable
    zero: Zero
    info: dict[str, Any]


def _run_both_passes(
    ready: PreparedFilm, frame: NDArray[np.int64], settings: TrackSettings, checkpoint: Checkpoint | None
) -> _PassResult:
    """Track the film's frames ``frame`` (n,) (indices, rising) forward, backward through doubtful rows, then find lost
    rows with a later reference; return the table of poses, zero and counts; write ``checkpoint`` on the way."""
    table = PoseTable.empty(frame, len(ready.bodies))
    # found as soon as it can be, so that outlines that do not fit the film are refused before the long work
    zeros = [estimate_zero(ready)] if settings.every > 1 else []

    def note_rest() -> None:
        if not zeros:
            zeros.append(estimate_zero_from_rows(ready, table))

    threads = settings.threads or usable_threads()
    tracker = FilmTracker(ready)
    n_still = ready.reference.n_averaged
    resumed = track_forward(tracker, table, checkpoint, settings.progress, n_still, threads, note_rest)
    confirmed = confirm_backward(ready, table, settings.confirm, threads)
    renewed = rereference_lost_rows(ready, table)
    return _PassResult(
        table,
        zeros[0],
        {**tracker.info(), "rows_resumed": resumed, "rows_confirmed": confirmed, "rows_renewed": renewed},
    )


def _retrack_without_pattern(
    ready: PreparedFilm, done: _PassResult, settings: TrackSettings
) -> tuple[PreparedFilm, _PassResult, float]:
    """Track again without the sensor's fixed pattern where there is one; the film and the passes that are better, and
    the root mean square of the pattern taken off, grey, 0 for none."""
    grey = 0.0

    def prepare_again(film: PatternCorrectedFilm) -> PreparedFilm:
        return prepare(film, ready.bodies, ready.reference.n_averaged, settings.max_pixels)

    for _ in range(TRACKED_AGAIN):
        found = correct_pattern(ready, done.table, prepare_again) if is_pattern_suspected(ready, done.table) else None
        if found is None:
            break
        cleaned, pattern = found
        again = _run_both_passes(cleaned, done.table.frame, settings, None)
        if not is_improvement((ready, done.table), (cleaned, again.table), is_first=not grey):
            break
        no_more = int(again.table.is_lost.sum()) == int(done.table.is_lost.sum())
        ready, done = cleaned, replace(again, info={**again.info, "rows_resumed": done.info["rows_resumed"]})
        grey = float(np.sqrt(np.mean(pattern[pattern != 0.0] ** 2)))
        if no_more:
            break
    if grey:
        factor = np.broadcast_to(residual_pattern_inflation(ready, grey), (len(done.table.frame), len(ready.bodies), 3))
        done = replace(done, table=replace(done.table, covariance=inflate_covariance(done.table.covariance, factor)))
    return ready, done, grey
