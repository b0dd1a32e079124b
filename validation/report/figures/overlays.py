"""Figures of model against experiment: one trial with the predictions of every model, residuals of all trials below.

Conventions: as `validation.report.figures.measured`; the trial is a solid black line, each model has its own colour
and dashes, the same in all figures; one panel of residuals for each model, all with the same scale.
Source: thesis Figures 3.13 and 4.1–4.15.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.conventions import Array
from validation.curves.display_signs import SIGN, TITLE, degrees, rotation_label
from validation.curves.plot import draw_marks
from validation.curves.style import (
    BLACK,
    SKY,
    band,
    columns_for,
    draw,
    finish_axes,
    line_style,
    model_style,
    plot_text,
    shade_lifts,
    shared_legend,
)
from validation.curves.table import on_base
from validation.report.figures.layout import (
    MOST_LINES,
    QUANTILES,
    WIDTH_IN,
    ReportFigure,
    draw_quantiles,
    finish,
    left_out_intervals,
    lift_text,
    quantiles,
    window,
    zoom_on_impact,
)
from validation.report.view import SessionView, compared_anchor
from validation.result import ValidationResult

MARKS_SAID = (
    " Solid lines A, B, C: positions of the thesis (key at its bottom; force released; key back); dotted: events."
)


def force_of_one_trial(view: SessionView) -> ReportFigure:
    """Corrected and raw force of one trial (thesis 4.1, 4.5, 4.12)."""
    result, trial = view.first, view.shown_trial()
    f = window(result, result.traces[trial])
    figure = Figure(figsize=(WIDTH_IN, 3.0))
    axes, zoom = figure.subplots(1, 2, width_ratios=(2.2, 1))
    for i, panel in enumerate((axes, zoom)):
        raw, at = f["raw_force_n"].to_numpy(), f["time_s"].to_numpy()
        draw(panel, at, raw, "as recorded", color=SKY, linewidth=0.8, gid=f"raw-{i}")
        force, at = f["force_n"].to_numpy(), f["force_time_s"].to_numpy()
        draw(panel, at, force, "corrected", color=BLACK, linewidth=1.1, gid=f"trial-{i}")
        finish_axes(panel, "force (N)")
        draw_marks(panel, result.marks(trial))
    zoom_on_impact(result, trial, zoom)
    lines = shared_legend(figure, [axes])
    caption = "Force as recorded, and as it drives the model, corrected (offset, hum, delay)." + MARKS_SAID
    top = int(np.nanargmax(f["force_n"].to_numpy()))
    text = f"The largest force is {f['force_n'].iloc[top]:.1f} N at {f['force_time_s'].iloc[top]:.4f} s."
    anchor = compared_anchor(view.condition, "force", len(view.results))
    made = finish(view, figure, "force-one", anchor, caption, text, lines + 1)
    return replace(made, channel="force", shows="one", of_trial=f"Trial {trial}.")


def model_against_trial(view: SessionView, channel: str) -> ReportFigure:
    """One channel of one trial with every prediction, and the residuals of all trials (thesis 4.2–4.4, 4.6–4.15)."""
    result, trial = view.first, view.shown_trial()
    f = window(result, result.traces[trial])
    time = f["time_s"].to_numpy()
    measured = degrees(channel, f[f"{channel}_measured_rad"])
    low, high = _extent(view, channel)
    limit = limit_of_trial(result, channel, time)
    about = float(np.nanmax(limit)) if np.isfinite(limit).any() else 0.0
    lifts = left_out_intervals(result, channel)
    n = len(view.results)
    figure = Figure(figsize=(WIDTH_IN, 3.3 + 1.9 * n))
    grid = figure.subplots(n + 1, 2, sharex="col", height_ratios=(1.6, *[1] * n), width_ratios=(2.2, 1))
    for place, top in enumerate(grid[0]):
        band(top, time, measured - limit, measured + limit, "repeatability limit", gid=f"limit-{place}")
        shade_lifts(top, lifts, [trial])
        draw(top, time, measured, "trial", color=BLACK, linewidth=1.2, gid=f"trial-{place}")
        draw_marks(top, result.marks(trial))
        for i, (name, other) in enumerate(zip(view.names, view.results, strict=True)):
            own = window(other, other.traces[trial])
            predicted = degrees(channel, own[f"{channel}_predicted_rad"])
            style = model_style(i) | {"gid": f"model{i}-{place}"}
            draw(top, own["time_s"].to_numpy(), predicted, plot_text(name), **style)
        finish_axes(top, rotation_label(channel), bottom=False)
        top.set_ylim(low - about, high + about)
    reached = 0.0
    for i, (row, name, other) in enumerate(zip(grid[1:], view.names, view.results, strict=True)):
        reached = max(reached, _residuals(row, other, channel, (i, trial), last=i == n - 1))
        if n > 1:
            row[0].set_title(plot_text(f"{name} − trial"), fontsize=9, loc="left")
    _same_scale([axes for row in grid[1:] for axes in row])
    lines = shared_legend(figure, list(grid[:, 0]))
    zoom_on_impact(result, trial, grid[0, 1])
    several = len(result.traces) > MOST_LINES
    caption = f"Rotation of the {TITLE[channel]}, one trial and model{'s' if n > 1 else ''}; below: model minus trial, "
    caption += f"{QUANTILES} of all trials" if several else "a line for each trial as in the figures of all trials"
    caption += ", the drawn trial in black." + MARKS_SAID
    if np.isfinite(limit).any():
        caption += (
            " Shaded above: repeatability limit about this trial, which two trials differ by less than in 95 % "
            f"of cases at each instant, at most {about:.2g}°."
        )
    if reached > 0.0:
        caption += (
            f" Shaded below: 95 % interval of the mean difference at each instant, at most ±{reached:.2g}°; by chance "
            "it leaves zero at one instant in twenty."
        )
    caption += lift_text(lifts)
    anchor = compared_anchor(view.condition, channel, n)
    text = trial_words(view, channel, trial)
    made = finish(view, figure, f"{channel}-model", anchor, caption, text, lines + 1)
    return replace(made, channel=channel, shows="one", of_trial=text)


def trial_words(view: SessionView, channel: str, trial: int) -> str:
    """RMSE and largest difference of one trial with every model, in a sentence."""
    parts = []
    for name, other in zip(view.names, view.results, strict=True):
        own = other.scores[(other.scores["trial"] == trial) & (other.scores["channel"] == channel)]
        if not len(own):
            continue
        row = own.iloc[0]
        called = "" if len(view.results) == 1 else f"{name}: "
        largest = f"largest difference {np.degrees(row['largest_rad']):.4f}° at {row['largest_at_s']:.4f} s"
        called += "outside of what was fitted, " if trial in other.outside else ""
        parts.append(f"{called}RMSE {np.degrees(row['rmse_rad']):.4f}°, {largest}")
    return f"Trial {trial}: {'; '.join(parts)}." if parts else f"Trial {trial}: not compared."


def _extent(view: SessionView, channel: str) -> tuple[float, float]:
    """Least and largest rotation of all trials and predictions inside the window, with a margin, degrees."""
    ends = []
    for result in view.results:
        for frame in result.traces.values():
            part = window(result, frame)
            for kind in ("measured", "predicted"):
                values = degrees(channel, part[f"{channel}_{kind}_rad"])
                if np.isfinite(values).any():
                    ends += [float(np.nanmin(values)), float(np.nanmax(values))]
    low, high = (min(ends), max(ends)) if ends else (0.0, 1.0)
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def limit_of_trial(result: ValidationResult, channel: str, time: Array) -> Array:
    """How much another trial may differ from one at each instant, degrees: the limit's factor times s_r(t)."""
    row = result.channels[result.channels["channel"] == channel].iloc[0]
    factor = float(row["limit_rad"]) / float(row["s_r_rad"]) if row["s_r_rad"] > 0 else float("nan")
    s_r = np.degrees(result.spread[f"{channel}_s_r_rad"].to_numpy())
    limit = np.interp(time, result.spread["time_s"].to_numpy(), s_r * factor, left=np.nan, right=np.nan)
    return np.asarray(limit, dtype=float)


def _residuals(
    panels: np.ndarray, result: ValidationResult, channel: str, shown: tuple[int, int], *, last: bool
) -> float:
    """Model minus trial for all trials with the band of their mean; its largest half width, 0 where there is none.

    ``shown``: number of the model in the figure, and the trial that is drawn above.
    """
    base = result.spread["time_s"].to_numpy()
    mean = degrees(channel, result.spread[f"{channel}_difference_rad"])
    reach = np.degrees(result.spread[f"{channel}_difference_u95_rad"].to_numpy())
    lifts = left_out_intervals(result, channel)
    several = len(result.traces) > MOST_LINES
    scattered = quantiles(base, _differences(result, channel, base)) if several else None
    model, trial = shown
    for place, low in enumerate(panels):
        for i, (number, frame) in enumerate(result.traces.items()):
            if several and number != trial:
                continue
            part = window(result, frame)
            difference = part[f"{channel}_predicted_rad"].to_numpy() - part[f"{channel}_measured_rad"].to_numpy()
            drawn = number == trial
            style = {"color": BLACK, "linewidth": 1.1} if drawn else line_style(i) | {"linewidth": 0.8}
            draw(
                low,
                part["time_s"].to_numpy(),
                SIGN[channel] * np.degrees(difference),
                columns=columns_for(len(result.traces)),
                **style | ({"gid": f"difference{model}-{place}", "zorder": 3} if drawn else {}),
            )
        if scattered is not None:
            draw_quantiles(low, scattered)
        band(low, base, mean - reach, mean + reach, "mean difference, 95 % at each instant", alpha=0.5)
        shade_lifts(low, lifts, list(result.traces))
        low.axhline(0.0, color="#777777", linewidth=0.7)
        finish_axes(low, "model − trial (°)", bottom=last)
    return float(np.nanmax(reach)) if np.isfinite(reach).any() else 0.0


def _differences(result: ValidationResult, channel: str, base: Array) -> Array:
    """Model minus trial of every trial on the base, (n_samples, n_trials) degrees."""
    columns = []
    for frame in result.traces.values():
        difference = frame[f"{channel}_predicted_rad"].to_numpy() - frame[f"{channel}_measured_rad"].to_numpy()
        columns.append(SIGN[channel] * np.degrees(on_base(base, frame["time_s"].to_numpy(), difference)))
    return np.column_stack(columns)


def _same_scale(panels: list[Axes]) -> None:
    """The largest range of all panels for each of them."""
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
