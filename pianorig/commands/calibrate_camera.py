"""``pianorig calibrate camera``: how the camera sees the plane of motion, from a film of a target."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

import vision
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import AsJson, Figure
from pianorig.console.output import file_lines, tell
from pianorig.errors import CommandInputError

LEAST_COVERAGE = 0.3  # of the picture, that the target should cover: choice; distortion grows towards the corners


def command(
    film: Annotated[Path, typer.Argument(help="Film, picture or folder of pictures of the target in the plane.")],
    out: Annotated[Path, typer.Option("--out", help="Camera file to write (.toml), for track --calibration.")],
    grid: Annotated[str, typer.Option("--grid", help="Points of the target, COLUMNSxROWS: inner corners, or dots.")],
    pitch_mm: Annotated[float, typer.Option("--pitch-mm", help="Distance of neighbouring points, mm.")],
    target: Annotated[str, typer.Option("--target", help="checkerboard or dots.")] = "checkerboard",
    every: Annotated[int, typer.Option("--every", help="Use every N-th frame.")] = 1,
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Measure the camera's tilt, distortion and scale.
    They are written to the camera file --out, in place of one that is there. Hold the target flat in the plane in which
    the bodies move, fill the picture, and move it within that plane.

    Example:  pianorig calibrate camera target.mraw --target checkerboard --grid 9x6 --pitch-mm 5 --out camera.toml
    """
    check_writable(out, ".toml")
    check_writable(figure, *FIGURE_ENDINGS)
    columns, cross, rows = grid.lower().partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise CommandInputError(f"--grid {grid}: allowed COLUMNSxROWS, for example 9x6")
    if every < 1:
        raise CommandInputError(f"--every {every}: allowed 1 or more")
    chosen = vision.Target(target, int(columns), int(rows), pitch_mm * 1e-3)
    with vision.open_film(film) as source:
        found = vision.calibrate(source, chosen, every)
    camera = found.camera
    facts = {
        "film": film.name,
        "target": f"{target} {columns}x{rows}, pitch {pitch_mm:g} mm",
        "frames": found.n_frames,
        "views": found.n_views,
        "points": found.n_points,
        "residual_px": found.residual_px,
        "picture_covered": found.coverage,
        "effect_on_angles_rad": found.effect_rad,
        "u_after_correction_rad": found.u_effect_rad,
    }
    vision.save_calibration(out, camera, facts)
    a, b, p, q, k = (float(v) for v in camera.parameters)
    mdeg = 1e3 * math.degrees(1.0)
    lines = [
        f"{out}: {found.n_points} points in {found.n_views} views, residual {found.residual_px:.3f} px",
        f"  scale        {camera.scale_px_per_m / 1e3:.4f} px/mm "
        f"(standard uncertainty {camera.u_scale_px_per_m / 1e3:.4f} px/mm)",
        f"  stretch      {100 * math.hypot(a, b):.3f} %, perspective {100 * math.hypot(p, q):.3f} % at the corner",
        f"  distortion   {100 * k:.3f} % at the corner "
        f"(standard uncertainty {100 * math.sqrt(camera.covariance[4, 4]):.3f} %)",
        f"  angles       off by up to {found.effect_rad * mdeg:.1f} mdeg without correction (block of",
        f"               120 x 40 px turning by 15 deg), "
        f"with it standard uncertainty {found.u_effect_rad * mdeg:.1f} mdeg",
    ]
    if found.coverage < LEAST_COVERAGE:
        covered = f"{100 * found.coverage:.0f} %"
        lines.append(f"  only {covered} of the picture was covered; use a larger target, or move it about")
    parameters = {"scale_px_per_m": camera.scale_px_per_m, "parameters": [a, b, p, q, k]}
    projection = camera.nominal(camera.width, camera.height)
    if figure is not None and projection is not None:
        workflows.draw_distortion(projection.to_picture, (camera.width, camera.height), figure)
    tell(as_json, {"out": out, "figure": figure, **parameters, **facts}, (*lines, *file_lines([figure])))
