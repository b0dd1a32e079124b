"""What every figure of the report shares: size, curves of all trials, lifts of the key.

Conventions: what was measured has the colour of its body, a model is black and dashed; degrees with the thesis's signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.conventions import FILM_CHANNELS, Array
from validation.curves.display_signs import SIGN, degrees
from validation.curves.style import BLACK, MODEL_DASHES, uneven_samples
from validation.curves.table import interpolate_to_base_times
from validation.report.figures.svg import Chart, Panel, Pen
from validation.report.view import SessionView
from validation.result import ValidationResult

MOST_LINES = 10
SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = "median, quartiles and 5 % to 95 %"
SAMPLES = 500
WIDTH = 662.0  # points
FORCE = "#444444"
ZERO = Pen("#777777", 0.7)


@dataclass(frozen=True)
class ReportFigure:
    """One figure: its id, caption and SVG text; the channel it shows and whether of the chosen trial (``one``), of all
    trials (``all``) or neither; what it says of the chosen trial."""

    key: str
    caption: str
    svg: str
    channel: str = ""
    shows: str = ""
    of_trial: str = ""


def traces_of(result: ValidationResult, channel: str) -> dict[int, pd.DataFrame]:
    """Traces of the trials in which a body was measured, by trial: of the film for jack and repetition lever."""
    return result.film_traces if channel in FILM_CHANNELS else result.traces


def curves_of(result: ValidationResult, channel: str, kind: str) -> Array:
    """Rotations of the body ``channel``, of the ``kind`` ``measured`` or ``predicted``, of all trials on the time base,
    (n_samples, n_trials), degrees with the thesis's sign; NaN where there is none, one column of NaN without trials.

    A prediction of a body that was not filmed stands with the encoders'.
    """
    filmed = kind == "measured" or bool(result.film_traces)
    traces = traces_of(result, channel) if filmed else result.traces
    name = f"{channel}_{kind}_rad"
    columns = [
        interpolate_to_base_times(result.base_s, f["time_s"].to_numpy(), degrees(channel, f[name]))
        for f in traces.values()
    ]
    return np.column_stack(columns) if columns else np.full((result.base_s.size, 1), np.nan)


def differences_of(result: ValidationResult, channel: str) -> Array:
    """Model − trial of the body ``channel`` on the time base, (n_samples, n_trials), degrees with the thesis's sign,
    taken at each trial's samples and interpolated; NaN where there is none."""
    names = f"{channel}_predicted_rad", f"{channel}_measured_rad"
    columns = [
        interpolate_to_base_times(
            result.base_s, f["time_s"].to_numpy(), SIGN[channel] * np.degrees(f[names[0]] - f[names[1]]).to_numpy()
        )
        for f in traces_of(result, channel).values()
    ]
    return np.column_stack(columns) if columns else np.full((result.base_s.size, 1), np.nan)


def counted_trials(result: ValidationResult, channel: str) -> NDArray[np.bool_]:
    """Whether figures of several trials count each trial, (n_trials,); one value where there is none."""
    scores = result.scores[(result.scores["channel"] == channel) & ~result.scores["pooled"].astype(bool)]
    out = set(scores["trial"])
    return np.array([number not in out for number in traces_of(result, channel)] or [True])


def spread_of(result: ValidationResult, channel: str, name: str) -> Array:
    """A column of the session's spread in degrees, NaN where it has none."""
    column = f"{channel}_{name}_rad"
    if column not in result.spread:
        return np.full(result.base_s.size, np.nan)
    return np.degrees(result.spread[column].to_numpy(dtype=float))


def model_pen(i: int) -> Pen:
    """Line of the i-th model: black, with its dash pattern; measured curves are solid, in the body's colour."""
    return Pen(BLACK, 1.1, MODEL_DASHES[i % len(MODEL_DASHES)])


def draw_trials(panel: Panel, time: Array, curves: Array, color: str, columns: int = 160) -> None:
    """Draw ``curves`` (n, trials) at ``time`` (n,) into a panel: up to ten as lines, more as their median with shades
    from 25 to 75 % and from 5 to 95 %; thinned to ``columns`` places."""
    if curves.shape[1] <= MOST_LINES:
        for curve in curves.T:
            panel.line(time, curve, Pen(color, 0.9, opacity=0.75), columns=columns)
        return
    at, ends = quantiles(time, curves)
    for a, b, alpha in ((0, len(SHARES) - 1, 0.25), (1, len(SHARES) - 2, 0.4)):
        panel.band(at, ends[:, a], ends[:, b], (color, alpha), columns=SAMPLES)
    panel.line(at, ends[:, len(SHARES) // 2], Pen(color, 1.1), columns=SAMPLES)


def shade_lifts(panel: Panel, marked: pd.DataFrame, trials: list[int]) -> None:
    """Hatch the intervals of these trials that are left out of the scores."""
    for row in marked[marked["trial"].isin(trials)].itertuples():
        panel.shade(row.start_s, row.end_s, "left out: key may lift")


def quantiles(time_s: Array, curves: Array) -> tuple[Array, Array]:
    """Times of at most 500 samples, denser where ``curves`` (n, trials) bend, and there the 5, 25, 50, 75 and 95 %
    quantiles over the trials, (k, 5); NaN values do not count."""
    at = uneven_samples(time_s, curves[:, :: max(1, curves.shape[1] // 8)], SAMPLES)
    ordered = np.sort(curves[at], axis=1)  # NaN last
    known = np.isfinite(ordered).sum(axis=1)
    place = np.clip(known - 1, 0, None)[:, None] * np.array(SHARES)
    low = np.floor(place).astype(int)
    high = np.minimum(low + 1, np.clip(known - 1, 0, None)[:, None])
    rows = np.arange(at.size)[:, None]
    values = ordered[rows, low] * (1 - (place - low)) + ordered[rows, high] * (place - low)
    return time_s[at], np.where(known[:, None] > 0, values, np.nan)


def window(result: ValidationResult, frame: pd.DataFrame) -> pd.DataFrame:
    """The rows of a trace inside the evaluation window."""
    return frame[result.window.mask(frame["time_s"].to_numpy())]


def left_out_intervals(result: ValidationResult, channel: str) -> pd.DataFrame:
    """Intervals of a channel that are left out of the scores, of all trials."""
    return result.marked[result.marked["channel"] == channel]


def lift_text(lifts: pd.DataFrame) -> str:
    """Sentence on the number and total length of the intervals left out of the scores (rows with ``trial``,
    ``start_s``, ``end_s``), for readers who cannot see the shading; empty without any."""
    if not len(lifts):
        return ""
    trials = ", ".join(str(t) for t in sorted(set(lifts["trial"])))
    count = "1 interval" if len(lifts) == 1 else f"{len(lifts)} intervals"
    share = float((lifts["end_s"] - lifts["start_s"]).sum())
    return (
        f" Hatched and left out of the scores: {count}, {1e3 * share:.1f} ms in all, in which the key "
        f"may lift off its rail (trial {trials})."
    )


def make_figure(view: SessionView, chart: Chart, key: str, caption: str, description: str) -> ReportFigure:
    """The chart as a `ReportFigure`; all panels over time show the evaluation window."""
    name, whole = f"{view.prefix}{key}", (view.first.window.start_s, view.first.window.end_s)
    return ReportFigure(name, caption, chart.svg(name, caption, description, whole))
