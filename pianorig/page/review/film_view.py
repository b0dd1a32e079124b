"""A trial's film for the page: when its frames were taken, and the outlines at the poses that tracking found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import vision
from pianorig.player.packing import pack
from pianorig.workflows.film.session_film import BODIES_NAME, STEP, SessionFilm
from rig.errors import RigError
from rig.session import Session, Trial
from rig.storage.atomic_write import sha256_of_file
from vision.output.colours import LOST, colour_of
from vision.results.flags import FAILURE


def film_view(session: Session, trial: Trial) -> dict[str, Any] | None:
    """Size, frame times and outlines of a trial's film; None where it has none.

    Times come from the trial's frame clock; a film that cannot be tied to it has a ``note`` and no times.

    Raises
    ------
    vision.VisionError : the film cannot be read
    """
    if trial.film is None:
        return None
    return outlined_film(SessionFilm(trial.film, session.path / BODIES_NAME), session.read_derived(STEP, trial.number))


def outlined_film(film: SessionFilm, found: tuple[pd.DataFrame, dict[str, Any]] | None) -> dict[str, Any]:
    """Size, frame times and tracked outlines of a film.

    Parameters
    ----------
    film : with the file of its outlines
    found : table of tracked angles and its attributes; None before tracking

    Raises
    ------
    vision.VisionError : the film cannot be read
    """
    with vision.open_film(film.path, allow_truncated=True) as source:
        note = ""
        try:
            times: Any = film.frame_times(source)[0]
        except (RigError, ValueError) as error:
            times, note = None, f"frames have no place on the time axis: {error}"
        else:
            times = source.frame_time_s if times is None else times
        view: dict[str, Any] = {
            "name": film.path.name,
            "n_frames": source.n_frames,
            "height": source.height,
            "width": source.width,
            "in_order": source.in_order,
            "time_s": None if times is None else times.tolist(),
            "note": note,
            "version": f"{film.path.stat().st_mtime_ns}",
            "lost_color": LOST,
            "bodies": [],
        }
        if found is not None:
            outlines, doubt = _outlines(film.outlines, source, *found)
            view["bodies"], view["note"] = outlines, "; ".join(filter(None, (note, doubt)))
    return view


def _outlines(
    file: Path, source: vision.Film, table: pd.DataFrame, attributes: dict[str, Any]
) -> tuple[list[dict[str, Any]], str]:
    """Outline of each tracked body about its centre, its pose in every tracked frame, and what to doubt."""
    if not file.is_file():
        return [], f"{file.name} is missing; the tracked outlines cannot be drawn"
    try:
        bodies = vision.load_bodies(file)
        masks = vision.build_masks(bodies, source.height, source.width)
    except vision.VisionError as error:
        return [], f"the tracked outlines cannot be drawn: {error}"
    seals = attributes.get("parents_sha256", {})  # a table on its own has none
    seal = seals.get(file.name)
    doubt = ""
    if seals and seal != sha256_of_file(file):
        doubt = f"{file.name} has changed since the film was tracked: track again"
    views = []
    for i, (body, mask) in enumerate(zip(bodies, masks, strict=True)):
        columns = [f"{body.name}_{name}" for name in ("rad", "x_px", "y_px", "flag")]
        if any(name not in table for name in (*columns, "frame")):
            doubt = doubt or f"{body.name} was not tracked; track the film again"
            continue
        rows, cols = np.nonzero(mask)  # the pose is that of the centre of the pixels that were fitted
        angle, x, y, flag = (table[name].to_numpy() for name in columns)
        views.append(
            {
                "name": body.name,
                "color": colour_of(body.name, i),
                "points": (body.polygon_px - (cols.mean(), rows.mean())).tolist(),
                "frame": table["frame"].to_numpy(dtype=int).tolist(),
                "turn": pack(vision.ccw_to_picture(angle)),
                "x": pack(x),
                "y": pack(y),
                "lost": ((flag.astype(int) & int(FAILURE)) != 0).tolist(),
            }
        )
    return views, doubt
