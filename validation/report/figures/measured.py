"""Figures of what was measured: force and rotations of all trials with repeatability; and the list of all figures.

Source: thesis Figures 3.9–3.12.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from model.inside.labels import BODY_COLORS
from validation.conventions import Array
from validation.curves.display_signs import TITLE, degrees, rotation_label
from validation.curves.style import BLACK, VERMILION
from validation.curves.table import force_on_base
from validation.events.definitions import EVENTS
from validation.measurement.trial import trials_in_words
from validation.numbers import number
from validation.report.figures.layout import (
    FORCE,
    MOST_LINES,
    QUANTILES,
    WIDTH,
    ReportFigure,
    curves_of,
    draw_trials,
    left_out_intervals,
    lift_text,
    make_figure,
    model_pen,
    shade_lifts,
    spread_of,
)
from validation.report.figures.overlays import compared_figures
from validation.report.figures.svg import Chart, Panel, Pen
from validation.report.view import SessionView

FEWEST = 6
MOVING_RANGE = 2.66
COLUMNS = 300
THESIS = {"key": "3.10", "whippen": "3.11", "hammer": "3.12"}
CHARTS = ("hammer_speed", "check_height", "key_release")


def control_charts(view: SessionView) -> ReportFigure | None:
    """Control charts over the trial number of peak force, hammer RMSE and three events, with limits at mean ± 2.66
    times the mean difference of neighbours; None with fewer than six trials.

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
    charts += [(EVENTS[name].label, *_select_event(result.events, name)) for name in CHARTS]
    charts = [chart for chart in charts if chart[1].size]
    chart = Chart(WIDTH, 90 * len(charts) + 22, rows=[1.0] * len(charts), top=17, between=19)
    outside = []
    for panel, (title, trials, values) in zip(chart.panels, charts, strict=True):
        panel.title, panel.has_integers = title, True
        panel.x = float(min(c[1].min() for c in charts)) - 0.5, float(max(c[1].max() for c in charts)) + 0.5
        beyond = _draw_chart(panel, trials, values)
        if beyond:
            outside.append(f"{title}: {trials_in_words(beyond)}")
    chart.panels[-1].x_label = "trial"
    said = "Beyond the limits: " + "; ".join(outside) + "." if outside else "No trial is beyond its limits."
    caption = (
        "Control charts over the trial number. Line: mean; dashed: mean ± 2.66 times the mean difference of "
        f"neighbouring trials. {said}"
    )
    return make_figure(view, chart, "control", caption, said)


def _limits(values: Array) -> tuple[float, float]:
    """Mean, and how far from it the limits are; NaN below `FEWEST` values."""
    reach = MOVING_RANGE * float(np.mean(np.abs(np.diff(values)))) if values.size >= FEWEST else float("nan")
    return float(np.mean(values)), reach


def _select_event(events: pd.DataFrame, name: str) -> tuple[Array, Array]:
    """Trials and values of one measured event, in the unit it is shown in."""
    own = events[(events["source"] == "trial") & (events["event"] == name)].dropna(subset=["value"])
    return own["trial"].to_numpy(), EVENTS[name].display_factor * own["value"].to_numpy(dtype=float)


def _draw_chart(panel: Panel, trials: Array, values: Array) -> list[int]:
    """Draw one control chart of ``values`` (n,) over the trial numbers ``trials`` (n,) into a panel; returns the
    numbers of the trials beyond its limits, empty below six trials."""
    mean, reach = _limits(values)
    panel.level(mean, Pen(FORCE, 0.9))
    beyond = np.zeros(values.size, dtype=bool)
    if np.isfinite(reach):
        beyond = np.abs(values - mean) > reach
        for limit in (mean - reach, mean + reach):
            panel.level(limit, Pen(FORCE, 0.8, (4, 2)))
    size = 4.0 if values.size <= 60 else 2.0
    panel.line(trials, values, Pen(BLACK, 0.6))
    panel.points(trials, values, BLACK, size)
    panel.points(trials[beyond], values[beyond], VERMILION, size + 2, is_square=True)
    return [int(t) for t in trials[beyond]]


def force_from_motion(view: SessionView, i: int) -> ReportFigure:
    """Figure of the measured force, N, and of the force that the i-th model needs for the measured motion of the key,
    with its uncertainty, and their difference; that model's result must have a motion trace."""
    result = view.results[i]
    trace, row = result.motion_trace, result.motion_driven.iloc[0]
    assert trace is not None
    time = trace["time_s"].to_numpy()
    use = ~trace["left_out"].to_numpy(dtype=bool)
    measured, predicted = trace["force_n"].to_numpy(), np.where(use, trace["predicted_force_n"].to_numpy(), np.nan)
    reach = trace["factor"].to_numpy() * trace["u_predicted_n"].to_numpy()
    chart = Chart(WIDTH, 259, rows=(2.2, 1))
    top, low = chart.panels
    top.band(time, predicted - reach, predicted + reach)
    top.line(time, measured, Pen(FORCE, 1.1), f"measured, trial {int(row['trial'])}")
    top.line(time, predicted, model_pen(i), "from the key's motion")
    low.line(time, predicted - measured, Pen(BLACK, 0.9))
    top.y_label, low.y_label, low.x_label = "force (N)", "difference (N)", "time (s)"
    name = "the model" if len(view.results) == 1 else view.names[i]
    caption = (
        f"Force at the key front that {name} needs for the measured motion of the key, "
        f"trial {int(row['trial'])}. "
        f"RMSE {row['rmse_n']:.2f} N, {100 * row['rmse_over_peak']:.1f} % of the peak; "
        f"{100 * row['left_out_share']:.1f} % of the window left out (key may lift)."
    )
    text = f"Measured peak {row['peak_measured_n']:.1f} N, predicted {row['peak_predicted_n']:.1f} N."
    key = "force-motion" if i == 0 else f"force-motion-{i + 1}"
    return make_figure(view, chart, key, caption, text)


def force_of_all_trials(view: SessionView) -> ReportFigure:
    """Figure of the corrected force, N, of every trial over time, of many their quantiles (thesis 3.9)."""
    result = view.first
    curves = np.column_stack([force_on_base(result.base_s, frame) for frame in result.traces.values()])
    chart = Chart(WIDTH, 216)
    (panel,) = chart.panels
    draw_trials(panel, result.base_s, curves, FORCE, COLUMNS)
    panel.x_label, panel.y_label = "time (s)", "force (N)"
    caption = f"Measured force of all {curves.shape[1]} trials, corrected for offset, hum and delay, never smoothed"
    text = f"{curves.shape[1]} curves of force over time; the largest force is {np.nanmax(curves):.1f} N."
    made = make_figure(view, chart, "force-all", f"{caption}{_quantiles(curves)} As thesis 3.9.", text)
    return replace(made, channel="force", shows="all")


def _quantiles(curves: Array) -> str:
    """How all trials are drawn, at the end of a caption."""
    return f": {QUANTILES}." if curves.shape[1] > MOST_LINES else "."


def rotation_of_all_trials(view: SessionView, channel: str) -> ReportFigure:
    """Figure of the measured rotation of the encoder body ``channel`` in all trials, degrees, with the 95 % band of
    their mean, and below s_r(t) (thesis 3.10–3.12)."""
    result, color = view.first, BODY_COLORS[channel]
    base, curves = result.base_s, curves_of(result, channel, "measured")
    chart = Chart(WIDTH, 245, rows=(3, 1))
    top, low = chart.panels
    draw_trials(top, base, curves, color, COLUMNS)
    s_r, reach = spread_of(result, channel, "s_r"), spread_of(result, channel, "band95")
    known, banded = bool(np.isfinite(s_r).any()), bool(np.isfinite(reach).any())
    mean = degrees(channel, result.spread[f"{channel}_mean_rad"])
    lifts = left_out_intervals(result, channel)
    top.band(base, mean - reach, mean + reach, label="mean, 95 % band")
    shade_lifts(top, lifts, list(result.traces))
    if known:
        low.line(base, s_r, Pen(color))
    top.y_label, low.y_label, low.x_label, low.least = rotation_label(channel), "$s_r$ (°)", "time (s)", 0.0
    text = f"sᵣ(t) is at most {np.nanmax(s_r):.3f}°." if known else "sᵣ(t) is not known."
    caption = f"Rotation of the {TITLE[channel]} in all {len(result.traces)} trials; below: repeatability sᵣ(t)"
    caption += _quantiles(curves)
    if banded:
        caption += f" Grey: simultaneous 95 % band of the mean, at most ±{number(float(np.nanmax(reach)), 2)}°."
    made = make_figure(view, chart, f"{channel}-all", f"{caption}{lift_text(lifts)} As thesis {THESIS[channel]}.", text)
    return replace(made, channel=channel, shows="all")


def all_figures(view: SessionView) -> dict[str, list[ReportFigure]]:
    """Figures of a session by section of the page: ``trials`` (shown trial against the models; thesis 4.1–4.15, 3.13)
    and ``repeatability`` (all trials, control charts; 3.9–3.12), which one trial has none of."""
    trials = compared_figures(view)
    trials += [force_from_motion(view, i) for i, r in enumerate(view.results) if r.motion_trace is not None]
    if len(view.first.traces) < 2:
        return {"trials": trials, "repeatability": []}
    repeatability = [force_of_all_trials(view)] if view.has_force else []
    repeatability += [rotation_of_all_trials(view, channel) for channel in view.measured]
    control = control_charts(view)
    return {"trials": trials, "repeatability": repeatability + ([] if control is None else [control])}
