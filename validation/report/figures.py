"""The report's figures: matplotlib draws, clean inline SVG comes out.

Place in the data flow: traces and spread of a `ValidationResult` → SVG text for the page.
Conventions: the thesis's signs (key, hammer, jack, repetition lever: rest − angle; whippen: angle − rest),
degrees, seconds; Okabe–Ito colours and a dash pattern per line, so that nothing depends on colour alone; at
most two points per pixel column.
Source: thesis Figures 3.9–3.13 and 4.1–4.4.
Failure: a channel without data gets no figure.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from validation.measurement import ENCODER_CHANNELS, FILM_CHANNELS
from validation.report.drawing import (
    BLACK,
    BLUE,
    SIGN,
    SKY,
    TITLE,
    VERMILION,
    band,
    columns_for,
    degrees,
    draw,
    finish_axes,
    legend,
    line_style,
    rotation_label,
    shade_lifts,
)
from validation.report.figure import (
    WIDTH_IN,
    ReportFigure,
    finish,
    lift_text,
    marked_intervals,
    window,
    zoom_on_impact,
)
from validation.report.svg import STYLE
from validation.result import ValidationResult


def force_of_all_trials(result: ValidationResult) -> ReportFigure:
    """Corrected force of every trial (thesis 3.9)."""
    figure = Figure(figsize=(WIDTH_IN, 3.0))
    axes = figure.subplots()
    peak = 0.0
    for i, (number, frame) in enumerate(result.traces.items()):
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
    legend(axes, len(result.traces))
    n = len(result.traces)
    caption = f"Measured force of all {n} trials, corrected for offset, hum and channel delay, never smoothed."
    text = f"{n} curves of force over time; the largest force is {peak:.1f} N."
    return finish(result, figure, "force-all", "3.9", caption, text)


def rotation_of_all_trials(result: ValidationResult, channel: str, number: str) -> ReportFigure:
    """One encoder channel of every trial, with s_r(t) below (thesis 3.10–3.12)."""
    figure = Figure(figsize=(WIDTH_IN, 3.9))
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(3, 1), width_ratios=(2.2, 1))
    for i, (trial, frame) in enumerate(result.traces.items()):
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
    lifts = marked_intervals(result, channel)
    banded = bool(np.isfinite(reach).any())
    for top, low in grid.T:
        band(top, base, mean - reach, mean + reach, "mean, 95 % band", fits=False)
        shade_lifts(top, lifts, list(result.traces))
        if known:
            draw(low, result.spread["time_s"].to_numpy(), s_r, color=BLACK, linewidth=1.0)
        finish_axes(top, rotation_label(channel), bottom=False)
        finish_axes(low, "$s_r$ (°)")
        low.set_ylim(bottom=0)
    legend(grid[0, 0], len(result.traces))
    zoom_on_impact(result, next(iter(result.traces)), grid[0, 1])
    text = f"sᵣ(t) is at most {np.nanmax(s_r):.3f}°." if known else "Repeatability is not known with one trial."
    caption = f"Rotation of the {TITLE[channel]} in all {len(result.traces)} trials; below: repeatability sᵣ(t)."
    if banded:
        caption += f" Shaded: simultaneous 95 % band of the mean, at most ±{np.nanmax(reach):.3f}°."
    caption += lift_text(lifts)
    return finish(result, figure, f"{channel}-all", number, caption, text)


def film_rotations(result: ValidationResult) -> list[ReportFigure]:
    """Jack and repetition lever of every filmed trial with band, prediction and residual (thesis 3.13)."""
    figures = []
    for trial, frame in result.film_traces.items():
        f = window(result, frame)
        time = f["time_s"].to_numpy()
        figure = Figure(figsize=(WIDTH_IN, 4.2))
        grid = figure.subplots(2, 2, sharex=True, height_ratios=(2.4, 1))
        notes = []
        for j, channel in enumerate(FILM_CHANNELS):
            measured = degrees(channel, f[f"{channel}_measured_rad"])
            model = degrees(channel, f[f"{channel}_predicted_rad"])
            reach = 2 * np.degrees(f[f"{channel}_u_rad"].to_numpy())
            top, low = grid[0, j], grid[1, j]
            band(top, time, measured - reach, measured + reach)
            draw(top, time, measured, "film, ±2u shaded", color=BLACK, linewidth=0.9)
            draw(top, time, model, "model", color=VERMILION, linewidth=1.2, dashes=(5, 1.5))
            top.set_title(TITLE[channel], fontsize=9)
            finish_axes(top, rotation_label(channel), bottom=False)
            top.legend(fontsize=8)
            band(low, time, -reach, reach)
            draw(low, time, model - measured, color=BLUE, linewidth=0.9)
            finish_axes(low, "model − film (°)")
            lost = int(np.isnan(measured).sum())
            median = float(np.nanmedian(reach)) / 2 if np.isfinite(reach).any() else float("nan")
            notes.append(f"{TITLE[channel]}: u = {median:.3f}° (median), {lost} of {measured.size} frames lost")
        caption = (
            f"Rotation of jack and repetition lever relative to the whippen, tracked on the film of "
            f"trial {trial}. " + "; ".join(notes) + "."
        )
        figures.append(finish(result, figure, f"film-{trial}", "3.13", caption, caption))
    return figures


def force_of_one_trial(result: ValidationResult, trial: int) -> ReportFigure:
    """Corrected and raw force of one trial (thesis 4.1)."""
    f = window(result, result.traces[trial])
    figure = Figure(figsize=(WIDTH_IN, 3.0))
    axes, zoom = figure.subplots(1, 2, width_ratios=(2.2, 1))
    for panel in (axes, zoom):
        draw(panel, f["time_s"].to_numpy(), f["raw_force_n"].to_numpy(), "as recorded", color=SKY, linewidth=0.8)
        draw(panel, f["force_time_s"].to_numpy(), f["force_n"].to_numpy(), "corrected", color=BLACK, linewidth=1.1)
        finish_axes(panel, "force (N)")
    zoom_on_impact(result, trial, zoom)
    axes.legend(fontsize=8)
    caption = f"Force of trial {trial}: as recorded, and as it drives the model, corrected (offset, hum, delay)."
    at = int(np.nanargmax(f["force_n"].to_numpy()))
    text = f"The largest force is {f['force_n'].iloc[at]:.1f} N at {f['force_time_s'].iloc[at]:.4f} s."
    return finish(result, figure, "force-one", "4.1", caption, text)


def force_from_motion(result: ValidationResult, trace: pd.DataFrame) -> ReportFigure:
    """Measured force, and the force the model needs for the measured motion of the key."""
    row = result.motion_driven.iloc[0]
    time = trace["time_s"].to_numpy()
    use = ~trace["left_out"].to_numpy(dtype=bool)
    measured, predicted = trace["force_n"].to_numpy(), np.where(use, trace["predicted_force_n"].to_numpy(), np.nan)
    reach = trace["factor"].to_numpy() * trace["u_predicted_n"].to_numpy()
    figure = Figure(figsize=(WIDTH_IN, 3.6))
    grid = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    band(grid[0], time, predicted - reach, predicted + reach)
    draw(grid[0], time, measured, f"measured, trial {int(row['trial'])}", color=BLACK, linewidth=1.1)
    draw(grid[0], time, predicted, "from the key's motion", color=VERMILION, linewidth=1.2, dashes=(5, 1.5))
    finish_axes(grid[0], "force (N)", bottom=False)
    draw(grid[1], time, predicted - measured, color=BLUE, linewidth=0.9)
    finish_axes(grid[1], "difference (N)")
    grid[0].legend(fontsize=8)
    caption = (
        f"Force at the key front that the model needs for the measured motion of the key, trial {int(row['trial'])}. "
        f"RMSE {row['rmse_n']:.2f} N, {100 * row['rmse_over_peak']:.1f} % of the peak; "
        f"{100 * row['left_out_share']:.1f} % of the window left out (key may lift)."
    )
    text = f"Measured peak {row['peak_measured_n']:.1f} N, predicted {row['peak_predicted_n']:.1f} N."
    return finish(result, figure, "force-motion", "4.1, the other way round", caption, text)


def model_against_trial(result: ValidationResult, trial: int, channel: str, number: str) -> ReportFigure:
    """One channel of one trial with its prediction, and the residuals of all trials (thesis 4.2–4.4)."""
    f = window(result, result.traces[trial])
    time = f["time_s"].to_numpy()
    measured = degrees(channel, f[f"{channel}_measured_rad"])
    model = degrees(channel, f[f"{channel}_predicted_rad"])
    row = result.channels[result.channels["channel"] == channel].iloc[0]
    base = result.spread["time_s"].to_numpy()
    mean, reach, s_r = (
        np.degrees(result.spread[f"{channel}_{name}_rad"].to_numpy())
        for name in ("difference", "difference_band95", "s_r")
    )
    mean *= SIGN[channel]
    # how much another trial may differ from this one at each instant: the limit's factor times s_r(t)
    factor = float(row["limit_rad"]) / float(row["s_r_rad"]) if row["s_r_rad"] > 0 else float("nan")
    limit = np.interp(time, base, s_r * factor, left=np.nan, right=np.nan)
    lifts = marked_intervals(result, channel)
    figure = Figure(figsize=(WIDTH_IN, 5.2))
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(1.6, 1), width_ratios=(2.2, 1))
    for top in grid[0]:
        band(top, time, measured - limit, measured + limit, "repeatability limit", fits=False)
        shade_lifts(top, lifts, [trial])
        draw(top, time, measured, f"trial {trial}", color=BLACK, linewidth=1.2)
        draw(top, time, model, "model", color=VERMILION, linewidth=1.3, dashes=(5, 1.5))
        finish_axes(top, rotation_label(channel), bottom=False)
    for low in grid[1]:
        for i, (other, frame) in enumerate(result.traces.items()):
            part = window(result, frame)
            difference = part[f"{channel}_predicted_rad"].to_numpy() - part[f"{channel}_measured_rad"].to_numpy()
            draw(
                low,
                part["time_s"].to_numpy(),
                degrees(channel, difference),
                f"trial {other}",
                columns=columns_for(len(result.traces)),
                **line_style(i),
            )
        band(low, base, mean - reach, mean + reach, "mean, 95 % band", alpha=0.5, fits=False)
        shade_lifts(low, lifts, list(result.traces))
        low.axhline(0.0, color="#777777", linewidth=0.7)
        finish_axes(low, "model − trial (°)")
    grid[0, 0].legend(fontsize=8)
    zoom_on_impact(result, trial, grid[0, 1])
    row = result.scores[(result.scores["trial"] == trial) & (result.scores["channel"] == channel)].iloc[0]
    caption = (
        f"Rotation of the {TITLE[channel]}, model and trial {trial}; below: model minus trial for all trials. "
        f"RMSE of trial {trial}: {np.degrees(row['rmse_rad']):.3f}°."
    )
    if np.isfinite(limit).any():
        caption += (
            " Shaded above: repeatability limit about this trial, which two trials differ by less than in 95 % "
            "of cases at each instant (cut off where it leaves the panel)."
        )
    if np.isfinite(reach).any():
        caption += (
            " Shaded below: simultaneous 95 % band of the mean difference; where it leaves zero, model and trials "
            "differ by more than scatter and sensors explain."
        )
    caption += lift_text(lifts)
    largest = f"{np.degrees(row['largest_rad']):.3f}° at {row['largest_at_s']:.4f} s"
    text = f"The largest difference of trial {trial} is {largest}."
    return finish(result, figure, f"{channel}-model", number, caption, text)


def all_figures(result: ValidationResult) -> dict[str, list[ReportFigure]]:
    """Figures of the report in two groups: ``repeatability`` (3.9–3.13) and ``comparison`` (4.1–4.4)."""
    with rc_context(STYLE):
        first = next(iter(result.traces))
        repeatability = [force_of_all_trials(result)]
        for channel, number in zip(ENCODER_CHANNELS, ("3.10", "3.11", "3.12"), strict=True):
            repeatability.append(rotation_of_all_trials(result, channel, number))
        repeatability += film_rotations(result)
        comparison = [force_of_one_trial(result, first)]
        if result.motion_trace is not None:
            comparison.append(force_from_motion(result, result.motion_trace))
        for channel, number in zip(ENCODER_CHANNELS, ("4.2", "4.3", "4.4"), strict=True):
            comparison.append(model_against_trial(result, first, channel, number))
        return {"repeatability": repeatability, "comparison": comparison}
