"""A camera file from a film of a calibration target."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import vision
from pianorig.errors import CommandInputError
from vision.camera.calibrate import Target, calibrate
from vision.camera.file import save_calibration
from vision.camera.model import CalibratedCamera


def calibrate_camera(
    film: Path, out: Path, *, grid: str, pitch_mm: float, target: str = "checkerboard", every: int = 1
) -> tuple[CalibratedCamera, dict[str, Any]]:
    """Find the camera's model, write it to ``out``; return it and what it rests on.

    Parameters
    ----------
    grid : COLUMNSxROWS, the target's points; ``pitch_mm`` apart
    target : checkerboard or dots
    every : use every N-th frame
    """
    columns, cross, rows = grid.lower().partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise CommandInputError(f"--grid {grid}: allowed COLUMNSxROWS, for example 9x6")
    if every < 1:
        raise CommandInputError(f"--every {every}: allowed 1 or more")
    chosen = Target(target, int(columns), int(rows), pitch_mm * 1e-3)
    with vision.open_film(film) as source:
        found = calibrate(source, chosen, every)
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
    save_calibration(out, found.camera, facts)
    return found.camera, facts
