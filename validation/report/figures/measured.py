"""Figures of what was measured, force and rotations of all trials with repeatability; and the list of all figures.

Conventions: the thesis's signs (key, hammer, jack, repetition lever: rest − angle; whippen: angle − rest),
degrees, seconds; Okabe–Ito colours and a dash pattern per line, so that nothing depends on colour alone; at
most two points per pixel column. A channel without data gets no figure.
Source: thesis Figures 3.9–3.13.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from validation.conventions import FILM_CHANNELS, Array
from validation.curves.display_signs import TITLE, degrees, rotation_label
from validation.curves.style import (
    BLACK,
    BLUE,
    VERMILION,
    band,
    columns_for,
    draw,
    finish_axes,
    legend,
    line_style,
    model_style,
    plot_text,
    shade_lifts,
    shared_legend,
)
from validation.curves.table import force_on_base, on_base
from validation.events.definitions import EVENTS
from validation.measurement.trial import trials_in_words
from validation.report.figures.layout import (
    MOST_LINES,
    QUANTILES,
    WIDTH_IN,
    Pointed,
    ReportFigure,
    draw_quantiles,
    finish,
    left_out_intervals,
    lift_text,
    quantiles,
    window,
)
from validation.report.figures.overlays import (
    force_of_one_trial,
    model_against_trial,
)
from validation.report.figures.svg import STYLE
from validation.report.view import SessionView, measured_anchor
from validation.result import ValidationResult

FEWEST = 6
MOVING_RANGE = 2.66
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
    anchor = "Not in the thesis: did the bench change during the session?"
    pointed = [
        Pointed((axes,), trials.astype(float), ("trial {}", 0), _lines(title, values))
        for axes, (title, trials, values) in zip(panels, charts, strict=True)
    ]
    return finish(view, figure, "control", anchor, caption, said, pointed=pointed)


def _limits(values: Array) -> tuple[float, float]:
    """Mean, and how far from it the limits are; NaN below `FEWEST` values."""
    reach = MOVING_RANGE * float(np.mean(np.abs(np.diff(values)))) if values.size >= FEWEST else float("nan")
    return float(np.mean(values)), reach


def _lines(title: str, values: Array) -> tuple[tuple[str, str, int, Array], ...]:
    """What is said of each trial of a chart."""
    name, _, unit = title.rstrip(")").partition(" (")
    unit = unit if unit == "°" else f" {unit}".rstrip()
    mean, reach = _limits(values)
    every = np.ones(values.size)
    return ((name, unit, 3, values), ("mean", unit, 3, mean * every), ("limits: mean ±", unit, 3, reach * every))


def _of_event(events: pd.DataFrame, name: str) -> tuple[Array, Array]:
    """Trials and values of one measured event, in the unit it is shown in."""
    own = events[(events["source"] == "trial") & (events["event"] == name)].dropna(subset=["value"])
    return own["trial"].to_numpy(), EVENTS[name].display_factor * own["value"].to_numpy(dtype=float)


def _chart(axes: Axes, trials: Array, values: Array) -> list[int]:
    """Draw one chart; the trials beyond its limits."""
    mean, reach = _limits(values)
    axes.set_xlim(float(np.min(trials)) - 0.5, float(np.max(trials)) + 0.5)
    axes.axhline(mean, color=BLUE, linewidth=0.9)
    beyond = np.zeros(values.size, dtype=bool)
    if np.isfinite(reach):
        beyond = np.abs(values - mean) > reach
        for limit in (mean - reach, mean + reach):
            axes.axhline(limit, color=BLUE, linewidth=0.8, dashes=(4, 2))
    size = 4.0 if values.size <= 60 else 2.0
    axes.plot(trials, values, color=BLACK, linewidth=0.6, marker="o", markersize=size)
    axes.plot(trials[beyond], values[beyond], linestyle="none", marker="s", markersize=size + 3, color=VERMILION)
    axes.grid(True, color="#DDDDDD", linewidth=0.6)
    return [int(t) for t in trials[beyond]]


def film_rotations(view: SessionView) -> list[ReportFigure]:
    """Jack and repetition lever of every filmed trial with band, predictions and residuals (thesis 3.13)."""
    figures = []
    for trial, frame in view.first.film_traces.items():
        f = window(view.first, frame)
        time = f["time_s"].to_numpy()
        figure = Figure(figsize=(WIDTH_IN, 4.2))
        grid = figure.subplots(2, 2, sharex=True, height_ratios=(2.4, 1))
        notes, pointed = [], []
        for j, channel in enumerate(FILM_CHANNELS):
            measured = degrees(channel, f[f"{channel}_measured_rad"])
            reach = 2 * np.degrees(f[f"{channel}_u_rad"].to_numpy())
            top, low = grid[0, j], grid[1, j]
            band(top, time, measured - reach, measured + reach, "film ± 2u")
            draw(top, time, measured, "film", color=BLACK, linewidth=0.9)
            band(low, time, -reach, reach)
            lines = [("film", "°", 3, measured), ("2u", "°", 3, reach)]
            for i, (name, result) in enumerate(zip(view.names, view.results, strict=True)):
                if trial not in result.film_traces:
                    continue
                own = window(result, result.film_traces[trial])
                model = degrees(channel, own[f"{channel}_predicted_rad"])
                style = model_style(i)
                draw(top, own["time_s"].to_numpy(), model, plot_text(name), **style)
                difference = model - degrees(channel, own[f"{channel}_measured_rad"])
                draw(low, own["time_s"].to_numpy(), difference, **{**style, "linewidth": 0.9})
                if model.size == time.size:
                    lines += [(name, "°", 3, model), (f"{name} − film", "°", 3, difference)]
            pointed.append(Pointed((top, low), time, ("{} s", 4), tuple(lines)))
            top.set_title(TITLE[channel], fontsize=9)
            finish_axes(top, rotation_label(channel), bottom=False)
            finish_axes(low, "model − film (°)")
            lost = int(np.isnan(measured).sum())
            median = float(np.nanmedian(reach)) / 2 if np.isfinite(reach).any() else float("nan")
            notes.append(f"{TITLE[channel]}: u = {median:.3f}° (median), {lost} of {measured.size} frames lost")
        legend_lines = shared_legend(figure, [grid[0, 0]])
        caption = (
            f"Rotation of jack and repetition lever relative to the whippen, tracked on the film of "
            f"trial {trial}; below: model minus film, with the film's ± 2u about zero. " + "; ".join(notes) + "."
        )
        anchor = measured_anchor(view.condition, "film")
        figures.append(finish(view, figure, f"film-{trial}", anchor, caption, caption, legend_lines, pointed))
    return figures


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
    draw(grid[0], time, measured, f"measured, trial {int(row['trial'])}", color=BLACK, linewidth=1.1)
    draw(grid[0], time, predicted, "from the key's motion", **model_style(i))
    finish_axes(grid[0], "force (N)", bottom=False)
    draw(grid[1], time, predicted - measured, color=BLUE, linewidth=0.9)
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
    anchor = "Not in the thesis: the model driven the other way round."
    lines = (
        ("measured", " N", 2, measured),
        ("from the key's motion", " N", 2, predicted),
        ("difference", " N", 2, predicted - measured),
        ("95 % interval ±", " N", 2, np.where(use, reach, np.nan)),
    )
    pointed = [Pointed((grid[0], grid[1]), time, ("{} s", 4), lines)]
    key = "force-motion" if i == 0 else f"force-motion-{i + 1}"
    return finish(view, figure, key, anchor, caption, text, pointed=pointed)


def force_of_all_trials(view: SessionView) -> ReportFigure:
    """Corrected force of every trial (thesis 3.9)."""
    result = view.first
    figure = Figure(figsize=(WIDTH_IN, 3.0))
    axes = figure.subplots()
    peak = 0.0
    several = len(result.traces) > MOST_LINES
    if several:
        base = result.base_s
        curves = np.column_stack([force_on_base(base, frame) for frame in result.traces.values()])
        peak = float(np.nanmax(curves))
        draw_quantiles(axes, quantiles(base, curves))
    for i, (number, frame) in enumerate(result.traces.items() if not several else ()):
        f = window(result, frame)
        at, force = f["force_time_s"].to_numpy(), f["force_n"].to_numpy()
        peak = max(peak, float(force.max(initial=0.0)))
        draw(axes, at, force, f"trial {number}", columns=columns_for(len(result.traces)), **line_style(i))
    finish_axes(axes, "force (N)")
    n = len(result.traces)
    legend(axes, 3 if several else n)
    caption = f"Measured force of all {n} trials, corrected for offset, hum and channel delay, never smoothed"
    caption += f": {QUANTILES}." if several else "."
    text = f"{n} curves of force over time; the largest force is {peak:.1f} N."
    made = finish(view, figure, "force-all", measured_anchor(view.condition, "force"), caption, text)
    return replace(made, channel="force", shows="all")


def rotation_of_all_trials(view: SessionView, channel: str) -> ReportFigure:
    """One encoder channel of every trial, with s_r(t) below (thesis 3.10–3.12)."""
    result = view.first
    figure = Figure(figsize=(WIDTH_IN, 3.4))
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    several = len(result.traces) > MOST_LINES
    if several:
        draw_quantiles(top, quantiles(result.base_s, on_columns(result, channel)))
    for i, (trial, frame) in enumerate(result.traces.items() if not several else ()):
        f = window(result, frame)
        at, rotation = f["time_s"].to_numpy(), degrees(channel, f[f"{channel}_measured_rad"])
        draw(top, at, rotation, f"trial {trial}", columns=columns_for(len(result.traces)), **line_style(i))
    base = result.base_s
    s_r = np.degrees(result.spread[f"{channel}_s_r_rad"].to_numpy())
    known = bool(np.isfinite(s_r).any())
    mean = degrees(channel, result.spread[f"{channel}_mean_rad"])
    reach = np.degrees(result.spread[f"{channel}_band95_rad"].to_numpy())
    lifts = left_out_intervals(result, channel)
    banded = bool(np.isfinite(reach).any())
    band(top, base, mean - reach, mean + reach, "mean, 95 % band")
    shade_lifts(top, lifts, list(result.traces))
    if known:
        draw(low, base, s_r, color=BLACK, linewidth=1.0)
    finish_axes(top, rotation_label(channel), bottom=False)
    finish_axes(low, "$s_r$ (°)")
    low.set_ylim(bottom=0)
    legend(top, 3 if several else len(result.traces))
    text = f"sᵣ(t) is at most {np.nanmax(s_r):.3f}°." if known else "Repeatability is not known with one trial."
    caption = f"Rotation of the {TITLE[channel]} in all {len(result.traces)} trials"
    caption += f": {QUANTILES}; below: repeatability sᵣ(t)." if several else "; below: repeatability sᵣ(t)."
    if banded:
        caption += f" Shaded: simultaneous 95 % band of the mean, at most ±{np.nanmax(reach):.3f}°; it knows "
        caption += "scatter in value and in time, but not what one blow in thirty does."
    caption += lift_text(lifts)
    made = finish(view, figure, f"{channel}-all", measured_anchor(view.condition, channel), caption, text)
    return replace(made, channel=channel, shows="all")


def on_columns(result: ValidationResult, channel: str) -> Array:
    """Measured rotation of every trial on the time base, (n_samples, n_trials) degrees."""
    base, name = result.base_s, f"{channel}_measured_rad"
    columns = [on_base(base, f["time_s"].to_numpy(), degrees(channel, f[name])) for f in result.traces.values()]
    return np.column_stack(columns)


def all_figures(view: SessionView) -> dict[str, list[ReportFigure]]:
    """Figures of a session in two groups: ``comparison`` (thesis 4.1–4.15, 3.13) and ``repeatability`` (3.9–3.12)."""
    with rc_context(STYLE):
        comparison = [force_of_one_trial(view)] if view.has_force else []
        comparison += [model_against_trial(view, channel) for channel in view.compared]
        comparison += film_rotations(view)
        comparison += [force_from_motion(view, i) for i, r in enumerate(view.results) if r.motion_trace is not None]
        repeatability = [force_of_all_trials(view)] if view.has_force else []
        repeatability += [rotation_of_all_trials(view, channel) for channel in view.measured]
        charts = control_charts(view)
        repeatability += [] if charts is None else [charts]
        return {"repeatability": repeatability, "comparison": comparison}
