"""Detect the static frames at the start of a film, average them and estimate their noise.

Method: frames are compared one by one with the running mean inside the bodies' regions, after fitting gain, offset
and two gradients, which takes out flicker. The still run ends where the difference exceeds what the noise of the first
frames explains. That test is quick but sees only coarse motion; `count_still_frames` judges the
poses of the bodies themselves.

Method of `count_still_frames`: each pose coordinate of each body, over its standard uncertainty, is compared with the
mean of the frames before, alone and as the mean of the last 2, 4, 8 and 16 frames. The first window that differs by
more than `SURE_U` standard deviations ends the still run, one window's length and `GUARD` frames before that window: a
motion that starts gently is seen only some time after its start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import TrackingError
from vision.film.source import FIRST_FRAMES, FrameSource, saturated_areas, saturated_grey
from vision.fitting.base import ROUNDING_GREY, SURE_U

MAX_STILL = 64  # frames averaged: noise of the mean is an eighth of a frame's
MOST_PIXELS = 5000  # compared per frame: enough to know the noise to one per cent
GROWTH = 1.25  # a still frame may differ this much more than the quietest pair of first frames
FIRST_GROWTH = 3.0  # the second frame may differ from the first by this much more than the first's roughness
TEXTURE_SHARE = 0.4
"""A still frame may also differ by this share of the texture's contrast; finer motion is left to the poses."""
EXTREME_PERCENT = 5.0  # of the darkest and brightest pixels, that no body is told by
GREY_FLOOR = math.sqrt(2.0) * ROUNDING_GREY  # of a difference of two whole grey values, of the stored depth


@dataclass(frozen=True)
class Reference:
    picture: NDArray[np.float32]
    """(height, width)."""
    n_averaged: int
    noise_grey: float
    """Standard deviation of one frame's grey value, median over the bodies' pixels."""
    saturated: NDArray[np.bool_]
    """(height, width): pixels inside an area that is saturated in any of the frames."""


def average_still_frames(
    film: FrameSource, region: NDArray[np.bool_], n_still: int | None = None, max_still: int = MAX_STILL
) -> Reference:
    """Average the still frames at the start of the film: ``n_still``, or as many, up to ``max_still``, as agree in the
    pixels of ``region`` (height, width); with the noise of one frame and the pixels saturated in any."""
    if film.n_frames < 2:
        raise TrackingError(f"{film.path}: {film.n_frames} frame; tracking needs at least two")
    if n_still is not None and not 1 <= n_still <= film.n_frames:
        raise TrackingError(f"{film.path}: {n_still} still frames requested, the film has {film.n_frames}")
    total = film.read(0).astype(np.float32)
    top = saturated_grey(film)
    found = saturated_areas(total, top)
    saturated = np.zeros(total.shape, dtype=bool) if found is None else found
    # saturated pixels have no noise; a film of nothing else is refused later, by body
    pixels = np.flatnonzero((region & ~saturated if np.any(region & ~saturated) else region).reshape(-1))
    if pixels.size > MOST_PIXELS:
        pixels = pixels[:: pixels.size // MOST_PIXELS + 1]
    light = np.stack([(pixels % film.width) / film.width - 0.5, (pixels // film.width) / film.height - 0.5])
    mean = total.reshape(-1)[pixels].astype(float)
    spatial = _roughness(total, region)  # of one frame
    differences: list[float] = []
    variances: list[float] = []
    count = 1
    limit = min(film.n_frames, n_still if n_still is not None else max_still)
    while count < limit:
        frame = film.read(count)
        inside = saturated_areas(frame, top)
        if inside is not None:
            saturated |= inside
        difference, gain = _matched_difference(frame.reshape(-1)[pixels].astype(float), mean, light)
        # noise of one frame, from the difference to a mean of `count` frames
        noise = float(np.sqrt(np.mean(difference**2) / (1.0 + gain**2 / count)))
        # the first frame's own roughness contains its noise and its texture, so it is never below the noise
        quiet = GROWTH * min(differences) if differences else FIRST_GROWTH * spatial
        quiet = max(quiet, TEXTURE_SHARE * float(mean.std())) * max(gain, 1.0)
        if n_still is None and noise > quiet + GREY_FLOOR:
            break
        differences.append(noise)
        variances.append(float(np.median(difference**2)) / 0.4549 / (1.0 + gain**2 / count))
        total += frame
        count += 1
        mean = total.reshape(-1)[pixels].astype(float) / count
    # a camera that shakes makes frames differ by more than their noise, of which the roughness is an upper estimate
    noise = min(float(np.sqrt(np.mean(variances))) if variances else _estimate_background_noise(film, mean), spatial)
    return Reference(total / np.float32(count), count, noise, saturated)


def _estimate_background_noise(film: FrameSource, grey: NDArray[np.float64]) -> float:
    """Noise, grey, of a film whose bodies never rest, from differences of its first frames at the pixels as bright as
    the bodies' pixels ``grey`` (n,); moving ones left out; infinite where frames are equal.

    Neighbouring frames are compared where the picture is as bright as the bodies; what moves there is left out as
    outlying.
    """
    low, high = np.percentile(grey, [EXTREME_PERCENT, 100.0 - EXTREME_PERCENT])
    before = film.read(0).astype(np.float32)
    bright = (before >= low) & (before <= high)
    found = []
    for k in range(1, min(FIRST_FRAMES, film.n_frames)):
        frame = film.read(k).astype(np.float32)
        off = (frame - before)[bright]
        off, before = np.abs(off - np.mean(off)), frame
        spread = float(np.median(off)) / 0.6745
        for _ in range(2):
            spread = float(np.sqrt(np.mean(off[off <= 3.0 * spread + GREY_FLOOR] ** 2)))
        found.append(spread / np.sqrt(2.0))
    noise = float(np.median(found))
    return noise if noise > 0.0 else np.inf


def _roughness(picture: NDArray[np.float32], region: NDArray[np.bool_]) -> float:
    """Upper estimate of the noise of one picture, grey, in the pixels of ``region``: what second differences along both
    axes leave of it; 0 where the region is empty.

    J. Immerkaer, Fast noise variance estimation, Comput. Vis. Image Underst. 64(2), 1996, with a median for the mean.
    """
    along_x = picture[:, :-2] - 2.0 * picture[:, 1:-1] + picture[:, 2:]
    both = along_x[:-2] - 2.0 * along_x[1:-1] + along_x[2:]
    inside = region[1:-1, 1:-1]
    return float(1.4826 * np.median(np.abs(both[inside]))) / 6.0 if inside.any() else 0.0


def _matched_difference(
    frame: NDArray[Any], mean: NDArray[np.float64], light: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Frame (n,) less the mean (n,) times its gain, which is returned too, after a fit of gain, offset and two
    gradients of the light along the coordinates ``light`` (2, n)."""
    design = np.column_stack([mean - mean.mean(), *light, np.ones_like(mean)])
    # the coordinates and the centred mean are of the order of one and of the contrast, so products do no harm
    normal = design.T @ design
    solution = np.linalg.lstsq(normal, design.T @ frame, rcond=None)[0]
    # a gain far from one is a different picture, not flicker
    solution[0] = min(max(solution[0], 0.5), 2.0)
    return frame - design @ solution, float(solution[0])


LONGEST = 16  # frames of the windows whose means are compared, from 1 on in powers of two: slow motion shows in them
GUARD = 2  # frames left out before a motion that is seen
FIRST_AVERAGED = 4  # frames of the first average, by which the still frames are counted
FIRST_LIMIT = 8.0  # standard deviations at which motion begins with fewer frames before it: only gross motion


def count_still_frames(pose: NDArray[np.float64], u_pose: NDArray[np.float64]) -> int:
    """Number of still frames at the start, 1 to n, by the pose coordinates (n, k) of all bodies, frame by frame, NaN
    where lost, and the standard uncertainty of each from that frame's noise."""
    n = len(pose)
    if n < 2 or np.any(np.isnan(pose[0])):
        return 1
    typical = np.sqrt(np.nanmean(u_pose**2, axis=0))
    if n >= FIRST_FRAMES:
        # the actual scatter of the poses from frame to frame, where that is more (compressed film); taken from the
        # smallest quarter of the steps, so that later motion does not count
        step = np.nanquantile(np.abs(np.diff(pose, axis=0)), 0.25, axis=0)
        typical = np.maximum(typical, step / (0.3186 * np.sqrt(2.0)))
    total = np.vstack([np.zeros(pose.shape[1]), np.cumsum(np.nan_to_num(pose), axis=0)])
    for end in range(2, n + 1):
        if np.any(np.isnan(pose[end - 1])):
            # a body that cannot be found is not known to be still
            return end - 1
        window = 1
        while window <= min(LONGEST, end - 1):
            start = end - window
            late = (total[end] - total[start]) / window
            early = total[start] / start
            spread = typical * np.sqrt(1.0 / window + 1.0 / start)
            limit = SURE_U if start >= FIRST_AVERAGED else FIRST_LIMIT
            if np.any(np.abs(late - early) > limit * spread):
                return max(1, start - window - GUARD)
            window *= 2
    return n
