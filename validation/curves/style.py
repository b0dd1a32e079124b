"""How curves are drawn: colours and dashes, and thinning to what a screen shows.

Conventions: Okabe–Ito colours, darkened where white needs it; each model has its own dash pattern.
"""

from __future__ import annotations

import numpy as np

from validation.conventions import Array

COLUMNS = 380
GREY = "#808080"
BAND_COLUMNS = 140  # the edges of a band are smooth


def decimate(time: Array, values: Array, *, columns: int = COLUMNS, keep: str = "both") -> tuple[Array, Array]:
    """Times and values of a curve (n,) thinned to ``columns`` blocks of equally many samples, keeping the smallest and
    largest value of each, or with ``keep`` ``min`` or ``max`` one of them; a NaN stays a gap. Shorter curves stay as
    they are.

    Parameters
    ----------
    time, values : (n,), NaN breaks the line and is kept as a break
    keep : {"both", "min", "max"}, one value per column for the edge of a band
    """
    t, v = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    per = 2 if keep == "both" else 1
    if t.size <= per * columns:
        return t, v
    size = int(np.ceil(t.size / columns))
    pad = (-t.size) % size
    blocks = np.concatenate([v, np.full(pad, v[-1])]).reshape(-1, size)
    starts = np.arange(blocks.shape[0]) * size
    gap = np.isnan(blocks).any(axis=1)
    low = starts + np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    high = starts + np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    if keep != "both":
        index = np.minimum(low if keep == "min" else high, t.size - 1)
        out = v[index].copy()
        out[gap] = np.nan
        return t[np.minimum(starts + size // 2, t.size - 1)], out
    pair = np.sort(np.stack([low, high], axis=1), axis=1)
    index = np.minimum(pair.reshape(-1), t.size - 1)
    out = v[index].copy()
    out[np.repeat(gap, 2)] = np.nan
    return t[index], out


def uneven_samples(time: Array, curves: Array, n: int) -> np.ndarray:
    """Indices, increasing, of at most ``n`` of the samples of ``curves`` (n_samples, n_curves), any units, close
    together where these bend; for drawing all at the same times.

    Parameters
    ----------
    time : (n_samples,)
    curves : (n_samples, n_curves), NaN counts as straight
    """
    if time.size <= n:
        return np.arange(time.size)
    density = np.full(time.size, 0.25)
    for curve in np.nan_to_num(np.asarray(curves, dtype=float)).T:
        reach = float(np.ptp(curve))
        if reach > 0:
            bend = np.sqrt(np.abs(np.gradient(np.gradient(curve / reach))))
            density += bend / max(float(bend.mean()), 1e-12)
    width = max(1, time.size // (4 * n))
    along = np.concatenate([[0.0], np.cumsum(np.convolve(density, np.ones(2 * width + 1), "same"))[1:]])
    return np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], n)).clip(0, time.size - 1))


BLACK, ORANGE, SKY, BLUE, VERMILION = "#000000", "#B37400", "#2A8FC4", "#0072B2", "#C04A00"
MODEL_DASHES = ((5, 1.5), (1.5, 1.2), (6, 1.5, 1.5, 1.5), (8, 2), (3, 1, 1, 1, 1, 1))
