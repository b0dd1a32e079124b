"""Figures of learned profiles after thesis Figs 3.6 (recorded forces) and 3.7, 3.8 (pianist and motor)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianorig.workflows.bench.figure_file import new_figure, save_png
from rig import Learned, TargetForce

DPI = 120


def draw_recorded(path: Path, targets: Sequence[TargetForce]) -> None:
    """Draw the recorded forces over time, one line each, key bottoms marked (after Fig. 3.6)."""
    figure = new_figure(7.5, 3.6)
    axes = figure.subplots()
    for target in targets:
        (line,) = axes.plot(target.time_s, target.force_n, lw=1.0, label=target.name)
        at = float(np.interp(target.bottom_s, target.time_s, target.force_n))
        axes.plot(target.bottom_s, at, "o", ms=4, color=line.get_color())
    axes.set(xlabel="Time (s)", ylabel="Force at the key front (N)", title="Recorded force (dot: key bottom)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    save_png(figure, path, DPI)


def draw_learned(folder: Path, learned: Learned) -> None:
    """Draw pianist and motor (after Figs 3.7, 3.8) and the error of each blow into ``folder``."""
    target, best = learned.target, learned.best
    figure = new_figure(7.5, 6.6)
    top, zoom, steps = figure.subplots(3, 1, height_ratios=(3, 3, 2))
    command = best.profile.force_at(target.time_s)
    for axes in (top, zoom):
        axes.plot(target.time_s, target.force_n, color="0.25", lw=1.6, label="pianist")
        axes.plot(target.time_s, best.measured.force_n, color="C3", lw=1.0, label="motor, measured")
        axes.plot(target.time_s, command, color="C0", lw=0.9, ls="--", label="motor command")
        axes.axvline(target.bottom_s, color="0.6", lw=0.8, ls=":")
        axes.set(xlabel="Time (s)", ylabel="Force (N)")
        axes.grid(alpha=0.3)
    top.legend(fontsize=8)
    top.set_title(f"{target.name}: pianist and motor (blow {best.number}, {100 * best.error:.1f} % of the peak)")
    zoom.set_xlim(target.onset_s - 0.01, target.bottom_s + 0.01)
    high = 1.15 * target.peak_n
    zoom.set_ylim(-0.1 * high, high)
    zoom.set_title("before key bottom (dotted), where it is learned", fontsize=9)
    _draw_errors(steps, learned)
    save_png(figure, folder / "pianist_and_motor.png", DPI)


def _draw_errors(axes: Any, learned: Learned) -> None:
    numbers = [blow.number for blow in learned.blows]
    axes.plot(numbers, [100 * blow.error for blow in learned.blows], "o-", ms=4)
    axes.axhline(100 * learned.goal, color="C2", lw=1.0, label=f"goal, {100 * learned.goal:g} %")
    axes.set(xlabel="Blow", ylabel="RMS error (% of peak)", xticks=numbers)
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
