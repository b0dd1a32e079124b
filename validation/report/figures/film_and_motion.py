"""Figures of what only some sessions have: jack and repetition lever on film, and the force from the key's motion.

Conventions: as `validation.report.figures.overlays`. Source: thesis Figure 3.13.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from validation.conventions import FILM_CHANNELS
from validation.curves.signs import TITLE, degrees, rotation_label
from validation.curves.style import BLACK, BLUE, band, draw, finish_axes, model_style, plot_text, shared_legend
from validation.report.figures.layout import WIDTH_IN, ReportFigure, finish, window
from validation.report.figures.pointed import Pointed
from validation.report.thesis import measured_anchor
from validation.report.view import SessionView


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
