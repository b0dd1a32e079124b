"""What every figure of the report shares: size, evaluation window, lifts of the key, and how it becomes SVG."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from validation.report.figures.pointed import Pointed, pointed_json
from validation.report.figures.svg import TIME_PANEL, figure_svg
from validation.report.view import SessionView
from validation.result import ValidationResult

ZOOM_S = (0.02, 0.03)
WIDTH_IN = 9.2
TITLE_PAD = 13.0  # points: the letters of the marks stand between title and panel
# inches: what ticks and an axis label take beside the ticks' numbers, a line of text, the edges
BESIDE_IN, LINE_IN, EDGE_IN, GAP_IN = 0.36, 0.19, 0.1, 0.12
POINTS_PER_IN = 72.0


@dataclass(frozen=True)
class ReportFigure:
    """One figure: its id, which figure of the thesis it repeats, caption and SVG text; the channel it shows and whether
    of the chosen trial (``one``), of all trials (``all``) or neither; what it says of the chosen trial."""

    key: str
    anchor: str
    caption: str
    svg: str
    channel: str = ""
    shows: str = ""
    of_trial: str = ""


def window(result: ValidationResult, frame: pd.DataFrame) -> pd.DataFrame:
    """The rows of a trace inside the evaluation window."""
    return frame[result.window.mask(frame["time_s"].to_numpy())]


def left_out_intervals(result: ValidationResult, channel: str) -> pd.DataFrame:
    """Intervals of a channel that are left out of the scores, of all trials."""
    return result.marked[result.marked["channel"] == channel]


def lift_text(lifts: pd.DataFrame) -> str:
    """The intervals left out, in words, for readers who cannot see the shading."""
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
        axes.set_label(TIME_PANEL)
        axes.set_title("around the string impact", fontsize=9, pad=TITLE_PAD)


def arrange(figure: Figure, legend_lines: int = 0) -> None:
    """Place the panels of one grid by the length of their labels, below so many lines of a legend of them all.

    A layout engine would draw the figure once to measure it and once more to keep it, three times the work.
    """
    panels = [(axes, place) for axes in figure.axes if (place := axes.get_subplotspec()) is not None]
    rows, columns = panels[0][1].get_geometry()[:2]
    left = np.zeros(columns)
    above, below = np.zeros((2, rows))
    for axes, place in panels:
        row, column = place.rowspan.start, place.colspan.start
        ticks = axes.yaxis.get_major_formatter().format_ticks(list(axes.get_yticks()))
        longest = max((_width_in(text) for text in ticks), default=0.0)
        left[column] = max(left[column], BESIDE_IN + longest)
        numbered = bool(axes.xaxis.get_tick_params().get("labelbottom", True))
        below[row] = max(below[row], LINE_IN * (numbered + bool(axes.get_xlabel())))
        above[row] = max(above[row], LINE_IN * (1.2 if axes.get_title() or axes.get_title("left") else 0.0))
    above[0] += LINE_IN * legend_lines
    width, height = figure.get_size_inches()
    inside = width - left.sum() - EDGE_IN * columns
    between = float(np.mean(left[1:])) + EDGE_IN if columns > 1 else 0.0
    tall = height - above.sum() - below.sum() - GAP_IN * rows - EDGE_IN
    under = float(np.mean(above[1:] + below[:-1])) + GAP_IN if rows > 1 else 0.0
    figure.subplots_adjust(
        left=left[0] / width,
        right=1 - EDGE_IN / width,
        top=1 - (above[0] + EDGE_IN) / height,
        bottom=(below[-1] + GAP_IN) / height,
        wspace=between * columns / inside,
        hspace=under * rows / tall,
    )


def _width_in(tick: str) -> float:
    """Width of a tick's number, inches."""
    text = tick.replace("$\\mathdefault{", "").rstrip("}$")
    font = FontProperties(size=rcParams["ytick.labelsize"])
    return float(text_to_path.get_text_width_height_descent(text, font, False)[0]) / POINTS_PER_IN


def finish(
    view: SessionView,
    figure: Figure,
    key: str,
    anchor: str,
    caption: str,
    description: str,
    legend_lines: int = 0,
    pointed: Sequence[Pointed] = (),
) -> ReportFigure:
    """The drawn figure as a `ReportFigure`; all panels but those around the impact show the evaluation window.

    ``pointed``: values under the pointer, where the curves are not among those of the page.
    """
    window = view.first.window
    whole = (window.start_s, window.end_s)
    for axes in figure.axes:
        if axes.get_autoscalex_on():
            axes.set_xlim(*whole)
    arrange(figure, legend_lines)
    name = f"{view.prefix}{key}"
    svg = figure_svg(figure, name, caption, description, whole)
    if pointed:
        svg = svg.replace("<svg", f'<svg data-pointed="{html.escape(pointed_json(figure, name, pointed))}"', 1)
    return ReportFigure(name, anchor, caption, svg)
