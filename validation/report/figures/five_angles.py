"""The first figure: each of the five angles, measured in all trials and predicted, and the difference below.

Conventions: one small picture a body, in the body's colour; the thesis's signs, degrees; every curve and band lies
wholly inside its frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from model.files.figure_sheet import new_sheet
from model.inside.labels import BODY_COLORS
from validation.conventions import BODIES, FILM_CHANNELS, Array
from validation.curves.display_signs import TITLE
from validation.curves.style import BLACK, MODEL_DASHES, decimate
from validation.numbers import number
from validation.report.figures.layout import (
    MOST_LINES,
    counted_trials,
    curves_of,
    differences_of,
    draw_line,
    draw_trials,
    spread_of,
)
from validation.report.figures.svg import STYLE, figure_svg
from validation.report.view import SessionView
from validation.result import ValidationResult

SIZE_IN = (2.62, 3.0)  # a fifth of a screen of 1400 px, a third of a printed page
MOST_COLUMNS = 160
MARGIN = 0.06  # of the range of a panel
FONT_PT = 9.5
LEFT_OUT = "#A0A0A0"


def five_angles(view: SessionView) -> list[tuple[str, str, bool]]:
    """One picture a body: its name, its SVG, and whether it was measured."""
    with rc_context({**STYLE, "font.size": FONT_PT}):
        return [(TITLE[c], _picture(view, c), c in view.compared or c in view.measured) for c in BODIES]


def draw_angles(results: Sequence[ValidationResult], path: str | Path) -> None:
    """Draw the five angles of a session into a file.

    Parameters
    ----------
    results : of one session, one for each model
    path : .svg, .pdf or .png
    """
    view = SessionView(tuple(results))
    with rc_context({"font.size": FONT_PT}), new_sheet(path, 2.8 * len(BODIES), 3.6) as figure:
        grid = figure.subplots(2, len(BODIES), sharex=True, height_ratios=(1.5, 1), squeeze=False)
        for (top, low), channel in zip(grid.T, BODIES, strict=True):
            _draw(top, low, view, channel)
        names = ", ".join(result.action_name for result in results)
        figure.suptitle(f"{view.name}: measured (colour) and predicted by {names} (black dashes), 95 % band, limits")


def band_words(view: SessionView) -> str:
    """Half width of the 95 % band of each measured angle, in degrees, at its widest; empty where none was drawn."""
    parts = []
    for channel in BODIES:
        reach = spread_of(view.first, channel, "difference_u95")
        if np.isfinite(reach).any():
            parts.append(f"{TITLE[channel]} {number(float(np.nanmax(reach)), 2)}°")
    return ", ".join(parts)


def limit_of(result: ValidationResult, channel: str) -> float:
    """Limit of relevance of an angle, degrees, the least of several conditions; NaN where nothing was judged."""
    table = result.quantities
    own = table[(table["channel"] == channel) & table["primary"].astype(bool)] if len(table) else table
    return math.degrees(float(own["limit"].min())) if len(own) else math.nan


def _picture(view: SessionView, channel: str) -> str:
    figure = Figure(figsize=SIZE_IN)
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    _draw(top, low, view, channel)
    figure.subplots_adjust(left=0.17, right=0.97, top=0.93, bottom=0.135, hspace=0.24)
    key = f"{view.prefix}angle-{channel}"
    return figure_svg(figure, key, f"{TITLE[channel]}, measured and predicted", _words(view, channel))


def _draw(top: Axes, low: Axes, view: SessionView, channel: str) -> None:
    """Angle above, difference below."""
    first = view.first
    base, color = first.base_s, BODY_COLORS[channel]
    measured = curves_of(first, channel, "measured")
    counted, is_compared = counted_trials(first, channel), channel in view.compared
    for curve in measured[:, ~counted].T[:MOST_LINES]:
        draw_line(top, base, curve, MOST_COLUMNS, color=LEFT_OUT, linewidth=0.7)
    draw_trials(top, base, measured[:, counted], color)
    for i, result in enumerate(view.results):
        predicted, difference = curves_of(result, channel, "predicted"), _difference(result, channel)
        if len(predicted.T) == counted.size:
            predicted = predicted[:, counted]
        mean = _mean(predicted)
        reach = spread_of(result, channel, "difference_u95")
        style = {"color": BLACK, "linewidth": 1.0, "dashes": MODEL_DASHES[i % len(MODEL_DASHES)]}
        _band(top, base, mean, reach)
        draw_line(top, base, mean, MOST_COLUMNS, **style)
        if not is_compared:
            continue
        if len(view.results) == 1:
            draw_trials(low, base, difference, color)
        _band(low, base, _mean(difference), reach)
        draw_line(low, base, _mean(difference), MOST_COLUMNS, **style)
    limit = limit_of(first, channel)
    low.axhline(0.0, color="#777777", linewidth=0.6)
    for end in (-limit, limit):
        if math.isfinite(limit):
            low.axhline(end, color="#B3261E", linewidth=1.0, linestyle=(0, (1, 1.2)))
    is_compared = is_compared and bool(counted.any())
    if not is_compared:
        words = "not filmed" if channel in FILM_CHANNELS else "not measured"
        if np.isfinite(measured).any():
            words = "drives the model" if counted.any() else "left out"
        low.set_yticks([])
        low.text(0.5, 0.5, words, transform=low.transAxes, ha="center", va="center", color="#4a4a4a")
    for axes in (top, low):
        axes.grid(True, color="#E4E4E4", linewidth=0.5)
        axes.set_xlim(float(base[0]), float(base[-1]))
        _hold(axes)
        if axes is top or is_compared:
            axes.yaxis.set_major_locator(MaxNLocator(4))
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.tick_params(length=2.5, pad=2)
    low.set_xlabel("time (s)", labelpad=1)
    top.set_title(f"{TITLE[channel]} (°)", fontsize=FONT_PT, loc="left", pad=3, fontweight="bold")
    low.set_title("model − trial (°)", fontsize=FONT_PT, loc="left", pad=3)


def _words(view: SessionView, channel: str) -> str:
    """Text alternative of a channel's picture."""
    said = []
    for name, result in zip(view.names, view.results, strict=True):
        difference = _mean(_difference(result, channel))
        if not np.isfinite(difference).any():
            return f"Predicted rotation of the {TITLE[channel]}; not measured."
        k = int(np.nanargmax(np.abs(difference)))
        at = view.first.base_s[k]
        said.append(f"{name} − trial at most {number(float(difference[k]), 2)}° in the mean, at {at:.3f} s")
    limit = limit_of(view.first, channel)
    ends = f"; limit of relevance ± {number(limit, 2)}°" if math.isfinite(limit) else ""
    return f"Rotation of the {TITLE[channel]}, measured and predicted: {'; '.join(said)}{ends}."


def _difference(result: ValidationResult, channel: str) -> Array:
    """Model − trial of the trials that count, (n_samples, n_counted) degrees."""
    return differences_of(result, channel)[:, counted_trials(result, channel)]


def left_out_trials(view: SessionView) -> list[int]:
    """Trials of which some angle is left out of the means."""
    scores = view.first.scores
    return sorted({int(trial) for trial in scores["trial"][~scores["pooled"].astype(bool)]})


def _mean(curves: Array) -> Array:
    known = np.isfinite(curves).any(axis=1)
    mean = np.full(len(curves), np.nan)
    mean[known] = np.nanmean(curves[known], axis=1)
    return mean


def _band(axes: Axes, time: Array, middle: Array, reach: Array) -> None:
    if np.isfinite(reach + middle).any():
        t, low = decimate(time, middle - reach, columns=MOST_COLUMNS, keep="min")
        _, high = decimate(time, middle + reach, columns=MOST_COLUMNS, keep="max")
        axes.fill_between(t, low, high, color="#808080", alpha=0.28, linewidth=0)


def _hold(axes: Axes) -> None:
    """Limits that hold every curve, band and limit line, with a margin."""
    low, high = axes.dataLim.intervaly
    for line in axes.lines:
        values = np.asarray(line.get_ydata(), dtype=float)
        if np.isfinite(values).any():
            low, high = min(low, float(np.nanmin(values))), max(high, float(np.nanmax(values)))
    if math.isfinite(low) and math.isfinite(high):
        margin = MARGIN * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
