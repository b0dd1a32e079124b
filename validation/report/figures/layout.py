"""What every figure of the report shares: size, evaluation window, lifts of the key, and how it becomes SVG."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from validation.conventions import Array
from validation.curves.style import BLUE, draw, uneven_samples
from validation.report.figures.svg import TIME_PANEL, figure_svg
from validation.report.view import SessionView
from validation.result import ValidationResult

MOST_SAMPLES = 300


@dataclass(frozen=True)
class Pointed:
    """What is said of a place in some panels."""

    panels: tuple[Axes, ...]  # Axes that share the values
    along: Array  # (n,) places along the horizontal axis
    head: tuple[str, int]  # what leads the first line, with ``{}`` for the place, and its digits
    lines: tuple[tuple[str, str, int, Array], ...]  # name, unit, digits and (n,) values of each further line


def pointed_json(figure: Figure, key: str, pointed: Sequence[Pointed]) -> str:
    """Values and places of the panels, in the units of the SVG; known once the figure has been drawn.

    Conventions: as shown, in degrees, newtons and the units of the charts; at most `MOST_SAMPLES` places along a curve;
    null where there is no value. The page's script ``pointed.js`` shows the nearest place.
    """
    width, height = (72 * float(v) for v in figure.get_size_inches())
    out: list[dict[str, Any]] = []
    for one in pointed:
        some = slice(None, None, -(-one.along.size // MOST_SAMPLES) if one.along.size else 1)
        boxes = []
        for axes in one.panels:
            box = axes.get_position()
            boxes.append(
                {
                    "id": f"{key}-axes_{figure.axes.index(axes) + 1}",
                    "left": round(width * box.x0, 3),
                    "right": round(width * box.x1, 3),
                    "top": round(height * (1 - box.y1), 3),
                    "bottom": round(height * (1 - box.y0), 3),
                    "x": [round(float(v), 6) for v in axes.get_xlim()],
                }
            )
        lines: list[dict[str, Any]] = [
            {"name": name, "unit": unit, "digits": digits, "y": _plain(values[some], digits)}
            for name, unit, digits, values in one.lines
        ]
        head, digits = one.head
        out.append(
            {
                "panels": boxes,
                "head": head,
                "digits": digits,
                "x": _plain(one.along[some], digits + 1),
                "lines": [line for line in lines if any(y is not None for y in line["y"])],
            }
        )
    return json.dumps(out, separators=(",", ":"), ensure_ascii=False)


def _plain(values: Array, digits: int) -> list[float | None]:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]


MOST_LINES = 10
SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = "median, quartiles and 5 % to 95 %"
SAMPLES = 500


def quantiles(time_s: Array, curves: Array) -> tuple[Array, Array]:
    """Quantiles over the trials at unevenly thinned times: the times, and one column for each of `SHARES`.

    Shaded: between the 5 % and 95 % and between the 25 % and 75 % quantile of the trials at each instant; line: median.

    Parameters
    ----------
    time_s : (n_samples,)
    curves : (n_samples, n_trials), NaN is left out
    """
    at = uneven_samples(time_s, curves[:, :: max(1, curves.shape[1] // 8)], SAMPLES)
    ordered = np.sort(curves[at], axis=1)  # NaN last
    known = np.isfinite(ordered).sum(axis=1)
    place = np.clip(known - 1, 0, None)[:, None] * np.array(SHARES)
    low = np.floor(place).astype(int)
    high = np.minimum(low + 1, np.clip(known - 1, 0, None)[:, None])
    rows = np.arange(at.size)[:, None]
    values = ordered[rows, low] * (1 - (place - low)) + ordered[rows, high] * (place - low)
    return time_s[at], np.where(known[:, None] > 0, values, np.nan)


def draw_quantiles(axes: Axes, found: tuple[Array, Array]) -> None:
    """Two shades and a line."""
    t, v = found
    axes.fill_between(t, v[:, 0], v[:, 4], color=BLUE, alpha=0.18, linewidth=0, label="trials, 5 % to 95 %")
    axes.fill_between(t, v[:, 1], v[:, 3], color=BLUE, alpha=0.35, linewidth=0, label="trials, quartiles")
    draw(axes, t, v[:, 2], "trials, median", color=BLUE, linewidth=1.1)


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
