"""Frames of a tracked film fitted again, each alone, from corrected places; the table is rewritten with them.

A place is read from the table's own columns (angle, x, y), so a neighbour's row shows how to write one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pianorig.errors import InputError
from pianorig.workflows.film.track import STEP, frame_times_of, outlines_of, session_trial_of, store_angles

if TYPE_CHECKING:
    import pandas as pd

    from vision.bodies.outlines import Body
    from vision.camera.model import CameraModel


def read_places(texts: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """``body=angle_deg,x_px,y_px`` texts as body: (angle rad, x px, y px)."""
    places = {}
    for text in texts:
        name, _, values = text.partition("=")
        try:
            angle, x, y = (float(value) for value in values.split(","))
        except ValueError:
            raise InputError(
                f"--place {text}: allowed body=ANGLE_DEG,X_PX,Y_PX, for example jack=-12.5,213,88"
            ) from None
        places[name.strip()] = (float(np.radians(angle)), x, y)
    return places


def retrack(
    film: Path,
    bodies_file: Path | None,
    table_file: Path,
    frames: Sequence[int],
    places: dict[str, tuple[float, float, float]],
    *,
    method: str = "icgn",
    camera: CameraModel | None = None,
    frame_rate_hz: float | None = None,
    allow_truncated: bool = False,
) -> pd.DataFrame:
    """Fit single frames again and put them into the film's table, and into its session.

    Parameters
    ----------
    film, bodies_file, method, camera, frame_rate_hz, allow_truncated : as for `tracking.track_film_file`
    table_file : CSV that tracking wrote; rewritten whole
    frames : frame numbers that stand in the table
    places : body to (angle rad, x px, y px); bodies not named start between their good neighbours

    Returns
    -------
    pandas.DataFrame : the new rows
    """
    import pandas as pd

    import vision
    from pianorig.console.output import write_table

    bodies_path = outlines_of(film, bodies_file)
    bodies = vision.load_bodies(bodies_path)
    table = _read_table(table_file, bodies)
    unknown = sorted(set(places) - {body.name for body in bodies})
    if unknown:
        raise InputError(f"--place {unknown[0]}: is not a body of {bodies_path}")
    rows = []
    for frame in frames:
        found = np.flatnonzero(table["frame"].to_numpy() == frame)
        if found.size != 1:
            raise InputError(f"--retrack {frame}: no such frame in {table_file}")
        rows.append(int(found[0]))
    owner = session_trial_of(film)
    with vision.open_film(film, allow_truncated=allow_truncated) as source:
        times, u_time = frame_times_of(source, owner, frame_rate_hz)
        result = vision.retrack_frames(
            source,
            bodies,
            frames,
            [{**_between_neighbours(table, row, bodies), **places} for row in rows],
            times,
            method=method,
            camera=camera,
            u_time_s=u_time,
        )
    new = result.to_table()
    for number, row in enumerate(rows):
        for name in table.columns:
            table.loc[row, name] = new.loc[number, name]
    write_table(table_file, table)
    if owner is not None:
        stored = owner[0].read_derived(STEP, owner[1].number)
        attributes = {} if stored is None else {k: v for k, v in stored[1].items() if k != "parents_sha256"}
        again = ", ".join(map(str, frames))
        store_angles(owner, film, bodies_path, table, {**attributes, "retracked_frames": again})
    return pd.DataFrame(new)


def _read_table(path: Path, bodies: Sequence[Body]) -> pd.DataFrame:
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as problem:
        raise InputError(f"{path}: cannot be read ({problem}); track the film first") from None
    needed = ["time_s", "frame", *(f"{b.name}{tail}" for b in bodies for tail in ("_rad", "_x_px", "_y_px", "_flag"))]
    missing = [name for name in needed if name not in table]
    if missing:
        raise InputError(f"{path}: column {missing[0]!r} is missing; track the film first")
    return table


def _between_neighbours(table: pd.DataFrame, row: int, bodies: Sequence[Body]) -> dict[str, tuple[float, float, float]]:
    """Places between the nearest rows before and after in which the bodies are known."""
    places = {}
    frame = table["frame"].to_numpy(dtype=float)
    for body in bodies:
        values = table[[f"{body.name}_rad", f"{body.name}_x_px", f"{body.name}_y_px"]].to_numpy(dtype=float)
        known = np.isfinite(values).all(axis=1)
        known[row] = False
        if not known.any():
            raise InputError(f"body {body.name} is lost in every other frame; name its place with --place")
        angle, x, y = (float(np.interp(frame[row], frame[known], values[known, k])) for k in range(3))
        places[body.name] = (angle, x, y)
    return places
