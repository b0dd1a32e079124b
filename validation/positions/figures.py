"""Figures of the page: a stroke's measured key and hammer, the predictions, and the identified set's band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.positions.compare import Predicted
from validation.positions.measured import Stroke
from validation.positions.phases import phases
from validation.report.figures.svg import STYLE, figure_svg

COLOURS = {"identified": "#00508c", "regulated": "#b35900", "null": "#6b6b6b"}
SIZE_IN = (9.2, 5.4)
MOST_POINTS = 450
AROUND_STRIKE_S, AROUND_RELEASE_S = (0.1, 0.15), (0.1, 0.45)


def stroke_figure(stroke: Stroke, predicted: Sequence[Predicted]) -> str:
    """One stroke as SVG: the whole above, strike and release below."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        grid = figure.add_gridspec(2, 2)
        whole, strike, release = (figure.add_subplot(part) for part in (grid[0, :], grid[1, 0], grid[1, 1]))
        at, time_s = phases(stroke), stroke.time_s
        begin = float(time_s[np.argmax(at == 1)])
        top = float(time_s[int(np.argmax(stroke.hammer.value_m))])
        rise = float(time_s[np.argmax(at == 3)]) if np.any(at == 3) else float(time_s[-1])
        end = float(time_s[-1])
        over = float(time_s[np.flatnonzero(at == 3)[-1]]) if np.any(at == 3) else rise
        _curves(whole, stroke, predicted, float(time_s[0]), end)
        _curves(strike, stroke, predicted, max(begin - 0.02, top - 10 * AROUND_STRIKE_S[0]), top + AROUND_STRIKE_S[1])
        _curves(release, stroke, predicted, rise - AROUND_RELEASE_S[0], min(max(over, rise + AROUND_RELEASE_S[1]), end))
        strike.set_title("strike", fontsize=9)
        release.set_title("release", fontsize=9)
        whole.legend(loc="upper right", ncols=5, fontsize=8, frameon=False)
        for axes in (strike, release):
            axes.set_xlabel("time, s")
        for axes in (whole, strike):
            axes.set_ylabel("share of the ruler")
        key = f"stroke-{stroke.number}"
        names = ", ".join(one.model for one in predicted)
        return figure_svg(
            figure,
            key,
            f"Trial {stroke.number} {stroke.condition}",
            f"Measured displacement of key and hammer over time, and the hammer as predicted by: {names}.",
            (float(time_s[0]), float(time_s[-1])),
        )


def _curves(axes: Axes, stroke: Stroke, predicted: Sequence[Predicted], start_s: float, end_s: float) -> None:
    """Curves between two times, thinned to what a page can show."""
    inside = np.flatnonzero((stroke.time_s >= start_s) & (stroke.time_s <= end_s))
    at = inside[:: max(inside.size // MOST_POINTS, 1)]
    time_s, travel = stroke.time_s[at], stroke.hammer.travel_m
    axes.set_xlim(start_s, end_s)
    axes.plot(
        time_s, stroke.key.value_m[at] / stroke.key.travel_m, color="#8a8a8a", lw=0.8, ls=":", label="key, measured"
    )
    for one in predicted:
        colour = COLOURS[one.model]
        if one.model == "identified" and np.all(np.isfinite(one.half_m)):
            low, high = (one.hammer_m[at] + sign * one.half_m[at] for sign in (-1.0, 1.0))
            axes.fill_between(
                time_s, low / travel, high / travel, color=colour, alpha=0.18, lw=0, label="identified, 95 % band"
            )
        width = 1.3 if one.model == "identified" else 0.8
        axes.plot(time_s, one.hammer_m[at] / travel, color=colour, lw=width, label=one.model)
    axes.plot(time_s, stroke.hammer.value_m[at] / travel, color="#111111", lw=1.1, label="hammer, measured")
    axes.set_ylim(-0.25, 1.3)
    axes.grid(alpha=0.25)
