"""Track a film: from frames and outlines to angles with uncertainty.

Place in the data flow: the public entrance of the package, `track_film`; the session stores what it returns.

Steps: average the still frames and build a template per body (`preparation`), state the expected budget, follow
the bodies frame by frame, parents first, and confirm backward where in doubt (`following`), set the zero on the
still frames, take out what a calibrated camera is known to do, turn picture rotations into counter-clockwise
angles. Memory does not grow with the film beyond the result's own columns. Failure: a film or outlines that
cannot be tracked raise `InputError`; a frame that fails is NaN with a flag.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import ccw_to_picture, picture_to_ccw
from vision.bodies.outlines import Body
from vision.camera.model import AssumedCamera, CameraModel
from vision.errors import InputError, TrackingError, VisionWarning
from vision.film.source import FrameSource, open_film
from vision.fitting.pose_covariance import predicted_u_angle
from vision.tracking.budget_terms import budget_of, expected_budget
from vision.tracking.checkpoint import Checkpoint, job_of
from vision.tracking.flags import FrameFlag
from vision.tracking.frame_step import first_poses
from vision.tracking.passes import CONFIRM, confirm_backward, fit_alone, follow
from vision.tracking.pose_table import PoseTable
from vision.tracking.prepare import MAX_PIXELS, Preparation, prepare
from vision.tracking.result import TrackResult
from vision.uncertainty.budget import ErrorBudget
from vision.uncertainty.pose_response import PoseResponse

PRECISE_U_RAD = np.radians(0.05) / 4.0
"""Above this an error of 0.05 degrees is less than four standard uncertainties away."""
FIRST_ORDER_RADIAL = 0.006
"""Beyond this distortion pixels of one body move so differently that the weights leave some of them out."""
METHODS = ("icgn", "ecc")
Places = Mapping[str, tuple[float, float, float]]
"""Where bodies are, by name: angle (rad, counter-clockwise from the zero), x and y of the region's centre (px)."""


def track_film(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    frame_time_s: ArrayLike | None = None,
    *,
    method: str = "icgn",
    every: int = 1,
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    confirm: str = "doubtful",
    camera: CameraModel | None = None,
    u_time_s: float = 0.0,
    checkpoint: str | os.PathLike[str] | None = None,
    expected: Callable[[ErrorBudget], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Track rigid bodies through a film.

    Parameters
    ----------
    path_or_source : path or FrameSource
    bodies : sequence of Body
        Outlines on the still frames at the start of the film.
    frame_time_s : array_like, shape (n_frames,), optional
        Middle of each exposure, s; the film's own times when None.
    method : {"icgn", "ecc"}
        Gauss-Newton with weights (default), or OpenCV's masked ECC.
    every : int
        Track every so manieth frame.
    n_still : int or None
        Still frames at the start; found from the film when None.
    max_pixels : int or None
        Most pixels fitted per body.
    confirm : {"doubtful", "all", "none"}
        Rows that a second pass, backward in time, must confirm: those around lost, found-again and freshly
        covered ones, all, or none.
    camera : CameraModel, optional
        A calibrated camera corrects the angles; without one `AssumedCamera` stands in the budget.
    u_time_s : float
        Standard uncertainty of the frame times, for the budget.
    checkpoint : path, optional
        File that keeps what is done; a run that was interrupted goes on from it. Removed at the end.
    expected : callable, optional
        Called with the budget to expect before the first frame is tracked.
    progress : callable, optional
        Called with (frames done, frames in all).

    Returns
    -------
    TrackResult

    Raises
    ------
    InputError
        Film, outlines, times or settings that cannot be used.
    """
    if method not in METHODS:
        raise InputError(f"method {method!r} is not known; choose {' or '.join(METHODS)}")
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise InputError(f"every = {every!r}; needs a whole number of at least 1")
    if confirm not in CONFIRM:
        raise InputError(f"confirm = {confirm!r}; choose {', '.join(CONFIRM)}")
    if not 0.0 <= u_time_s < np.inf:
        raise InputError(f"u_time_s = {u_time_s!r}; needs a standard uncertainty of at least 0 s")
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as opened:
            return track_film(
                opened, bodies, frame_time_s, method=method, every=every, n_still=n_still, max_pixels=max_pixels,
                confirm=confirm, camera=camera, u_time_s=u_time_s, checkpoint=checkpoint, expected=expected,
                progress=progress,
            )  # fmt: skip
    film, camera = path_or_source, camera or AssumedCamera()
    time_s = _times(film, frame_time_s)
    nominal = camera.nominal(film.width, film.height)
    if nominal is not None and abs(nominal.radial) > FIRST_ORDER_RADIAL:
        warnings.warn(
            f"{film.path}: the lens distorts by {100 * nominal.radial:.2f} % at the corner; above "
            f"{100 * FIRST_ORDER_RADIAL:g} % the correction of angles is good to about 10 mdeg only: use a longer lens",
            VisionWarning,
            stacklevel=2,
        )
    ready = prepare(film, bodies, n_still, max_pixels, method)
    if expected is not None:
        expected(expected_budget(ready, camera, u_time_s))
    # first, so that outlines that do not fit the film are refused before the long work
    still = _zero_of_still_frames(ready)
    table = PoseTable.empty(np.arange(0, film.n_frames, every), len(bodies))
    keep = None
    if checkpoint is not None:
        keep = Checkpoint(checkpoint, job_of(film, bodies, (method, every), ready.templates))
    run = ready.run()
    resumed = follow(run, table, keep, progress)
    again = confirm_backward(ready, table, confirm)
    info = {**run.info(ready.reference), "rows_resumed": resumed, "rows_confirmed": again}
    result = _result(ready, still, table, time_s, camera, u_time_s, info)
    if keep is not None:
        keep.clear()
    return result


def retrack_frames(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    frames: Sequence[int],
    places: Sequence[Places],
    frame_time_s: ArrayLike | None = None,
    *,
    method: str = "icgn",
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    camera: CameraModel | None = None,
    u_time_s: float = 0.0,
) -> TrackResult:
    """Fit single frames again, each by itself, from places the user has corrected.

    Parameters
    ----------
    frames : sequence of int
        Frame numbers.
    places : sequence of dict
        Per frame: body name to (angle rad, x px, y px) from which the fit starts; every body must be named.
        A good neighbour's row, or the eye, is near enough: 4 degrees and 4 px, with a wide search behind it.
    others
        As for `track_film`, and with the same values; the zero is found anew from the still frames.

    Returns
    -------
    TrackResult
        With the rows of ``frames`` only; frames that still fail are NaN with a flag. Terms of the budget that
        need neighbouring frames (shutter, synchronisation) are zero.
    """
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as opened:
            return retrack_frames(
                opened, bodies, frames, places, frame_time_s, method=method, n_still=n_still, max_pixels=max_pixels,
                camera=camera, u_time_s=u_time_s,
            )  # fmt: skip
    film, camera = path_or_source, camera or AssumedCamera()
    time_s = _times(film, frame_time_s)
    wrong = [frame for frame in frames if not 0 <= frame < film.n_frames]
    if wrong or not len(frames) or len(frames) != len(places):
        found = f"frame {wrong[0]}" if wrong else f"{len(frames)} frames with {len(places)} places"
        raise InputError(f"{film.path}: {found} to track again; allowed 0..{film.n_frames - 1}, one place per frame")
    ready = prepare(film, bodies, n_still, max_pixels, method)
    still = _zero_of_still_frames(ready)
    zero = still[0]
    table = PoseTable.empty(np.array(frames, dtype=np.int64), len(bodies))
    for row, place in enumerate(places):
        poses = []
        for i, template in enumerate(ready.templates):
            if template.name not in place or not np.all(np.isfinite(place[template.name])):
                raise InputError(f"{film.path}: frame {frames[row]}: no place given for body {template.name}")
            angle, x, y = place[template.name]
            phi = float(ccw_to_picture(angle)) + zero[i]
            poses.append(np.array([phi, x - template.centre_px[0], y - template.centre_px[1]]))
        fit_alone(ready, table, row, poses)
    return _result(ready, still, table, time_s, camera, u_time_s, {"retracked": list(frames)})


Zero = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]


def _result(
    ready: Preparation,
    still: Zero,
    table: PoseTable,
    time_s: NDArray[np.float64],
    camera: CameraModel,
    u_time_s: float,
    info: dict[str, object],
) -> TrackResult:
    """Angles, uncertainties and budget from the poses."""
    film, bodies, reference = ready.film, ready.bodies, ready.reference
    zero, u_single, good = still[0], still[1].copy(), still[2]
    # a still frame agrees too well with the average it is part of, so the others tell the noise of one frame
    others = table.u_turn[table.frame >= reference.n_averaged]
    known = np.isfinite(others).sum(axis=0) > 0
    u_single[known] = np.nanmedian(others[:, known], axis=0)
    u_common = u_single / np.sqrt(good)
    pose = table.pose.copy()
    pose[..., 0] -= zero
    nominal = camera.nominal(film.width, film.height)
    if nominal is not None:
        for i, template in enumerate(ready.templates):
            pose[:, i, 0] = PoseResponse(template).without_error(nominal, pose[:, i])
    angle = picture_to_ccw(pose[..., 0])
    u_angle = np.hypot(table.u_turn, u_common)
    flag = table.flag.copy()
    flag[u_angle > PRECISE_U_RAD] |= np.uint16(int(FrameFlag.IMPRECISE))
    rows_time_s = time_s[table.frame]
    centre = np.array([template.centre_px for template in ready.templates])
    return TrackResult(
        bodies=tuple(body.name for body in bodies),
        parents=tuple(body.parent for body in bodies),
        frame=table.frame,
        time_s=rows_time_s,
        angle_rad=angle,
        u_angle_rad=u_angle,
        u_common_rad=u_common,
        x_px=centre[:, 0] + table.pose[..., 1],
        y_px=centre[:, 1] + table.pose[..., 2],
        zncc=table.zncc,
        inlier=table.inlier,
        noise_grey=table.noise_grey,
        flag=flag,
        predicted_u_rad=np.array([predicted_u_angle(t, reference.noise_grey) for t in ready.templates]),
        covariance=table.covariance,
        budget=budget_of(ready, camera, pose, rows_time_s, angle, table.u_turn, u_common, u_time_s),
        n_still=reference.n_averaged,
        method=ready.method,
        film=str(film.path),
        info=info,
    )


def _zero_of_still_frames(ready: Preparation) -> Zero:
    """Mean picture rotation of each body over the still frames, standard uncertainty of one frame, frames counted."""
    n = ready.reference.n_averaged
    pose, u = first_poses(ready.run(), n)
    good = np.count_nonzero(np.isfinite(pose[..., 0]), axis=0)
    for i, body in enumerate(ready.bodies):
        if 2 * good[i] < n:
            raise TrackingError(
                f"{ready.film.path}: body {body.name} is found in {good[i]} of the {n} still frames; "
                "check its outline against the first frame"
            )
    return np.nanmean(pose[..., 0], axis=0), np.sqrt(np.nanmean(u[..., 0] ** 2, axis=0)), good


def _times(film: FrameSource, frame_time_s: ArrayLike | None) -> NDArray[np.float64]:
    if frame_time_s is None:
        own = film.frame_time_s
        if own is None:
            raise InputError(f"{film.path}: the film states no frame rate; give the time of each frame (--frame-rate)")
        return own
    time_s = np.asarray(frame_time_s, dtype=float)
    if time_s.shape != (film.n_frames,):
        raise InputError(f"{film.path}: {time_s.size} frame times for {film.n_frames} frames; give one per frame")
    if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0.0):
        raise InputError(f"{film.path}: frame times must be finite and increase from frame to frame")
    return time_s
