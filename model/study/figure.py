"""Sheets of studies: the turns of key, whippen and hammer under one blow, all variants in each panel."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from model.files.figure_sheet import new_sheet
from model.parameters.action import BODIES
from model.study.variants import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIGN = {"key": -1.0, "whippen": 1.0, "jack": -1.0, "repetition": -1.0, "hammer": -1.0}
COLORS = ("#000000", "#C04A00", "#0072B2", "#00785A", "#A8528A", "#B37400", "#2A8FC4")
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (8, 2)))
BODIES_DRAWN = ("key", "whippen", "hammer")


def _draw_turn(axes: Axes, study: Study, body: str) -> None:
    """Draw the turn of a body from its first angle, degrees, positive as it moves in a blow, one curve per variant."""
    i = BODIES.index(body)
    for k, name in enumerate(v.name for v in study.variants):
        angle = study[name][0].angle_rad[:, i]
        turned = SIGN[body] * np.degrees(angle - angle[0])
        color, dash = COLORS[k % len(COLORS)], DASHES[k % len(DASHES)]
        axes.plot(study.time_s, turned, label=name, linewidth=1.2, color=color, linestyle=dash)
    axes.set_ylabel(f"{body} turned, °")
    axes.grid(alpha=0.3)
    axes.margins(x=0)


def draw_study(study: Study, path: str | Path) -> None:
    """Write force, key, whippen and hammer of one blow on all variants to ``path`` (.svg, .pdf or .png), in place of a
    file that is there.

    Parameters
    ----------
    study : the simulated variants
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> dry = model.study.Variant("dry", factors={"damping": 0.1})
    >>> study = model.study.compare(model.load_action(), *model.force_table("forte"), [dry])
    >>> model.study.draw_study(study, "study.svg")
    """
    with new_sheet(path, 9.0, 9.5) as figure:
        panels = figure.subplots(4, 1, sharex=True, height_ratios=[1, 2, 2, 3])
        panels[0].plot(study.time_s, study.force_n, color="black", linewidth=1.0)
        panels[0].set(ylabel="force, N", title=study.action)
        panels[0].grid(alpha=0.3)
        for axes, body in zip(panels[1:], BODIES_DRAWN, strict=True):
            _draw_turn(axes, study, body)
        panels[-1].set_xlabel("time, s")
        panels[-1].legend(fontsize="small")
