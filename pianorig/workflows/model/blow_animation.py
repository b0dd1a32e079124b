"""A computed blow as an HTML file that moves: the page's own player, complete in one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import model
from model.inside.labels import contact_label, input_label
from model.inside.seen_motion import SeenMotion
from pianorig.player.animation import Animation, motion_start_s, thinned, write_animation_page
from pianorig.player.moving_action import moving_action
from pianorig.player.packing import pack
from validation.curves.signs import TITLE, degrees
from vision.output.colours import colour_of

RATE_HZ = 2_000.0


def write_blow_animation(
    action: model.Action, solution: model.Solution, force_n: NDArray[np.float64], path: Path
) -> None:
    """Write a blow as an HTML file.

    Parameters
    ----------
    action, solution : the simulated action and its solution, with an inside view
    force_n : (m,) what drives it, at the solution's times
    path : file to write

    Raises
    ------
    model.InputError : the solution has no inside view
    """
    inside = solution.inside
    if inside is None:
        raise model.InputError("animation: the solution has no inside view; simulate with inside=True")
    seen = SeenMotion(inside.scene, inside.time_s, inside.pose, inside.point_m, inside.penetration_m, inside.normal_n)
    rate_hz = (len(seen.time_s) - 1) / float(seen.time_s[-1] - seen.time_s[0])
    rows = np.arange(0, len(seen.time_s), max(1, round(rate_hz / RATE_HZ)))
    drawing = moving_action(thinned(seen, rows), labels=[contact_label(action, name) for name in seen.contacts])
    quantity, unit = input_label(inside)
    curves = [{"title": quantity.capitalize(), "unit": unit, "color": "", "value": pack(force_n[rows])}]
    for i, body in enumerate(solution.bodies):
        if body in TITLE:
            change = degrees(body, solution.angle_rad[rows, i] - solution.angle_rad[0, i])
            curves.append({"title": TITLE[body], "unit": "°", "color": colour_of(body, i), "value": pack(change)})
    times = pack(seen.time_s[rows])
    animation = Animation(
        title=f"{action.name}: a blow",
        drawings=[("Model", drawing)],
        curves=[{**curve, "time_s": times} for curve in curves],
        events=[],
        span_s=(float(seen.time_s[0]), float(seen.time_s[rows[-1]])),
        start_s=motion_start_s(seen),
    )
    write_animation_page(animation, path)
