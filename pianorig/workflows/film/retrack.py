"""Frames of a tracked film fitted again, each alone, from corrected places; the table is rewritten with them.

A place is given in the table's own columns (angle, x, y), so that a neighbour's row shows how to write one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

import vision
from pianorig.console.column_file import write_table
from pianorig.errors import CommandInputError
from pianorig.workflows.film.session_film import STEP, SessionFilm

Place = tuple[float, float, float]  # angle rad, x px, y px


def read_places(texts: Sequence[str]) -> dict[str, Place]:
    """``body=angle_deg,x_px,y_px`` texts as body: (angle rad, x px, y px)."""
    places = {}
    for text in texts:
        name, _, values = text.partition("=")
        try:
            angle, x, y = (float(value) for value in values.split(","))
        except ValueError:
            raise CommandInputError(
                f"--place {text}: allowed body=ANGLE_DEG,X_PX,Y_PX, for example jack=-12.5,213,88"
            ) from None
        places[name.strip()] = (float(np.radians(angle)), x, y)
    return places


def retrack(
    film: SessionFilm,
    table_file: Path,
    frames: Sequence[int],
    places: dict[str, Place],
    *,
    method: str = "icgn",
    n_still: int | None = None,
    camera: vision.CameraModel | None = None,
) -> pd.DataFrame:
    """Fit single frames again and put them into the film's table, and into its session.

    Parameters
    ----------
    table_file : CSV that tracking wrote; rewritten whole
    frames : frame numbers that stand in the table
    places : body to (angle rad, x px, y px); bodies not named start between their good neighbours
    method, n_still, camera : as for `vision.track`

    Returns
    -------
    pandas.DataFrame : the new rows
    """
    bodies = vision.load_bodies(film.outlines)
    table = _read_table(table_file, bodies)
    unknown = sorted(set(places) - {body.name for body in bodies})
    if unknown:
        raise CommandInputError(f"--place {unknown[0]}: is not a body of {film.outlines}")
    rows = []
    for frame in frames:
        found = np.flatnonzero(table["frame"].to_numpy() == frame)
        if found.size != 1:
            raise CommandInputError(f"--retrack {frame}: no such frame in {table_file}")
        rows.append(int(found[0]))
    with film.open() as source:
        times, u_time = film.frame_times(source)
        result = vision.retrack_frames(
            source,
            bodies,
            frames,
            [{**_between_neighbours(table, row, bodies), **places} for row in rows],
            times,
            method=method,
            n_still=n_still,
            camera=camera,
            u_time_s=u_time,
        )
    new = pd.DataFrame(result.to_table())
    for number, row in enumerate(rows):
        for name in table.columns:
            table.loc[row, name] = new.loc[number, name]
    write_table(table_file, table)
    if film.owner is not None:
        session, trial = film.owner
        stored = session.read_derived(STEP, trial.number)
        attributes = {} if stored is None else {k: v for k, v in stored[1].items() if k != "parents_sha256"}
        film.store_angles(table, {**attributes, "retracked_frames": ", ".join(map(str, frames))})
    return new


def _read_table(path: Path, bodies: Sequence[vision.Body]) -> pd.DataFrame:
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as problem:
        raise CommandInputError(f"{path}: cannot be read ({problem}); track the film first") from None
    needed = ["time_s", "frame", *(f"{b.name}{tail}" for b in bodies for tail in ("_rad", "_x_px", "_y_px", "_flag"))]
    missing = [name for name in needed if name not in table]
    if missing:
        raise CommandInputError(f"{path}: column {missing[0]!r} is missing; track the film first")
    return table


def _between_neighbours(table: pd.DataFrame, row: int, bodies: Sequence[vision.Body]) -> dict[str, Place]:
    """Places between the nearest rows before and after in which the bodies are known."""
    places = {}
    frame = table["frame"].to_numpy(dtype=float)
    for body in bodies:
        values = table[[f"{body.name}_rad", f"{body.name}_x_px", f"{body.name}_y_px"]].to_numpy(dtype=float)
        known = np.isfinite(values).all(axis=1)
        known[row] = False
        if not known.any():
            raise CommandInputError(f"body {body.name} is lost in every other frame; name its place with --place")
        angle, x, y = (float(np.interp(frame[row], frame[known], values[known, k])) for k in range(3))
        places[body.name] = (angle, x, y)
    return places
