"""A few frames fitted before the whole film, to see whether film and outlines suit each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Unpack

import numpy as np

import vision
from pianorig.workflows.film.session_film import SessionFilm
from vision.output.overlay import words_of
from vision.tracking.options import FitOptions

COLUMNS = 3


def preview_track(film: SessionFilm, picture: Path, count: int, **options: Unpack[FitOptions]) -> dict[str, Any]:
    """Fit ``count`` frames of a film and draw them.

    Parameters
    ----------
    picture : where the frames are drawn (.png)
    options : method, n_still, camera, see `vision.preview`

    Returns
    -------
    dict : ``picture``, ``frames``, ``lost`` (per body) and ``lines`` to print, one per frame

    Raises
    ------
    CommandInputError : as for tracking
    """
    bodies = vision.load_bodies(film.outlines)
    with film.open() as source:
        times, options["u_time_s"] = film.frame_times(source)
        result = vision.preview(source, bodies, count, times, **options)
        vision.write_contact_sheet(picture, source, bodies, result, count=count, columns=min(count, COLUMNS))
    lines = []
    for row in range(len(result.frame)):
        where, remark = words_of(result, row)
        angles = ", ".join(
            f"{body} {np.degrees(angle):+.3f} deg (u {1e3 * np.degrees(u):.1f} mdeg)"
            for body, angle, u in zip(result.bodies, result.angle_rad[row], result.u_angle_rad[row], strict=True)
            if np.isfinite(angle)
        )
        lines.append(f"{where}: {'; '.join(part for part in (angles, remark) if part)}")
    lost = {body: int(n) for body, n in zip(result.bodies, result.failed.sum(axis=0), strict=True)}
    return {"picture": picture, "frames": result.frame.tolist(), "lost": lost, "lines": lines}
