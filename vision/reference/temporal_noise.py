"""Detect temporal filtering in the camera from the noise of static frames.

Noise reduction that mixes a frame with those before it (recursive averaging) and conversion of the frame rate (blended
frames) delay whatever moves. No residual shows the delay, but the noise of frames at rest is correlated in time, which
that of a sensor is not.

Method: the noise is what a second difference along both axes (J. Immerkaer, Comput. Vis. Image Underst. 64(2), 1996)
leaves of the tiles of the whole picture that have the least texture, less gain, shift and turn of the mean picture. Its
variogram ``V(L) = E (e[k + L] - e[k])^2 / 2`` needs no mean; it is the same for all lags L where noise is white. The
difference between the lags 2 and more and lag 1 is summed over the tiles, whose noise is independent: the sum over its
standard error is normal, and is tested one-sidedly at the level `LEVEL`.

The integral time scale, the sum of the correlations ``r(L) = 1 - V(L) / V(inf)``, is the delay of steady motion in
frames: ``a / (1 - a)`` of a recursive filter that keeps the share a of the frame before, ``(m - 1) / 2`` of a mean over
m frames, 1/2 of frames blended half and half. The sum ends at the first correlation that is not significant. Few frames
cut it short, so that the delay of the recursive filter of the first correlation, ``r(1) / (1 - r(1))``, is given where
that is more: the largest that such a filter can cause.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from vision.film.source import FrameSource, saturated_grey

LEVEL = 1e-4  # probability that a film of white noise is said to be filtered
TILE_PX = 16  # side of a tile; neighbouring tiles share few of the pixels that a second difference reaches
SHARED = 1.12
"""Standard error over that of independent tiles, whose second differences reach `STEP_PX` into their neighbours. With
it 0.05 and 0.01 of 400 films of white noise are found at these levels."""
LEAST_TILES = 30  # from which the sum over tiles is normal
MOST_FRAMES = 16  # still frames that are looked at
LEAST_FRAMES = 4  # that have settled: lags 1 and 2 are told apart
UNSETTLED_FRAMES = 4  # of a filter that begins with the film: a share 0.4 has then fallen to 0.03
FLAT_SHARE = 0.5  # share of the tiles that are used, those of least texture
CLIPPED_SHARE = 0.5  # of a tile's pixels that are white or black in a frame; they have no noise there
OUTLYING = 3.0  # tiles whose variance is more than this many times the median's hold something that moves
STEP_PX = 4
"""Of the second difference: smooth noise, of cameras that also average over neighbouring pixels, is left in it. Even,
so that light that alternates between rows, as a lamp's does in interlaced pictures, is not."""
_LINE = np.zeros(2 * STEP_PX + 1, dtype=np.float32)
_LINE[[0, STEP_PX, -1]] = 1.0, -2.0, 1.0  # a second difference
SECOND_DIFFERENCE = np.outer(_LINE, _LINE) / np.float32(6.0)


def estimate_delay_frames(film: FrameSource, n_still: int, level: float = LEVEL) -> float:
    """Delay, in frames, of steady motion by filtering in time, from the correlation of the still frames' noise; 0 where
    that is white, tested at ``level``, or where ``n_still`` frames cannot tell.

    Fewer than `LEAST_FRAMES` still frames, and pictures without noise, cannot tell.
    """
    limit = -float(ndtri(level))
    n = min(n_still, MOST_FRAMES)
    # a recursive filter that starts with the film has not settled in its first frames
    first = min(UNSETTLED_FRAMES, n - LEAST_FRAMES)
    if first < 0:
        return 0.0
    frames = np.stack([film.read(k).astype(np.float32) for k in range(first, n)])
    n -= first
    noise = _noise_by_tile(frames, float(saturated_grey(film)))
    if noise is None:
        return 0.0
    pairs = [np.mean((noise[lag:] - noise[:-lag]) ** 2, axis=(0, 2)) / 2.0 for lag in range(1, n)]
    variogram, weight = np.stack(pairs), np.arange(n - 1, 0, -1.0)[:, None]  # (lags, tiles)
    total = np.sum(variogram * weight, axis=0) / weight.sum()
    usable = (total > 0.0) & (total < OUTLYING * np.median(total))
    variogram = variogram[:, usable]
    if variogram.shape[1] < LEAST_TILES:
        return 0.0
    far = np.sum(variogram[1:] * weight[1:], axis=0) / weight[1:].sum()
    if _score(far - variogram[0]) < limit:
        return 0.0
    # the longest lags, of which the correlation is least, stand for the variance
    last = variogram[-(n // 2) :], weight[-(n // 2) :]
    variance = np.sum(last[0] * last[1], axis=0) / last[1].sum()
    correlation = 1.0 - variogram.sum(axis=1) / variance.sum()
    total_delay = 0.0
    for one, share in zip(variogram[: n // 2], correlation, strict=False):
        if _score(variance - one) < limit:
            break
        total_delay += float(share)
    return max(total_delay, float(correlation[0] / (1.0 - correlation[0])), 0.0)


def _score(differences: NDArray[np.float64]) -> float:
    """Mean of independent differences over its standard error."""
    spread = SHARED * float(np.std(differences)) / np.sqrt(differences.size)
    return float(np.mean(differences)) / spread if spread > 0.0 else 0.0


def _noise_by_tile(frames: NDArray[np.float32], top: float) -> NDArray[np.float32] | None:
    """Noise of the flattest tiles, (frames, tiles, pixels), of ``frames`` (n, height, width); None where too few tiles
    are below ``top``, the saturated grey."""
    n, height, width = frames.shape
    mean = frames.mean(axis=0)
    clipped = ((frames.max(axis=0) >= top) | (frames.min(axis=0) <= 0.0)).astype(np.float32)
    slope_x, slope_y = (cv2.Scharr(mean, cv2.CV_32F, *order) / np.float32(32.0) for order in ((1, 0), (0, 1)))
    tiled = [_tiles(part) for part in (slope_x**2 + slope_y**2, clipped)]
    whole = np.flatnonzero(tiled[1].mean(axis=1) < CLIPPED_SHARE)
    if whole.size < LEAST_TILES:
        return None
    texture = tiled[0][whole].mean(axis=1)
    chosen = whole[np.argsort(texture, kind="stable")[: max(LEAST_TILES, int(FLAT_SHARE * whole.size))]]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    turned = slope_y * (x - np.float32(width / 2)) - slope_x * (y - np.float32(height / 2))
    design = np.stack([_second_difference(one, chosen) for one in (mean, slope_x, slope_y, turned)]).reshape(4, -1)
    follow = np.linalg.pinv(design.astype(float).T, rcond=1e-6)
    found = []
    for frame in frames:
        noise = _second_difference(frame - mean, chosen)
        amplitude = follow @ noise.ravel().astype(float)
        found.append(noise - (amplitude @ design).reshape(noise.shape).astype(np.float32))
    return np.stack(found)


def _second_difference(picture: NDArray[np.float32], chosen: NDArray[np.intp]) -> NDArray[np.float32]:
    """Second difference of a picture in some tiles, (tiles, pixels)."""
    return _tiles(np.asarray(cv2.filter2D(picture, cv2.CV_32F, SECOND_DIFFERENCE), dtype=np.float32))[chosen]


def _tiles(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels of every tile, (tiles, pixels)."""
    rows, columns = (size // TILE_PX for size in picture.shape)
    cut = picture[: rows * TILE_PX, : columns * TILE_PX].reshape(rows, TILE_PX, columns, TILE_PX)
    return np.ascontiguousarray(cut.swapaxes(1, 2)).reshape(rows * columns, TILE_PX * TILE_PX)
