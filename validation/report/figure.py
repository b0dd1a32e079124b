"""What every figure of the report shares: size, evaluation window, marked intervals, and how it becomes SVG.

Place in the data flow: used by `validation.report.figures` only.
Conventions: s on the DAQ clock.
Failure: none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.report.svg import figure_svg
from validation.result import ValidationResult

ZOOM_S = (0.02, 0.03)
WIDTH_IN = 9.2


@dataclass(frozen=True)
class ReportFigure:
    """One figure: its anchor, the thesis figure it repeats, caption and SVG text."""

    key: str
    number: str
    caption: str
    svg: str


def window(result: ValidationResult, frame: pd.DataFrame) -> pd.DataFrame:
    """The rows of a trace inside the evaluation window."""
    return frame[result.window.mask(frame["time_s"].to_numpy())]


def marked_intervals(result: ValidationResult, channel: str) -> pd.DataFrame:
    """Intervals of a channel that are left out of the scores, of all trials."""
    return result.marked[result.marked["channel"] == channel]


def lift_text(lifts: pd.DataFrame) -> str:
    """The marked intervals in words, for who cannot see the shading."""
    if not len(lifts):
        return ""
    trials = ", ".join(str(t) for t in sorted(set(lifts["trial"])))
    count = "1 interval" if len(lifts) == 1 else f"{len(lifts)} intervals"
    share = float((lifts["end_s"] - lifts["start_s"]).sum())
    return (
        f" Hatched and left out of the scores: {count}, {1e3 * share:.1f} ms in all, in which the key "
        f"may lift off its rail (trial {trials})."
    )


def zoom_on_impact(result: ValidationResult, trial: int, axes: Axes) -> None:
    """Limit a panel to the moments around the string impact of a trial, when there is one."""
    e = result.events
    hit = e[(e["trial"] == trial) & (e["source"] == "trial") & (e["event"] == "string_impact")]["value"]
    if len(hit) and np.isfinite(hit.iloc[0]):
        axes.set_xlim(float(hit.iloc[0]) - ZOOM_S[0], float(hit.iloc[0]) + ZOOM_S[1])
        axes.set_title("around the string impact", fontsize=9)


def finish(
    result: ValidationResult, figure: Figure, key: str, number: str, caption: str, description: str
) -> ReportFigure:
    """The drawn figure as a `ReportFigure`; all panels but those around the impact show the evaluation window."""
    whole = (result.window.start_s, result.window.end_s)
    for axes in figure.axes:
        if axes.get_autoscalex_on():
            axes.set_xlim(*whole)
    return ReportFigure(key, number, caption, figure_svg(figure, key, caption, description, whole))
