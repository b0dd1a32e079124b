"""Control charts: what each trial gave, over its number, with the limits of its own short-term scatter.

Individuals chart: centre line the mean, limits mean ± 2.66 times the mean difference of neighbouring trials; from
`FEWEST` trials on, because from fewer the limits mean nothing. Source: Shewhart; ISO 7870-2.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from validation.conventions import Array
from validation.curves.style import BLACK, BLUE, VERMILION
from validation.events.definitions import EVENTS
from validation.report.figures.layout import WIDTH_IN, ReportFigure, finish
from validation.report.figures.pointed import Pointed
from validation.report.view import SessionView

FEWEST = 6
MOVING_RANGE = 2.66
CHARTS = ("hammer_speed", "check_height", "key_release")


def control_charts(view: SessionView) -> ReportFigure | None:
    """Peak force, RMSE of the hammer and three events of every trial over its number; None below `FEWEST` trials."""
    result = view.first
    numbers = np.array(list(result.traces))
    if numbers.size < FEWEST:
        return None
    peaks = [float(np.nanmax(frame["force_n"].to_numpy())) for frame in result.traces.values()]
    charts: list[tuple[str, Array, Array]] = [("peak force (N)", numbers, np.array(peaks))]
    rmse = result.scores[result.scores["channel"] == "hammer"].dropna(subset=["rmse_rad"])
    charts.append(("hammer RMSE (°)", rmse["trial"].to_numpy(), np.degrees(rmse["rmse_rad"].to_numpy(dtype=float))))
    for name in CHARTS:
        charts.append((EVENTS[name].label, *_of_event(result.events, name)))
    charts = [chart for chart in charts if chart[1].size]
    figure = Figure(figsize=(WIDTH_IN, 1.25 * len(charts) + 0.3))
    panels = figure.subplots(len(charts), 1, sharex=True, squeeze=False)[:, 0]
    outside = []
    for i, (axes, (title, trials, values)) in enumerate(zip(panels, charts, strict=True)):
        beyond = _chart(axes, trials, values)
        if beyond:
            outside.append(f"{title}: trial{'' if len(beyond) == 1 else 's'} {', '.join(map(str, beyond))}")
        axes.set_title(title, fontsize=8.5, loc="left")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if i == len(charts) - 1:
            axes.set_xlabel("trial")
        else:
            axes.tick_params(labelbottom=False)
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
