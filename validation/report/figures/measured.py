"""Figures of what was measured, force and rotations of all trials with repeatability; and the list of all figures.

Conventions: the thesis's signs (key, hammer, jack, repetition lever: rest − angle; whippen: angle − rest),
degrees, seconds; Okabe–Ito colours and a dash pattern per line, so that nothing depends on colour alone; at
most two points per pixel column. A channel without data gets no figure.
Source: thesis Figures 3.9–3.12.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from validation.conventions import ENCODER_CHANNELS, Array
from validation.curves.signs import TITLE, degrees, rotation_label
from validation.curves.style import BLACK, band, columns_for, draw, finish_axes, legend, line_style, shade_lifts
from validation.curves.table import force_on_base
from validation.curves.time_base import on_base
from validation.report.figures.control import control_charts
from validation.report.figures.film_and_motion import film_rotations, force_from_motion
from validation.report.figures.layout import (
    WIDTH_IN,
    ReportFigure,
    finish,
    left_out_intervals,
    lift_text,
    window,
    zoom_on_impact,
)
from validation.report.figures.overlays import (
    force_of_one_trial,
    model_against_trial,
)
from validation.report.figures.quantiles import MOST_LINES, QUANTILES, draw_quantiles, quantiles
from validation.report.figures.svg import STYLE
from validation.report.thesis import measured_anchor
from validation.report.view import SessionView
from validation.result import ValidationResult


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
        force = f["force_n"].to_numpy()
        peak = max(peak, float(force.max(initial=0.0)))
        draw(
            axes,
            f["force_time_s"].to_numpy(),
            force,
            f"trial {number}",
            columns=columns_for(len(result.traces)),
            **line_style(i),
        )
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
    figure = Figure(figsize=(WIDTH_IN, 3.9))
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(3, 1), width_ratios=(2.2, 1))
    several = len(result.traces) > MOST_LINES
    if several:
        curves = on_columns(result, channel)
        for top in grid[0]:
            draw_quantiles(top, quantiles(result.base_s, curves))
    for i, (trial, frame) in enumerate(result.traces.items() if not several else ()):
        f = window(result, frame)
        for top in grid[0]:
            rotation = degrees(channel, f[f"{channel}_measured_rad"])
            draw(
                top,
                f["time_s"].to_numpy(),
                rotation,
                f"trial {trial}",
                columns=columns_for(len(result.traces)),
                **line_style(i),
            )
    s_r = np.degrees(result.spread[f"{channel}_s_r_rad"].to_numpy())
    known = bool(np.isfinite(s_r).any())
    base = result.spread["time_s"].to_numpy()
    mean = degrees(channel, result.spread[f"{channel}_mean_rad"])
    reach = np.degrees(result.spread[f"{channel}_band95_rad"].to_numpy())
    lifts = left_out_intervals(result, channel)
    banded = bool(np.isfinite(reach).any())
    for top, low in grid.T:
        band(top, base, mean - reach, mean + reach, "mean, 95 % band", fits=False)
        shade_lifts(top, lifts, list(result.traces))
        if known:
            draw(low, result.spread["time_s"].to_numpy(), s_r, color=BLACK, linewidth=1.0)
        finish_axes(top, rotation_label(channel), bottom=False)
        finish_axes(low, "$s_r$ (°)")
        low.set_ylim(bottom=0)
    legend(grid[0, 0], 3 if several else len(result.traces))
    zoom_on_impact(result, next(iter(result.traces)), grid[0, 1])
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
        comparison = [force_of_one_trial(view)]
        comparison += [model_against_trial(view, channel) for channel in ENCODER_CHANNELS]
        comparison += film_rotations(view)
        comparison += [force_from_motion(view, i) for i, r in enumerate(view.results) if r.motion_trace is not None]
        repeatability = [force_of_all_trials(view)]
        repeatability += [rotation_of_all_trials(view, channel) for channel in ENCODER_CHANNELS]
        charts = control_charts(view)
        repeatability += [] if charts is None else [charts]
        return {"repeatability": repeatability, "comparison": comparison}
