"""How curves are drawn in the report: colours, dashes, signs, labels, bands.

Conventions: the thesis's signs in degrees; Okabe–Ito colours, darkened where white needs it, each with its own
dash pattern.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.conventions import Array

COLUMNS = 380
GREY = "#808080"
BAND_COLUMNS = 140  # the edges of a band are smooth


def decimate(time: Array, values: Array, *, columns: int = COLUMNS, keep: str = "both") -> tuple[Array, Array]:
    """Thin a curve to the smallest and largest value of each pixel column, so that no spike is lost.

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
    """Indices of at most ``n`` samples, close together where a curve bends, for drawing all curves at the same times.

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
LEGEND_CHARACTERS = 140  # in a line above the panels


def model_style(i: int) -> dict[str, Any]:
    """Line style of the i-th model: black, with its dash pattern; measured curves are solid, in the body's colour."""
    return {"color": BLACK, "linewidth": 1.1, "dashes": MODEL_DASHES[i % len(MODEL_DASHES)]}


def draw(
    axes: Axes, time: Array, values: Array, label: str | None = None, *, columns: int = COLUMNS, **style: object
) -> None:
    """Draw a thinned curve."""
    t, v = decimate(time, values, columns=columns)
    axes.plot(t, v, label=label, **style)  # type: ignore[arg-type]


def finish_axes(axes: Axes, ylabel: str, *, bottom: bool = True) -> None:
    """Label, grid and margins; the time axis only on the lowest panel."""
    axes.set_ylabel(ylabel)
    axes.grid(True, color="#DDDDDD", linewidth=0.6)
    axes.margins(x=0)
    if bottom:
        axes.set_xlabel("time (s)")
    else:
        axes.tick_params(labelbottom=False)


def shared_legend(figure: Figure, panels: Sequence[Axes]) -> int:
    """One legend above all panels, of everything labelled in some of them; returns how many lines it takes."""
    known: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    lines = math.ceil(sum(len(label) + 9 for label in known) / LEGEND_CHARACTERS)
    columns = math.ceil(len(known) / lines)
    figure.legend(
        known.values(), known.keys(), loc="upper center", ncols=columns, fontsize=8, frameon=False, borderaxespad=0.2
    )
    return lines


def plot_text(text: str) -> str:
    """Text from a session or model as matplotlib shows it letter by letter: no formulas, nothing unprintable."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text).replace("$", r"\$")


def band(
    axes: Axes,
    time: Array,
    low: Array,
    high: Array,
    label: str | None = None,
    *,
    alpha: float = 0.35,
    gid: str | None = None,
) -> None:
    """Draw a shaded band between two curves into ``axes``, with gaps where a curve is NaN."""
    if not np.isfinite(low).any():
        return
    t, a = decimate(time, low, columns=BAND_COLUMNS, keep="min")
    _, b = decimate(time, high, columns=BAND_COLUMNS, keep="max")
    axes.fill_between(t, a, b, color=GREY, alpha=alpha, linewidth=0, label=label, gid=gid)


def shade_lifts(axes: Axes, marked: pd.DataFrame, trials: list[int]) -> None:
    """Shade and hatch the intervals of these trials that are left out of the scores."""
    for i, row in enumerate(marked[marked["trial"].isin(trials)].itertuples()):
        axes.axvspan(
            row.start_s,
            row.end_s,
            facecolor=ORANGE,
            edgecolor=BLACK,
            alpha=0.25,
            hatch="////",
            linewidth=0,
            label="left out: key may lift" if i == 0 else None,
        )
