"""A session seen while it is recorded, as a picture that is refreshed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pianorig.workflows.bench.figure_file import new_figure, save_png
from rig.session.journal.live_reader import LiveView
from rig.session.trial_data import absent_bodies


def draw_view(path: Path, view: LiveView) -> None:
    """Force and angles over time as a PNG, whole or not at all."""
    figure = new_figure(8.0, 5.0)
    top, bottom = figure.subplots(2, 1, sharex=True)
    top.plot(view.time_s, view.force_n, lw=0.8, color="C3")
    top.set(ylabel="Force (N)", title=f"trial {view.trial} of {view.trials}: {view.state} {view.condition}".strip())
    for k, name in enumerate(view.names):
        bottom.plot(view.time_s, np.degrees(view.angle_rad[:, k]), lw=0.9, label=name)
    absent = absent_bodies(view.names)
    bottom.set(xlabel="Time (s)", ylabel="Angle from rest (deg)")
    bottom.set_title(f"not recorded: {', '.join(absent)}" if absent else "", fontsize=9)
    if view.names:
        bottom.legend(fontsize=8)
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    save_png(figure, path, 100)
