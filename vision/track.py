"""Track a film: from frames and outlines to angles with uncertainty.

Place in the data flow: the public entrance of the package, `track_film`; the session stores what it returns.

Steps: average the still frames, build a template per body, follow the bodies frame by frame (parents first),
set the zero on the still frames, turn picture rotations into counter-clockwise angles. Memory does not grow
with the film beyond the result's own columns. Failure: a film or outlines that cannot be tracked raise
`InputError`; a frame that fails is NaN with a flag.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import picture_to_ccw
from vision.bodies import Body, build_masks, parents_first
from vision.covering import Covering
from vision.errors import InputError, TrackingError, VisionWarning
from vision.fit import Fitter
from vision.flags import FAILURE
from vision.follower import Follower
from vision.frames import Film, FrameSource, open_film
from vision.reference import Reference, average_still_frames
from vision.results import TrackResult
from vision.stillness import still_count
from vision.template import Template, build_template
from vision.uncertainty import predicted_u_angle

METHODS = ("icgn", "ecc")
WANTED_STILL = 10
FIRST_LOOK = 4
"""Frames averaged for the first template, with which the still frames are counted."""
MAX_PIXELS = 12_000
"""Pixels fitted per body; beyond this the ones that tell least about the angle are left out."""


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
    run = _Run(film, bodies, templates, method)
    frames = np.arange(0, film.n_frames, every)
    zero, u_common = _zero_of_still_frames(run, reference)
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


def prepare(
    film: FrameSource,
    bodies: Sequence[Body],
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    method: str = "icgn",
) -> tuple[Reference, list[Template]]:
    """Average the still frames and build the bodies' templates; shared by tracking and prediction.

    Warns
    -----
    VisionWarning
        When fewer than ten still frames are found.
    """
    masks = build_masks(bodies, film.height, film.width)
    region = np.logical_or.reduce(masks)

    def templates_of(reference: Reference) -> list[Template]:
        return [
            build_template(
                body.name, reference.picture, mask, reference.n_averaged, max_pixels, reference.noise_grey
            )
            for body, mask in zip(bodies, masks, strict=True)
        ]

    if n_still is None:
        candidates = average_still_frames(film, region).n_averaged
        first = average_still_frames(film, region, min(FIRST_LOOK, candidates))
        phi, u = _still_poses(_Run(film, bodies, templates_of(first), method), candidates)
        n_still = still_count(phi.reshape(candidates, -1), u.reshape(candidates, -1))
        if n_still < WANTED_STILL:
            warnings.warn(
                f"{film.path}: only {n_still} still frames at the start, {WANTED_STILL} wanted; "
                "the zero is less sure",
                VisionWarning,
                stacklevel=4,
            )
    reference = average_still_frames(film, region, n_still)
    return reference, templates_of(reference)


def predict_uncertainty(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    *,
    n_still: int | None = None,
) -> dict[str, float]:
    """Standard uncertainty of each body's angle, rad, to expect before the film is tracked."""
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as film:
            return predict_uncertainty(film, bodies, n_still=n_still)
    reference, templates = prepare(path_or_source, bodies, n_still)
    return {template.name: predicted_u_angle(template, reference.noise_grey) for template in templates}


class _Run:
    """The bodies of one film on their way through it."""

    def __init__(
        self, film: FrameSource, bodies: Sequence[Body], templates: list[Template], method: str
    ) -> None:
        self.film, self.bodies, self.templates, self.method = film, bodies, templates, method
        self.order = parents_first(bodies)
        self._covering = Covering(bodies, templates, film.height, film.width)
        self.searches = 0
        self.followers: list[Follower] = []
        self.restart()

    def restart(self) -> None:
        """Put every body back to its place in the reference."""
        self.searches += sum(follower.searches for follower in self.followers)
        fitters = [_fitter(template, self.method) for template in self.templates]
        self.followers = [Follower(fitter) for fitter in fitters]
        names = [body.name for body in self.bodies]
        for i in self.order:
            parent = self.bodies[i].parent
            self.followers[i].parent = None if parent is None else self.followers[names.index(parent)]
            self.followers[i].start()

    def step(self, index: int, step: int, search: bool = True) -> None:
        """Fit all bodies in one frame, parents first."""
        for i in self.order:
            self.followers[i].step(self.film, index, step, self._covered(i, step), search)

    def _covered(self, i: int, step: int) -> NDArray[np.uint8] | None:
        """Template pixels of a body that the bodies in front hide, by their poses where known, else as
        predicted."""
        in_front = self._covering.in_front[i]
        if not in_front:
            return None
        poses = {}
        for j in in_front:
            other = self.followers[j]
            known = other.absolute.newest_step() == step
            poses[j] = other.fit.pose if known else other.predict(step)
        return self._covering.covered(i, self.followers[i].predict(step), poses)

    def info(self, reference: Reference) -> dict[str, Any]:
        """Counts and settings worth keeping with the result."""
        return {
            "pixels": {template.name: template.n_pixels for template in self.templates},
            "noise_grey": reference.noise_grey,
            "wide_searches": self.searches + sum(follower.searches for follower in self.followers),
        }


def _fitter(template: Template, method: str) -> Fitter:
    if method == "ecc":
        from vision.ecc import EccFitter

        return EccFitter(template)
    from vision.icgn import IcgnFitter

    return IcgnFitter(template)


def _still_poses(run: _Run, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and their standard uncertainties in the first n frames, each (n, n_bodies, 3), NaN where lost."""
    pose, u = np.full((n, len(run.bodies), 3), np.nan), np.full((n, len(run.bodies), 3), np.nan)
    for step in range(n):
        run.step(step, step, search=False)
        for i, follower in enumerate(run.followers):
            if not follower.flag & FAILURE:
                pose[step, i], u[step, i] = follower.fit.pose, np.sqrt(np.diag(follower.fit.covariance))
    return pose, u


def _zero_of_still_frames(run: _Run, reference: Reference) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean picture rotation of each body over the still frames, and the standard uncertainty of that mean."""
    n = reference.n_averaged
    pose, u = _still_poses(run, n)
    good = np.count_nonzero(np.isfinite(pose[..., 0]), axis=0)
    for i, body in enumerate(run.bodies):
        if 2 * good[i] < n:
            raise TrackingError(
                f"{run.film.path}: body {body.name} is found in {good[i]} of the {n} still frames; "
                "check its outline against the first frame"
            )
    return np.nanmean(pose[..., 0], axis=0), np.sqrt(np.nanmean(u[..., 0] ** 2, axis=0) / good)


def _times(film: FrameSource, frame_time_s: ArrayLike | None) -> NDArray[np.float64]:
    if frame_time_s is None:
        own = film.frame_time_s
        if own is None:
            raise InputError(f"{film.path}: the film states no frame rate; give the time of each frame")
        return own
    time_s = np.asarray(frame_time_s, dtype=float)
    if time_s.shape != (film.n_frames,):
        raise InputError(
            f"{film.path}: {time_s.size} frame times for {film.n_frames} frames; give one per frame"
        )
    if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0.0):
        raise InputError(f"{film.path}: frame times must be finite and increase from frame to frame")
    return time_s


__all__ = ["Film", "METHODS", "predict_uncertainty", "prepare", "track_film"]
