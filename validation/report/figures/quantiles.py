"""Many curves as quantiles: more than `MOST_LINES` lines in one panel nobody can tell apart.

Shaded: between the 5 % and 95 % and between the 25 % and 75 % quantile of the trials at each instant; line: median.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from validation.conventions import Array
from validation.curves.style import BLUE, draw
from validation.curves.thinning import uneven_samples

MOST_LINES = 10
SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = "median, quartiles and 5 % to 95 %"
SAMPLES = 500


@dataclass(frozen=True)
class Quantiles:
    """Quantiles of several curves: times, and one column for each of `SHARES`."""

    time_s: Array
    values: Array


def quantiles(time_s: Array, curves: Array) -> Quantiles:
    """Quantiles over the trials at unevenly thinned times.

    Parameters
    ----------
    time_s : (n_samples,)
    curves : (n_samples, n_trials)
        NaN is left out.
    """
    at = uneven_samples(time_s, curves[:, :: max(1, curves.shape[1] // 8)], SAMPLES)
    ordered = np.sort(curves[at], axis=1)  # NaN last
    known = np.isfinite(ordered).sum(axis=1)
    place = np.clip(known - 1, 0, None)[:, None] * np.array(SHARES)
    low = np.floor(place).astype(int)
    high = np.minimum(low + 1, np.clip(known - 1, 0, None)[:, None])
    rows = np.arange(at.size)[:, None]
    values = ordered[rows, low] * (1 - (place - low)) + ordered[rows, high] * (place - low)
    return Quantiles(time_s[at], np.where(known[:, None] > 0, values, np.nan))


def draw_quantiles(axes: Axes, found: Quantiles) -> None:
    """Two shades and a line."""
    t, v = found.time_s, found.values
    axes.fill_between(t, v[:, 0], v[:, 4], color=BLUE, alpha=0.18, linewidth=0, label="trials, 5 % to 95 %")
    axes.fill_between(t, v[:, 1], v[:, 3], color=BLUE, alpha=0.35, linewidth=0, label="trials, quartiles")
    draw(axes, t, v[:, 2], "trials, median", color=BLUE, linewidth=1.1)
