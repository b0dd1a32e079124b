"""One channel of one trial with its prediction, as a figure for a notebook or a file.

Conventions: degrees with the thesis's signs; above: trial, model and its band of difference; below: model − trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from model.inside.labels import BODY_COLORS
from validation.conventions import Array
from validation.curves.display_signs import SIGN, TITLE, degrees, rotation_label
from validation.curves.marks import Mark
from validation.curves.style import BAND_COLUMNS, BLACK, GREY, MODEL_DASHES, decimate
from validation.curves.table import force_on_base, trial_curves

SIZE_IN = (8.0, 4.6)
MODEL: dict[str, Any] = {"color": BLACK, "linewidth": 1.1, "dashes": MODEL_DASHES[0]}


def new_panels(has_difference: bool) -> tuple[Axes, Axes | None]:
    """Axes of a new matplotlib figure for the curves, and below them axes for their difference, with the same time
    axis, where ``has_difference``; else None."""
    import matplotlib.pyplot as plt  # start-up: 0.1 s beyond the rest of matplotlib

    rows = 2 if has_difference else 1
    figure, panels = plt.subplots(
        rows, 1, sharex=True, figsize=SIZE_IN, layout="constrained", squeeze=False, height_ratios=(2.2, 1)[:rows]
    )
    return panels[0, 0], panels[1, 0] if has_difference else None


def _draw_marks(axes: Axes, marks: Sequence[Mark], *, labels: bool = True) -> None:
    """Draw a vertical line at every mark into ``axes``: dotted for events, solid for positions of the thesis, whose
    letters stand above unless ``labels`` is False."""
    for mark in marks:
        style = {"color": BLACK, "linewidth": 0.8} if mark.position else {"color": "#777777", "linewidth": 0.6}
        axes.axvline(mark.time_s, linestyle="-" if mark.position else ":", **style)  # type: ignore[arg-type]
        if labels and mark.position:
            axes.annotate(
                mark.label, (mark.time_s, 1), xycoords=("data", "axes fraction"), xytext=(0, 2),
                textcoords="offset points", ha="center", va="bottom", fontsize=9, fontweight="bold",
            )  # fmt: skip


def _draw(axes: Axes, time: Array, values: Array, label: str | None = None, **style: object) -> None:
    """Draw a thinned curve."""
    t, v = decimate(time, values)
    axes.plot(t, v, label=label, **style)  # type: ignore[arg-type]


def _finish_axes(axes: Axes, ylabel: str, *, bottom: bool = True) -> None:
    """Set the vertical label ``ylabel``, grid and margins of ``axes``, and the label of the time axis where ``bottom``,
    else hide its numbers."""
    axes.set_ylabel(ylabel)
    axes.grid(True, color="#DDDDDD", linewidth=0.6)
    axes.margins(x=0)
    if bottom:
        axes.set_xlabel("time (s)")
    else:
        axes.tick_params(labelbottom=False)


def plot_rotation(
    panels: tuple[Axes, Axes | None],
    base_s: Array,
    channel: str,
    encoder: pd.DataFrame,
    film: pd.DataFrame | None,
    *,
    band_rad: Array | None,
    marks: Sequence[Mark],
    title: str,
) -> None:
    """Draw into ``panels`` (upper, and lower or None) the rotation of the body ``channel`` in one trial, measured and
    predicted, and model − trial, in degrees; for ``force`` the force alone. ``encoder``, ``film``: its traces.

    Parameters
    ----------
    panels : axes for the curves, and for the difference or None
    base_s : (n,) s
    channel : body, or ``force``
    encoder, film : traces of the trial
    band_rad : (n,) half width of the simultaneous 95 % band of the mean difference, or None
    """
    top, low = panels
    _draw_marks(top, marks)
    if channel == "force":
        _draw(top, base_s, force_on_base(base_s, encoder), "trial", color=BLACK, linewidth=1.2)
        _finish_axes(top, "force (N)")
        top.set_title(title, fontsize=9, loc="left", pad=14)
        return
    curves = trial_curves(base_s, encoder, film)[channel]
    measured, predicted = (degrees(channel, curves[f"{kind}_rad"]) for kind in ("measured", "predicted"))
    _draw(top, base_s, measured, "trial", color=BODY_COLORS[channel], linewidth=1.2)
    _draw(top, base_s, predicted, "model", **MODEL)
    _finish_axes(top, rotation_label(channel), bottom=low is None)
    top.legend(fontsize=8, framealpha=0.9)
    top.set_title(f"{TITLE[channel]}, {title}", fontsize=9, loc="left", pad=14)
    if low is None:
        return
    if band_rad is not None:
        at, reach = decimate(base_s, np.degrees(band_rad), columns=BAND_COLUMNS, keep="max")
        low.fill_between(
            at, -reach, reach, color=GREY, alpha=0.35, linewidth=0, label="95 % interval without an error of the model"
        )
    _draw(low, base_s, SIGN[channel] * np.degrees(curves["predicted_rad"] - curves["measured_rad"]), **MODEL)
    low.axhline(0.0, color="#777777", linewidth=0.7)
    _finish_axes(low, "model − trial (°)")
    _draw_marks(low, marks, labels=False)
