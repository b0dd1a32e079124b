"""Plots of a tracked film: angles with their uncertainty, residual noise, share of agreeing pixels."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vision.errors import FilmError
from vision.files import whole_file
from vision.output.colours import body_colour
from vision.results.track_result import TrackResult


def write_plot(path: str | os.PathLike[str], result: TrackResult) -> None:
    """Write a figure (``.png``, ``.svg`` or ``.pdf``) over time of every body's angle, from its parent's if it has one,
    its standard uncertainties, residual noise and share of inliers; a file that is there is replaced.

    Parameters
    ----------
    path : path
        Ends in ``.png``, ``.svg`` or ``.pdf``.
    result : TrackResult

    Raises
    ------
    FilmError
        Another ending.

    Examples
    --------
    >>> import vision
    >>> result = vision.track("film.mraw", vision.load_bodies("bodies.toml"), every=10)
    >>> vision.write_plot("angles.png", result)
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise FilmError(f"{path}: a plot must end in .png, .svg or .pdf")
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    angle_axes, u_axes, noise_axes, share_axes = figure.subplots(4, 1, sharex=True, height_ratios=[3, 1.3, 1, 1])
    relative_total = result.budget.total(relative=True, without=("synchronisation",))
    gaps = [row + 1 for row in result.info.get("missing_after", {})]
    time_s = np.insert(result.time_s, gaps, np.nan)
    for i, body in enumerate(result.bodies):
        colour = body_colour(body, i)
        if result.parents[i] is None:
            name, angle = body, result.angle_rad[:, i]
            u, total = result.u_angle_rad[:, i], result.u_total_rad[:, i]
        else:
            name = f"{body} from {result.parents[i]}"
            angle, u, _ = result.relative(body)
            total = relative_total[:, i]
        # lines break where frames are missing
        series = (angle, u, total, result.noise_grey[:, i], result.inlier[:, i])
        angle, u, total, noise, share = (np.insert(values, gaps, np.nan) for values in series)
        angle_axes.plot(time_s, np.degrees(angle), colour, label=name, linewidth=1.2)
        u_axes.plot(time_s, np.degrees(u) * 1e3, colour, linewidth=1.0)
        u_axes.plot(time_s, np.degrees(total) * 1e3, colour, linewidth=0.8, linestyle=":")
        noise_axes.plot(time_s, noise, colour, linewidth=0.8)
        share_axes.plot(time_s, share, colour, linewidth=0.8)
        lost = result.time_s[result.is_lost[:, i]]
        angle_axes.plot(
            lost, np.full(lost.size, 0.02 + 0.02 * i), colour, transform=angle_axes.get_xaxis_transform(),
            marker="|", linestyle="none",
        )  # fmt: skip
    angle_axes.set_ylabel("angle, deg")
    angle_axes.legend(loc="best", fontsize="small")
    u_axes.set_ylabel("u, mdeg")
    u_axes.set_ylim(bottom=0.0)
    u_axes.set_title("solid: noise and zero; dotted: with camera, shutter, codec", fontsize="small", loc="left")
    noise_axes.set_ylabel("residual, grey")
    share_axes.set_ylabel("agreeing")
    share_axes.set_ylim(0.0, 1.05)
    share_axes.set_xlabel("time, s")
    angle_axes.set_title(f"{Path(result.film).name}   (ticks: lost frames)", fontsize="medium", loc="left")
    for axes in (angle_axes, u_axes, noise_axes, share_axes):
        axes.grid(alpha=0.3)
    with whole_file(path, FilmError, "check the folder") as temporary:
        figure.savefig(temporary, format=path.suffix[1:].lower(), dpi=120)
