"""Figures of the page: residuals by phase before and after the fit, and profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from validation.conventions import Array
from validation.identification.fit import Fitted
from validation.identification.observations import CHANNEL_NAMES, ObservedTrial
from validation.identification.page.tables import residual_rms
from validation.identification.profiles import Profile
from validation.identification.scatter import factors
from validation.report.figures.svg import STYLE, figure_svg

BEFORE, AFTER = "#b35900", "#00508c"
WIDTH_IN, ROW_IN = 9.2, 2.1
ACROSS = 4


def residual_figure(trials: Sequence[ObservedTrial], before: Sequence[Array], after: Sequence[Array]) -> str:
    """SVG of the root mean square difference of each session and channel over the phases of the stroke."""
    one, two = residual_rms(trials, before), residual_rms(trials, after)
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, ROW_IN * len(one) + 0.5), layout="constrained")
        shown = sorted({c for t in trials for c in t.channels})
        grid = figure.subplots(len(one), len(shown), squeeze=False)
        for row, session in zip(grid, one, strict=True):
            first = next(t for t in trials if t.session == session)
            label = first.label.rpartition(", trial")[0]
            for axes, channel in zip(row, shown, strict=True):
                axes.set_title(f"{CHANNEL_NAMES[channel]}, {label}", fontsize=9)
                if channel not in first.channels:
                    axes.set_axis_off()
                    continue
                time, c = one[session][0], first.channels.index(channel)
                axes.plot(time, 1e3 * one[session][1][:, c], color=BEFORE, lw=1.1, ls="--", label="before")
                axes.plot(time, 1e3 * two[session][1][:, c], color=AFTER, lw=1.3, label="after the fit")
                axes.set_yscale("log")
                axes.grid(alpha=0.25)
                axes.set_xlabel("time, s")
            row[0].set_ylabel("RMS, mrad")
        next(axes for axes in grid[0] if axes.lines).legend(fontsize=8, frameon=False)
        return figure_svg(
            figure,
            "residuals",
            "Difference of model and trials by phase, before and after the fit",
            "Root mean square over the trials of each session, in milliradians, by channel; the table below says the "
            "same by phase.",
            (0.0, 0.0),
        )


def profile_figure(profiles: Sequence[Profile], fitted: Fitted, names: Sequence[str]) -> str:
    """SVG of the profiles: how the fit worsens when one parameter is held elsewhere; empty where none was made."""
    if not profiles:
        return ""
    level = dict(zip(names, factors(fitted) ** 2, strict=False))
    rows = math.ceil(len(profiles) / ACROSS)
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, ROW_IN * rows + 0.3), layout="constrained")
        grid = figure.subplots(rows, ACROSS, squeeze=False).ravel()
        for axes, p in zip(grid, profiles, strict=False):
            axes.plot(p.z, p.rise, color=AFTER, lw=1.2, marker="o", ms=3)
            axes.axhline(level[p.name], color=BEFORE, lw=0.9, ls="--")
            axes.axvspan(p.low, p.high, color=AFTER, alpha=0.12, lw=0)
            axes.set_ylim(min(0.0, float(np.min(p.rise))) - 0.5, 3.0 * level[p.name])
            axes.set_title(p.name.removesuffix(".A"), fontsize=8)
            axes.grid(alpha=0.25)
        for axes in grid[len(profiles) :]:
            axes.set_visible(False)
        for axes in grid[::ACROSS]:
            axes.set_ylabel("rise")
        figure.supxlabel("prior standard uncertainties from the prior's value", fontsize=9)
        return figure_svg(
            figure,
            "profiles",
            "Profile of each parameter",
            "Rise of twice the negative log posterior when one parameter is held at other values and all else is "
            "fitted again; dashed the level of the 95 % interval, shaded the interval.",
            (0.0, 0.0),
        )
