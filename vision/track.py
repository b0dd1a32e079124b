"""Track a film: from frames and outlines to angles with uncertainty.

Place in the data flow: the public entrance of the package, `track_film`; the session stores what it returns.

Steps: average the still frames, build a template per body, follow the bodies frame by frame (parents first),
set the zero on the still frames, turn picture rotations into counter-clockwise angles. Memory does not grow
with the film beyond the result's own columns. Failure: a film or outlines that cannot be tracked raise
`InputError`; a frame that fails is NaN with a flag.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import picture_to_ccw
from vision.bodies import Body
from vision.errors import InputError, TrackingError
from vision.flags import FAILURE
from vision.frames import FrameSource, open_film
from vision.preparation import MAX_PIXELS, prepare
from vision.reference import Reference
from vision.results import TrackResult
from vision.run import Run, first_poses
from vision.uncertainty import predicted_u_angle

METHODS = ("icgn", "ecc")


def track_film(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    frame_time_s: ArrayLike | None = None,
    *,
    method: str = "icgn",
    every: int = 1,
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
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
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as opened:
            return track_film(
                opened, bodies, frame_time_s, method=method, every=every, n_still=n_still, max_pixels=max_pixels,
                progress=progress,
            )  # fmt: skip
    film = path_or_source
    time_s = _times(film, frame_time_s)
    reference, templates = prepare(film, bodies, n_still, max_pixels, method)
    predicted = np.array([predicted_u_angle(template, reference.noise_grey) for template in templates])
    run = Run(film, bodies, templates, method)
    frames = np.arange(0, film.n_frames, every)
    zero, u_single, good = _zero_of_still_frames(run, reference)
    run.restart()
    n, m = frames.size, len(bodies)
    columns = {name: np.full((n, m), np.nan) for name in ("phi", "u", "x", "y", "zncc", "inlier", "noise")}
    flag = np.zeros((n, m), dtype=np.uint8)
    for step, index in enumerate(frames):
        run.step(int(index), step)
        for i, follower in enumerate(run.followers):
            flag[step, i] = int(follower.flag)
            if follower.flag & FAILURE:
                continue
            fit = follower.fit
            columns["phi"][step, i] = fit.pose[0]
            columns["u"][step, i] = np.sqrt(fit.covariance[0, 0])
            columns["x"][step, i] = follower.template.centre_px[0] + fit.pose[1]
            columns["y"][step, i] = follower.template.centre_px[1] + fit.pose[2]
            columns["zncc"][step, i] = fit.zncc
            columns["inlier"][step, i] = fit.inlier
            columns["noise"][step, i] = fit.noise_grey
        if progress is not None:
            progress(step + 1, n)
    # a still frame agrees too well with the average it is part of, so the others tell the noise of one frame
    others = columns["u"][frames >= reference.n_averaged]
    known = np.isfinite(others).sum(axis=0) > 0
    u_single[known] = np.nanmedian(others[:, known], axis=0)
    u_common = u_single / np.sqrt(good)
    return TrackResult(
        bodies=tuple(body.name for body in bodies),
        parents=tuple(body.parent for body in bodies),
        frame=frames,
        time_s=time_s[frames],
        angle_rad=picture_to_ccw(columns["phi"] - zero),
        u_angle_rad=np.hypot(columns["u"], u_common),
        u_common_rad=u_common,
        x_px=columns["x"],
        y_px=columns["y"],
        zncc=columns["zncc"],
        inlier=columns["inlier"],
        noise_grey=columns["noise"],
        flag=flag,
        predicted_u_rad=predicted,
        n_still=reference.n_averaged,
        method=method,
        film=str(film.path),
        info=run.info(reference),
    )


def _zero_of_still_frames(
    run: Run, reference: Reference
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Mean picture rotation of each body over the still frames, standard uncertainty of one frame, frames counted."""
    n = reference.n_averaged
    pose, u = first_poses(run, n)
    good = np.count_nonzero(np.isfinite(pose[..., 0]), axis=0)
    for i, body in enumerate(run.bodies):
        if 2 * good[i] < n:
            raise TrackingError(
                f"{run.film.path}: body {body.name} is found in {good[i]} of the {n} still frames; "
                "check its outline against the first frame"
            )
    return np.nanmean(pose[..., 0], axis=0), np.sqrt(np.nanmean(u[..., 0] ** 2, axis=0)), good


def _times(film: FrameSource, frame_time_s: ArrayLike | None) -> NDArray[np.float64]:
    if frame_time_s is None:
        own = film.frame_time_s
        if own is None:
            raise InputError(f"{film.path}: the film states no frame rate; give the time of each frame")
        return own
    time_s = np.asarray(frame_time_s, dtype=float)
    if time_s.shape != (film.n_frames,):
        raise InputError(f"{film.path}: {time_s.size} frame times for {film.n_frames} frames; give one per frame")
    if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0.0):
        raise InputError(f"{film.path}: frame times must be finite and increase from frame to frame")
    return time_s
