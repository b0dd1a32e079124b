"""The first figure: each of the five angles, measured in all trials and predicted, and the difference below.

Conventions: one small picture a body, in the body's colour; the thesis's signs, degrees; every curve and band lies
wholly inside its frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from model.inside.labels import BODY_COLORS
from validation.conventions import BODIES, FILM_CHANNELS, Array
from validation.curves.display_signs import TITLE
from validation.curves.style import BLACK, GREY, MODEL_DASHES
from validation.numbers import number
from validation.report.figures.layout import (
    MOST_LINES,
    counted_trials,
    curves_of,
    differences_of,
    draw_trials,
    spread_of,
)
from validation.report.figures.svg import Chart, Panel, Pen
from validation.report.view import SessionView
from validation.result import ValidationResult

WIDTH, HEIGHT = 189.0, 216.0  # points: a fifth of a screen of 1400 px, a third of a printed page
ROWS = (1.5, 1.0)
MOST_COLUMNS = 160
MOST_INTERVALS = 4
FONT = 9.5
LEFT_OUT = "#A0A0A0"


def five_angles(view: SessionView) -> list[tuple[str, str, bool]]:
    """One picture a body: its name, its SVG, and whether it was measured."""
    return [(TITLE[c], _picture(view, c), c in view.compared or c in view.measured) for c in BODIES]


def angles_svg(results: Sequence[ValidationResult]) -> str:
    """Text of an SVG file with the five angles of a session, measured and predicted, in degrees, and below model −
    trial; ``results``: of one session, one for each model."""
    view = SessionView(tuple(results))
    chart = Chart(
        (WIDTH + 12) * len(BODIES), HEIGHT + 20, ROWS, len(BODIES), 30, 6, 41, 27, 20, 32, FONT
    )  # left, right, top, bottom, between, beside
    for i, channel in enumerate(BODIES):
        _draw(chart.grid[0][i], chart.grid[1][i], view, channel)
    names = ", ".join(result.action_name for result in results)
    title = f"{view.name}: measured (colour) and predicted by {names} (black dashes), 95 % band, limits"
    return chart.file_text("angles", title, " ".join(_words(view, channel) for channel in BODIES))


def band_words(view: SessionView) -> str:
    """Text with the largest half width, in degrees, of the 95 % interval of the mean difference of each angle; empty
    where none was drawn."""
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
    chart = Chart(WIDTH, HEIGHT, ROWS, left=32, right=6, top=15, bottom=29, between=20, font=FONT)
    _draw(chart.grid[0][0], chart.grid[1][0], view, channel)
    return chart.svg(
        f"{view.prefix}angle-{channel}", f"{TITLE[channel]}, measured and predicted", _words(view, channel)
    )


def _draw(top: Panel, low: Panel, view: SessionView, channel: str) -> None:
    """Draw into ``top`` the rotation of the body ``channel``, measured in all trials and predicted, and into ``low``
    model − trial, in degrees with the thesis's signs; sets the panels' axes and titles."""
    first = view.first
    base, color = first.base_s, BODY_COLORS[channel]
    measured = curves_of(first, channel, "measured")
    counted, is_compared = counted_trials(first, channel), channel in view.compared
    for curve in measured[:, ~counted].T[:MOST_LINES]:
        top.line(base, curve, Pen(LEFT_OUT, 0.7), columns=MOST_COLUMNS)
    draw_trials(top, base, measured[:, counted], color)
    for i, result in enumerate(view.results):
        predicted, difference = curves_of(result, channel, "predicted"), _difference(result, channel)
        if len(predicted.T) == counted.size:
            predicted = predicted[:, counted]
        reach = spread_of(result, channel, "difference_u95")
        panels = [(top, _mean(predicted))]
        if is_compared:
            panels.append((low, _mean(difference)))
            if len(view.results) == 1:
                draw_trials(low, base, difference, color)
        for panel, mean in panels:
            panel.band(base, mean - reach, mean + reach, (GREY, 0.28), columns=MOST_COLUMNS)
            panel.line(base, mean, Pen(BLACK, 1.0, MODEL_DASHES[i % len(MODEL_DASHES)]), columns=MOST_COLUMNS)
    limit = limit_of(first, channel)
    low.level(0.0, Pen("#777777", 0.6))
    for end in (-limit, limit):
        if math.isfinite(limit):
            low.level(end, Pen("#B3261E", 1.0, (1, 1.2)))
    if not (is_compared and counted.any()):
        low.note = "not filmed" if channel in FILM_CHANNELS else "not measured"
        if np.isfinite(measured).any():
            low.note = "drives the model" if counted.any() else "left out"
    for panel in (top, low):
        panel.x, panel.intervals = (float(base[0]), float(base[-1])), MOST_INTERVALS
    top.title, top.is_bold = f"{TITLE[channel]} (°)", True
    low.title, low.x_label = "model − trial (°)", "time (s)"


def _words(view: SessionView, channel: str) -> str:
    """Text alternative of the picture of the body ``channel``: its largest mean difference from the trials, in degrees,
    with its time, for each model, and the limit of relevance."""
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
