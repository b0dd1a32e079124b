"""Figures of what was measured: force and rotations of all trials with repeatability; and the list of all figures.

Source: thesis Figures 3.9–3.12.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from model.inside.labels import BODY_COLORS
from validation.conventions import Array
from validation.curves.display_signs import TITLE, degrees, rotation_label
from validation.curves.style import BLACK, VERMILION, band, draw, finish_axes, model_style, shade_lifts
from validation.curves.table import force_on_base
from validation.events.definitions import EVENTS
from validation.measurement.trial import trials_in_words
from validation.numbers import number
from validation.report.figures.layout import (
    FORCE,
    MOST_LINES,
    QUANTILES,
    WIDTH_IN,
    ReportFigure,
    curves_of,
    draw_trials,
    finish,
    left_out_intervals,
    lift_text,
    spread_of,
)
from validation.report.figures.overlays import compared_figures
from validation.report.figures.svg import STYLE
from validation.report.view import SessionView

FEWEST = 6
MOVING_RANGE = 2.66
COLUMNS = 300
THESIS = {"key": "3.10", "whippen": "3.11", "hammer": "3.12"}
CHARTS = ("hammer_speed", "check_height", "key_release")


def control_charts(view: SessionView) -> ReportFigure | None:
    """Peak force, RMSE of the hammer and three events of every trial over its number; None below `FEWEST` trials.

    Individuals chart: centre line the mean, limits mean ± 2.66 times the mean difference of neighbouring trials; from
    `FEWEST` trials on, because from fewer the limits mean nothing. Source: Shewhart; ISO 7870-2.
    """
    result = view.first
    numbers = np.array(list(result.traces))
    if numbers.size < FEWEST:
        return None
    charts: list[tuple[str, Array, Array]] = []
    if view.has_force:
        peaks = [float(np.nanmax(frame["force_n"].to_numpy())) for frame in result.traces.values()]
        charts.append(("peak force (N)", numbers, np.array(peaks)))
    rmse = result.scores[result.scores["channel"] == "hammer"].dropna(subset=["rmse_rad"])
    charts.append(("hammer RMSE (°)", rmse["trial"].to_numpy(), np.degrees(rmse["rmse_rad"].to_numpy(dtype=float))))
    charts += [(EVENTS[name].label, *_of_event(result.events, name)) for name in CHARTS]
    charts = [chart for chart in charts if chart[1].size]
    figure = Figure(figsize=(WIDTH_IN, 1.25 * len(charts) + 0.3))
    panels = figure.subplots(len(charts), 1, sharex=True, squeeze=False)[:, 0]
    outside = []
    for axes, (title, trials, values) in zip(panels, charts, strict=True):
        beyond = _chart(axes, trials, values)
        if beyond:
            outside.append(f"{title}: {trials_in_words(beyond)}")
        axes.set_title(title, fontsize=8.5, loc="left")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlabel("trial")
    said = "Beyond the limits: " + "; ".join(outside) + "." if outside else "No trial is beyond its limits."
    caption = (
        "Control charts over the trial number. Line: mean; dashed: mean ± 2.66 times the mean difference of "
        f"neighbouring trials. {said}"
    )
    return finish(view, figure, "control", caption, said, between=0.45)


def _limits(values: Array) -> tuple[float, float]:
    """Mean, and how far from it the limits are; NaN below `FEWEST` values."""
    reach = MOVING_RANGE * float(np.mean(np.abs(np.diff(values)))) if values.size >= FEWEST else float("nan")
    return float(np.mean(values)), reach


def _of_event(events: pd.DataFrame, name: str) -> tuple[Array, Array]:
    """Trials and values of one measured event, in the unit it is shown in."""
    own = events[(events["source"] == "trial") & (events["event"] == name)].dropna(subset=["value"])
    return own["trial"].to_numpy(), EVENTS[name].display_factor * own["value"].to_numpy(dtype=float)


def _chart(axes: Axes, trials: Array, values: Array) -> list[int]:
    """Draw one chart; the trials beyond its limits."""
    mean, reach = _limits(values)
    axes.set_xlim(float(np.min(trials)) - 0.5, float(np.max(trials)) + 0.5)
    axes.axhline(mean, color=FORCE, linewidth=0.9)
    beyond = np.zeros(values.size, dtype=bool)
    if np.isfinite(reach):
        beyond = np.abs(values - mean) > reach
        for limit in (mean - reach, mean + reach):
            axes.axhline(limit, color=FORCE, linewidth=0.8, dashes=(4, 2))
    size = 4.0 if values.size <= 60 else 2.0
    axes.plot(trials, values, color=BLACK, linewidth=0.6, marker="o", markersize=size)
    axes.plot(trials[beyond], values[beyond], linestyle="none", marker="s", markersize=size + 3, color=VERMILION)
    axes.grid(True, color="#DDDDDD", linewidth=0.6)
    return [int(t) for t in trials[beyond]]


def force_from_motion(view: SessionView, i: int) -> ReportFigure:
    """Measured force, and the force the i-th model needs for the measured motion of the key."""
    result = view.results[i]
    trace, row = result.motion_trace, result.motion_driven.iloc[0]
    assert trace is not None
    time = trace["time_s"].to_numpy()
    use = ~trace["left_out"].to_numpy(dtype=bool)
    measured, predicted = trace["force_n"].to_numpy(), np.where(use, trace["predicted_force_n"].to_numpy(), np.nan)
    reach = trace["factor"].to_numpy() * trace["u_predicted_n"].to_numpy()
    figure = Figure(figsize=(WIDTH_IN, 3.6))
    grid = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    band(grid[0], time, predicted - reach, predicted + reach)
    draw(grid[0], time, measured, f"measured, trial {int(row['trial'])}", color=FORCE, linewidth=1.1)
    draw(grid[0], time, predicted, "from the key's motion", **model_style(i))
    finish_axes(grid[0], "force (N)", bottom=False)
    draw(grid[1], time, predicted - measured, color=BLACK, linewidth=0.9)
    finish_axes(grid[1], "difference (N)")
    grid[0].legend(fontsize=8)
    name = "the model" if len(view.results) == 1 else view.names[i]
    caption = (
        f"Force at the key front that {name} needs for the measured motion of the key, "
        f"trial {int(row['trial'])}. "
        f"RMSE {row['rmse_n']:.2f} N, {100 * row['rmse_over_peak']:.1f} % of the peak; "
        f"{100 * row['left_out_share']:.1f} % of the window left out (key may lift)."
    )
    text = f"Measured peak {row['peak_measured_n']:.1f} N, predicted {row['peak_predicted_n']:.1f} N."
    key = "force-motion" if i == 0 else f"force-motion-{i + 1}"
    return finish(view, figure, key, caption, text)


def force_of_all_trials(view: SessionView) -> ReportFigure:
    """Corrected force of every trial (thesis 3.9)."""
    result = view.first
    curves = np.column_stack([force_on_base(result.base_s, frame) for frame in result.traces.values()])
    figure = Figure(figsize=(WIDTH_IN, 3.0))
    axes = figure.subplots()
    draw_trials(axes, result.base_s, curves, FORCE, COLUMNS)
    finish_axes(axes, "force (N)")
    caption = f"Measured force of all {curves.shape[1]} trials, corrected for offset, hum and delay, never smoothed"
    text = f"{curves.shape[1]} curves of force over time; the largest force is {np.nanmax(curves):.1f} N."
    made = finish(view, figure, "force-all", f"{caption}{_quantiles(curves)} As thesis 3.9.", text)
    return replace(made, channel="force", shows="all")


def _quantiles(curves: Array) -> str:
    """How all trials are drawn, at the end of a caption."""
    return f": {QUANTILES}." if curves.shape[1] > MOST_LINES else "."


def rotation_of_all_trials(view: SessionView, channel: str) -> ReportFigure:
    """One measured body of every trial, with s_r(t) below (thesis 3.10–3.12)."""
    result, color = view.first, BODY_COLORS[channel]
    base, curves = result.base_s, curves_of(result, channel, "measured")
    figure = Figure(figsize=(WIDTH_IN, 3.4))
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    draw_trials(top, base, curves, color, COLUMNS)
    s_r, reach = spread_of(result, channel, "s_r"), spread_of(result, channel, "band95")
    known, banded = bool(np.isfinite(s_r).any()), bool(np.isfinite(reach).any())
    mean = degrees(channel, result.spread[f"{channel}_mean_rad"])
    lifts = left_out_intervals(result, channel)
    band(top, base, mean - reach, mean + reach, "mean, 95 % band")
    shade_lifts(top, lifts, list(result.traces))
    if known:
        draw(low, base, s_r, color=color, linewidth=1.0)
    finish_axes(top, rotation_label(channel), bottom=False)
    finish_axes(low, "$s_r$ (°)")
    low.set_ylim(bottom=0)
    text = f"sᵣ(t) is at most {np.nanmax(s_r):.3f}°." if known else "Repeatability is not known with one trial."
    caption = f"Rotation of the {TITLE[channel]} in all {len(result.traces)} trials; below: repeatability sᵣ(t)"
    caption += _quantiles(curves)
    if banded:
        caption += f" Grey: simultaneous 95 % band of the mean, at most ±{number(float(np.nanmax(reach)), 2)}°."
    made = finish(view, figure, f"{channel}-all", f"{caption}{lift_text(lifts)} As thesis {THESIS[channel]}.", text)
    return replace(made, channel=channel, shows="all")


def all_figures(view: SessionView) -> dict[str, list[ReportFigure]]:
    """Figures of a session by section: ``trials`` (thesis 4.1–4.15, 3.13) and ``repeatability`` (3.9–3.12)."""
    with rc_context(STYLE):
        trials = compared_figures(view)
        trials += [force_from_motion(view, i) for i, r in enumerate(view.results) if r.motion_trace is not None]
        repeatability = [force_of_all_trials(view)] if view.has_force else []
        repeatability += [rotation_of_all_trials(view, channel) for channel in view.measured]
        charts = control_charts(view)
        return {"trials": trials, "repeatability": repeatability + ([] if charts is None else [charts])}
