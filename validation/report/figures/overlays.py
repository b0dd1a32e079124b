"""Figures of model against experiment: one trial with the predictions of every model, residuals of all trials below.

Conventions: as `validation.report.figures.measured`; the trial is a solid black line, each model has its own colour
and dashes, the same in all figures; one panel of residuals for each model, all with the same scale.
Source: thesis Figures 3.13 and 4.1–4.15.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.conventions import FILM_CHANNELS
from validation.report.figures.layout import (
    WIDTH_IN,
    ReportFigure,
    finish,
    left_out_intervals,
    lift_text,
    window,
    zoom_on_impact,
)
from validation.report.figures.style import (
    BLACK,
    BLUE,
    SIGN,
    SKY,
    TITLE,
    band,
    columns_for,
    degrees,
    draw,
    finish_axes,
    line_style,
    model_style,
    plot_text,
    rotation_label,
    shade_lifts,
    shared_legend,
)
from validation.report.thesis import compared_anchor, measured_anchor
from validation.report.view import SessionView
from validation.result import ValidationResult


def force_of_one_trial(view: SessionView) -> ReportFigure:
    """Corrected and raw force of one trial (thesis 4.1, 4.5, 4.12)."""
    result, trial = view.first, view.shown_trial()
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
    anchor = compared_anchor(view.condition, "force", len(view.results))
    return finish(view, figure, "force-one", anchor, caption, text)


def model_against_trial(view: SessionView, channel: str) -> ReportFigure:
    """One channel of one trial with every prediction, and the residuals of all trials (thesis 4.2–4.4, 4.6–4.15)."""
    result, trial = view.first, view.shown_trial()
    f = window(result, result.traces[trial])
    time = f["time_s"].to_numpy()
    measured = degrees(channel, f[f"{channel}_measured_rad"])
    limit = _limit(result, channel, time)
    lifts = left_out_intervals(result, channel)
    n = len(view.results)
    figure = Figure(figsize=(WIDTH_IN, 3.3 + 1.9 * n))
    grid = figure.subplots(n + 1, 2, sharex="col", height_ratios=(1.6, *[1] * n), width_ratios=(2.2, 1))
    for top in grid[0]:
        band(top, time, measured - limit, measured + limit, "repeatability limit", fits=False)
        shade_lifts(top, lifts, [trial])
        draw(top, time, measured, f"trial {trial}", color=BLACK, linewidth=1.2)
        for i, (name, other) in enumerate(zip(view.names, view.results, strict=True)):
            own = window(other, other.traces[trial])
            predicted = degrees(channel, own[f"{channel}_predicted_rad"])
            draw(top, own["time_s"].to_numpy(), predicted, plot_text(name), **model_style(i))
        finish_axes(top, rotation_label(channel), bottom=False)
    reached = []
    for i, (row, name, other) in enumerate(zip(grid[1:], view.names, view.results, strict=True)):
        reached.append(_residuals(row, other, channel, last=i == n - 1))
        if n > 1:
            row[0].set_title(plot_text(f"{name} − trial"), fontsize=9, loc="left")
    _same_scale([axes for row in grid[1:] for axes in row])
    lines = shared_legend(figure, list(grid[:, 0]))
    zoom_on_impact(result, trial, grid[0, 1])
    caption = f"Rotation of the {TITLE[channel]}, trial {trial} and model{'s' if n > 1 else ''}; "
    caption += "below: model minus trial, a line for each trial as in the figures of all trials."
    texts = []
    for name, other in zip(view.names, view.results, strict=True):
        own = other.scores[(other.scores["trial"] == trial) & (other.scores["channel"] == channel)].iloc[0]
        caption += f" RMSE of trial {trial}, {name}: {np.degrees(own['rmse_rad']):.4f}°."
        largest = f"{np.degrees(own['largest_rad']):.4f}° at {own['largest_at_s']:.4f} s"
        texts.append(f"The largest difference of trial {trial}, {name}, is {largest}.")
    if np.isfinite(limit).any():
        caption += (
            " Shaded above: repeatability limit about this trial, which two trials differ by less than in 95 % "
            "of cases at each instant (cut off where it leaves the panel)."
        )
    if any(reached):
        caption += (
            " Shaded below: simultaneous 95 % band of the mean difference; where it leaves zero, model and trials "
            "differ by more than the declared uncertainties explain."
        )
    caption += lift_text(lifts)
    anchor = compared_anchor(view.condition, channel, n)
    return finish(view, figure, f"{channel}-model", anchor, caption, " ".join(texts), lines)


def _limit(result: ValidationResult, channel: str, time: np.ndarray) -> np.ndarray:
    """How much another trial may differ from one at each instant, degrees: the limit's factor times s_r(t)."""
    row = result.channels[result.channels["channel"] == channel].iloc[0]
    factor = float(row["limit_rad"]) / float(row["s_r_rad"]) if row["s_r_rad"] > 0 else float("nan")
    s_r = np.degrees(result.spread[f"{channel}_s_r_rad"].to_numpy())
    return np.interp(time, result.spread["time_s"].to_numpy(), s_r * factor, left=np.nan, right=np.nan)


def _residuals(panels: np.ndarray, result: ValidationResult, channel: str, *, last: bool) -> bool:
    """Model minus trial for all trials with the band of their mean; whether there is such a band."""
    base = result.spread["time_s"].to_numpy()
    mean = degrees(channel, result.spread[f"{channel}_difference_rad"])
    reach = np.degrees(result.spread[f"{channel}_difference_band95_rad"].to_numpy())
    lifts = left_out_intervals(result, channel)
    for low in panels:
        for i, frame in enumerate(result.traces.values()):
            part = window(result, frame)
            difference = part[f"{channel}_predicted_rad"].to_numpy() - part[f"{channel}_measured_rad"].to_numpy()
            draw(
                low,
                part["time_s"].to_numpy(),
                SIGN[channel] * np.degrees(difference),
                columns=columns_for(len(result.traces)),
                **line_style(i),
            )
        band(low, base, mean - reach, mean + reach, "mean difference, 95 % band", alpha=0.5, fits=False)
        shade_lifts(low, lifts, list(result.traces))
        low.axhline(0.0, color="#777777", linewidth=0.7)
        finish_axes(low, "model − trial (°)", bottom=last)
    return bool(np.isfinite(reach).any())


def _same_scale(panels: list[Axes]) -> None:
    """The largest range of all panels for each of them."""
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))


def film_rotations(view: SessionView) -> list[ReportFigure]:
    """Jack and repetition lever of every filmed trial with band, predictions and residuals (thesis 3.13)."""
    figures = []
    for trial, frame in view.first.film_traces.items():
        f = window(view.first, frame)
        time = f["time_s"].to_numpy()
        figure = Figure(figsize=(WIDTH_IN, 4.2))
        grid = figure.subplots(2, 2, sharex=True, height_ratios=(2.4, 1))
        notes = []
        for j, channel in enumerate(FILM_CHANNELS):
            measured = degrees(channel, f[f"{channel}_measured_rad"])
            reach = 2 * np.degrees(f[f"{channel}_u_rad"].to_numpy())
            top, low = grid[0, j], grid[1, j]
            band(top, time, measured - reach, measured + reach, "film ± 2u")
            draw(top, time, measured, "film", color=BLACK, linewidth=0.9)
            band(low, time, -reach, reach)
            for i, (name, result) in enumerate(zip(view.names, view.results, strict=True)):
                if trial not in result.film_traces:
                    continue
                own = window(result, result.film_traces[trial])
                model = degrees(channel, own[f"{channel}_predicted_rad"])
                style = model_style(i)
                draw(top, own["time_s"].to_numpy(), model, plot_text(name), **style)
                difference = model - degrees(channel, own[f"{channel}_measured_rad"])
                draw(low, own["time_s"].to_numpy(), difference, **{**style, "linewidth": 0.9})
            top.set_title(TITLE[channel], fontsize=9)
            finish_axes(top, rotation_label(channel), bottom=False)
            finish_axes(low, "model − film (°)")
            lost = int(np.isnan(measured).sum())
            median = float(np.nanmedian(reach)) / 2 if np.isfinite(reach).any() else float("nan")
            notes.append(f"{TITLE[channel]}: u = {median:.3f}° (median), {lost} of {measured.size} frames lost")
        lines = shared_legend(figure, [grid[0, 0]])
        caption = (
            f"Rotation of jack and repetition lever relative to the whippen, tracked on the film of "
            f"trial {trial}; below: model minus film, with the film's ± 2u about zero. " + "; ".join(notes) + "."
        )
        figures.append(
            finish(view, figure, f"film-{trial}", measured_anchor(view.condition, "film"), caption, caption, lines)
        )
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
    caption = (
        f"Force at the key front that {view.names[i]} needs for the measured motion of the key, "
        f"trial {int(row['trial'])}. "
        f"RMSE {row['rmse_n']:.2f} N, {100 * row['rmse_over_peak']:.1f} % of the peak; "
        f"{100 * row['left_out_share']:.1f} % of the window left out (key may lift)."
    )
    text = f"Measured peak {row['peak_measured_n']:.1f} N, predicted {row['peak_predicted_n']:.1f} N."
    anchor = "Not in the thesis: the model driven the other way round."
    return finish(view, figure, "force-motion" if i == 0 else f"force-motion-{i + 1}", anchor, caption, text)
