"""Figures of model against experiment: one trial with the predictions of every model, residuals of all trials below.

Conventions: the trial is a solid line in the colour of its body, each model black with its own dashes; one panel of
residuals for each model, all with the same scale.
Source: thesis Figures 3.13 and 4.1–4.15.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.inside.labels import BODY_COLORS
from validation.conventions import BODIES, Array
from validation.curves.display_signs import SIGN, TITLE, degrees, rotation_label
from validation.curves.style import BLACK, GREY, SKY
from validation.numbers import number
from validation.report.figures.layout import (
    FORCE,
    QUANTILES,
    WIDTH,
    ZERO,
    ReportFigure,
    curves_of,
    differences_of,
    draw_trials,
    left_out_intervals,
    lift_text,
    make_figure,
    model_pen,
    shade_lifts,
    spread_of,
    traces_of,
    window,
)
from validation.report.figures.svg import Chart, Panel, Pen
from validation.report.view import SessionView
from validation.result import ValidationResult

NOTE = (
    "One trial, in the colour of its body, and the predictions, dashed and black; below: model − trial of every trial, "
    f"of many the {QUANTILES}, the drawn trial in black. Solid lines A, B, C: positions of the thesis (key at its "
    "bottom; force released; key back); dotted: events. Grey above: repeatability limit, which two trials differ by "
    "less than in 95 % of cases at each instant; below: 95 % interval of the mean difference, which by chance leaves "
    "zero at one instant in twenty."
)

LETTERS = 19.0  # points above a panel whose marks have letters
THESIS = {
    "force": "4.1, 4.5 and 4.12",
    "key": "4.2, 4.6 and 4.13",
    "whippen": "4.3, 4.7 and 4.14",
    "hammer": "4.4, 4.8 and 4.15",
    "jack": "3.13",
    "repetition": "3.13",
}


def force_of_one_trial(view: SessionView) -> ReportFigure:
    """Figure of the force of the shown trial over time, N, as recorded and corrected (thesis 4.1, 4.5, 4.12)."""
    result, trial = view.first, view.shown_trial()
    f = window(result, result.traces[trial])
    chart = Chart(WIDTH, 216, top=LETTERS)
    (panel,) = chart.panels
    panel.x_label, panel.y_label, panel.marks, panel.has_letters = "time (s)", "force (N)", result.marks(trial), True
    panel.line(f["time_s"].to_numpy(), f["raw_force_n"].to_numpy(), Pen(SKY, 0.8), "as recorded", name="raw")
    force, at = f["force_n"].to_numpy(), f["force_time_s"].to_numpy()
    panel.line(at, force, Pen(FORCE, 1.1), "corrected", name="trial")
    caption = "Force as recorded, and as it drives the model, corrected (offset, hum, delay)."
    top = int(np.nanargmax(force))
    text = f"The largest force is {force[top]:.1f} N at {at[top]:.4f} s."
    made = make_figure(view, chart, "force-one", f"{caption} As thesis {THESIS['force']}.", text)
    return replace(made, channel="force", shows="one", of_trial=f"Trial {trial}.")


def model_against_trial(view: SessionView, channel: str) -> ReportFigure:
    """Figure of the body ``channel`` in the shown trial with every model's prediction, degrees, and below, for each
    model, model − trial of all trials (thesis 3.13, 4.2–4.15)."""
    result = view.first
    trial = view.shown_trial(channel)
    f = window(result, traces_of(result, channel)[trial])
    time = f["time_s"].to_numpy()
    measured = degrees(channel, f[f"{channel}_measured_rad"])
    limit = limit_of_trial(result, channel, time)
    about = float(np.nanmax(limit)) if np.isfinite(limit).any() else 0.0
    lifts = left_out_intervals(result, channel)
    n = len(view.results)
    chart = Chart(WIDTH, 238 + 137 * n, rows=(1.6, *[1] * n), top=LETTERS)
    top, *panels = chart.panels
    top.y_label, top.marks, top.has_letters = rotation_label(channel), result.marks(trial), True
    top.band(time, measured - limit, measured + limit, label="repeatability limit", name="limit")
    shade_lifts(top, lifts, [trial])
    top.line(time, measured, Pen(BODY_COLORS[channel], 1.2), "trial", name="trial")
    low, high = _extent(view, channel)
    top.y = low - about, high + about
    reached = 0.0
    for i, (panel, name, other) in enumerate(zip(panels, view.names, view.results, strict=True)):
        own = traces_of(other, channel).get(trial)
        if own is not None:
            own = window(other, own)
            predicted = degrees(channel, own[f"{channel}_predicted_rad"])
            top.line(own["time_s"].to_numpy(), predicted, model_pen(i), name, name=f"model{i}")
        reached = max(reached, _residuals(panel, other, channel, trial, i))
        panel.y_label, panel.title = "model − trial (°)", f"{name} − trial" if n > 1 else ""
    panels[-1].x_label = "time (s)"
    limits = [panel.y_limits() for panel in panels]
    for panel in panels:
        panel.y = min(low for low, _ in limits), max(high for _, high in limits)
    caption = f"Rotation of the {TITLE[channel]}"
    caption += f"; repeatability limit at most {number(about, 2)}°" if about else ""
    caption += f"; 95 % interval of the mean difference at most ±{number(reached, 2)}°." if reached else "."
    text = trial_words(view, channel, trial)
    caption = f"{caption}{lift_text(lifts)} As thesis {THESIS[channel]}."
    made = make_figure(view, chart, f"{channel}-model", caption, text)
    return replace(made, channel=channel, shows="one", of_trial=text)


def trial_words(view: SessionView, channel: str, trial: int) -> str:
    """Sentence with RMSE and largest difference, degrees, of the body ``channel`` in the trial numbered ``trial``, for
    each model; says so where it was not compared."""
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
    curves = [curves_of(result, channel, kind) for result in view.results for kind in ("measured", "predicted")]
    known = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def limit_of_trial(result: ValidationResult, channel: str, time: Array) -> Array:
    """How much another trial may differ from one at each instant, degrees: the limit's factor times s_r(t)."""
    (row,) = result.channels[result.channels["channel"] == channel].to_dict("records") or [{"s_r_rad": np.nan}]
    factor = float(row["limit_rad"]) / float(row["s_r_rad"]) if row["s_r_rad"] > 0 else float("nan")
    s_r = spread_of(result, channel, "s_r")
    limit = np.interp(time, result.spread["time_s"].to_numpy(), s_r * factor, left=np.nan, right=np.nan)
    return np.asarray(limit, dtype=float)


def _residuals(panel: Panel, result: ValidationResult, channel: str, trial: int, number: int) -> float:
    """Draw model − trial of all trials of the body ``channel`` into a panel, the one numbered ``trial`` in black, with
    the 95 % band of their mean; returns its largest half width, degrees, 0 without band. ``number``: place of the
    model."""
    base = result.base_s
    differences = differences_of(result, channel)
    draw_trials(panel, base, differences, BODY_COLORS[channel])
    traces = list(traces_of(result, channel))
    if trial in traces:
        panel.line(base, differences[:, traces.index(trial)], Pen(BLACK, 1.1), name=f"difference{number}")
    mean, reach = (spread_of(result, channel, f"difference{name}") for name in ("", "_u95"))
    mean *= SIGN[channel]
    panel.band(base, mean - reach, mean + reach, (GREY, 0.5), "mean difference, 95 % at each instant")
    shade_lifts(panel, left_out_intervals(result, channel), traces)
    panel.level(0.0, ZERO)
    return float(np.nanmax(reach)) if np.isfinite(reach).any() else 0.0


def compared_figures(view: SessionView) -> list[ReportFigure]:
    """The drawn trial against every model: force and every body that was compared."""
    return ([force_of_one_trial(view)] if view.has_force else []) + [
        model_against_trial(view, channel) for channel in BODIES if channel in view.compared
    ]
