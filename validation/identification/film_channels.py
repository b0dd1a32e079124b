"""Angles of jack and repetition lever on a film, at the frames nearest to the phases of a trial.

Conventions: relative to the whippen and to rest, rad; a phase without a frame of its own is lost (NaN): frames may be
further apart than phases, and one frame counts once. Noise differs from frame to frame; the reference, an average of
the frames at rest, errs alike in all frames of a film; what camera, shutter and codec add is taken to grow with the
angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import FILM_CHANNELS, Array
from validation.measurement.trial import FilmAngles, MeasuredTrial

NEAR = 0.75  # of the time between two frames: how far a frame may be from its phase
OUTSIDE_S = 1e-3  # a frame may be beyond the first and last phase by this


@dataclass(frozen=True)
class FilmSeen:
    """What a film says at m phases.

    Attributes
    ----------
    time_s : (m,) of the frames; of the phase itself where there is none
    change_rad, u_white_rad : (m, 2) since rest, and from frame to frame; NaN where lost
    u_zero_rad, u_scale : (2,) of the reference, rad; of what grows with the angle, relative
    u_time_s : of the film's clock
    """

    time_s: Array
    change_rad: Array
    u_white_rad: Array
    u_zero_rad: Array
    u_scale: Array
    u_time_s: float


def film_seen(m: MeasuredTrial, phase_s: Array) -> FilmSeen:
    """What a trial's film says at times (m,); all lost without a film."""
    n, size = len(FILM_CHANNELS), phase_s.size
    lost = np.full((size, n), np.nan)
    if m.film is None or m.film.time_s.size < 2:
        return FilmSeen(phase_s, lost, lost, np.zeros(n), np.zeros(n), 0.0)
    film = m.film
    frame, there = _own_frames(film.time_s, phase_s)
    change, white = lost.copy(), lost.copy()
    zero, scale = np.zeros(n), np.zeros(n)
    still = max(int(np.sum(film.time_s < m.quiet.end_s)), 1)
    for c, name in enumerate(FILM_CHANNELS):
        noise = film.u_noise_rad.get(name, film.u_rad[name])
        change[there, c], white[there, c] = film.change_rad[name][frame[there]], noise[frame[there]]
        known = np.isfinite(film.change_rad[name]) & np.isfinite(noise) & np.isfinite(film.u_rad[name])
        if known.any():
            zero[c] = float(np.median(noise[known])) / np.sqrt(still)
            scale[c] = _grows(film, name, noise, known)
    change[~np.isfinite(white)] = np.nan
    return FilmSeen(np.where(there, film.time_s[frame], phase_s), change, white, zero, scale, film.u_time_s)


def _own_frames(frame_s: Array, phase_s: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Index of the frame nearest to each phase (m,), and whether the phase has it for itself."""
    frame = np.clip(np.round(np.interp(phase_s, frame_s, np.arange(frame_s.size))), 0, frame_s.size - 1).astype(int)
    away = np.abs(frame_s[frame] - phase_s)
    there = away <= NEAR * float(np.median(np.diff(frame_s)))
    there &= (frame_s[frame] >= phase_s[0] - OUTSIDE_S) & (frame_s[frame] <= phase_s[-1] + OUTSIDE_S)
    for k in np.unique(frame):
        same = np.flatnonzero(frame == k)
        there[np.delete(same, int(np.argmin(away[same])))] = False
    return frame, there


def _grows(film: FilmAngles, name: str, noise: Array, known: NDArray[np.bool_]) -> float:
    """Relative standard uncertainty of what the total has beside noise, where the body has turned most."""
    beside = np.sqrt(np.maximum(film.u_rad[name][known] ** 2 - noise[known] ** 2, 0.0))
    turned = np.abs(film.change_rad[name][known])
    far = turned > 0.5 * turned.max()
    return float(np.median(beside[far] / turned[far])) if far.any() and turned.max() > 0.0 else 0.0
