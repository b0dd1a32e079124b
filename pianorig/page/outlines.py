"""Outlines on a film as the page edits them; single frames tracked again."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import vision
from pianorig.console.column_file import read_table
from pianorig.errors import CommandInputError
from pianorig.page.catalogue import Catalogue, UnknownName, open_session, readable_trial
from pianorig.page.review import outlined_film
from pianorig.workflows.session_film import BODIES_NAME, STEP, SessionFilm
from pianorig.workflows.track import retrack
from rig.session import Session, Trial
from vision.output.contact_sheet import describe_problems, select_worst_rows
from vision.results.flags import FAILURE

Found = tuple[pd.DataFrame, dict[str, Any]]


@dataclass(frozen=True)
class FilmSubject:
    """A film; ``owner`` is its session and trial, None for a film on its own."""

    path: Path
    bodies: Path
    owner: tuple[Session, Trial] | None

    @property
    def table(self) -> Path:
        """Where ``pianorig track`` writes the angles."""
        return self.path.with_suffix(".angles.csv")

    def film(self, frame_rate_hz: float | None = None) -> SessionFilm:
        """The film as tracking takes it."""
        return SessionFilm(self.path, self.bodies, frame_rate_hz, allow_truncated=True)

    def angles(self) -> Found | None:
        """Table of tracked angles and its attributes (none for a film without a session); None before tracking."""
        if self.owner is not None:
            session, trial = self.owner
            return session.read_derived(STEP, trial.number)
        if not self.table.is_file():
            return None
        return read_table(self.table, "track the film again"), {}

    def view(self) -> dict[str, Any]:
        """The film for the page (`pianorig.page.review`)."""
        return outlined_film(self.film(), self.angles())


def subject_of(catalogue: Catalogue, owner: str, number: int) -> FilmSubject:
    """The film of trial ``number`` of the session ``owner``, or, for number 0, the film named ``owner``, which has no
    session; UnknownName where there is none."""
    if number == 0:
        path = catalogue.film(owner)
        return FilmSubject(path, path.with_suffix(".bodies.toml"), None)
    session = open_session(catalogue.folder(owner))
    trial = readable_trial(session, number)
    if trial.film is None:
        raise UnknownName(f"{owner}: trial {number} has no film")
    return FilmSubject(trial.film, session.path / BODIES_NAME, (session, trial))


def _is_number(x: Any) -> bool:
    return type(x) in (int, float) and math.isfinite(x)


MOST_BODIES, MOST_POINTS, LONGEST_NAME = 32, 500, 60  # of a drawing by hand
WORST = 12  # frames that are offered to look at: one screen


def outlines_of(subject: FilmSubject) -> dict[str, Any]:
    """Film, saved outlines, worst tracked frames, and doubt about the film's times, as plain data for the page; no
    outlines before any were saved."""
    bodies = vision.load_bodies(subject.bodies) if subject.bodies.is_file() else []
    return {
        "film": subject.view(),
        "file": subject.bodies.name,
        "table": subject.table.name if subject.table.is_file() else "",
        "outlines": [_plain_body(body) for body in bodies],
        "worst": worst_frames(subject),
        "doubt": subject.film().doubt_about_times or "",
    }


def _plain_body(body: vision.Body) -> dict[str, Any]:
    points = body.polygon_px.tolist()
    return {"name": body.name, "parent": body.parent or "", "layer": body.layer, "points": points}


def save_outlines(subject: FilmSubject, rows: Any) -> dict[str, Any]:
    """Check outlines (rows of name, parent, layer, points in px) against the film, and write them; a file that was
    there is kept as ``….previous.toml``. Return the names of file and bodies."""
    if not isinstance(rows, list) or not 1 <= len(rows) <= MOST_BODIES:
        raise CommandInputError(f"outlines: allowed a list of 1 to {MOST_BODIES}")
    bodies = [_parse_body(row) for row in rows]
    with vision.open_film(subject.path, allow_truncated=True) as film:
        vision.build_masks(bodies, film.height, film.width)  # raises where too few pixels are left to fit
    if subject.bodies.is_file():
        shutil.copyfile(subject.bodies, subject.bodies.with_suffix(".previous.toml"))
    vision.save_bodies(subject.bodies, bodies)
    return {"file": subject.bodies.name, "bodies": [body.name for body in bodies]}


def _parse_body(row: Any) -> vision.Body:
    """Make a body of the outline that the page sent, a dict of name, parent (empty for none), layer (whole number),
    points (pairs x, y, px); CommandInputError for anything else."""
    if not isinstance(row, dict):
        raise CommandInputError(f"outline {str(row)[:60]!r}: allowed a table of name, parent, layer, points")
    name, parent, layer, points = (row.get(key) for key in ("name", "parent", "layer", "points"))
    for label, text in (("name", name), ("parent", parent)):
        if not isinstance(text, str) or len(text) > LONGEST_NAME:
            raise CommandInputError(
                f"outline: {label} {str(text)[:60]!r}: allowed text up to {LONGEST_NAME} characters"
            )
    if type(layer) is not int or abs(layer) > 1000:
        raise CommandInputError(f"outline {name}: layer {str(layer)[:60]!r}: allowed a whole number up to 1000")
    if not isinstance(points, list) or len(points) > MOST_POINTS:
        raise CommandInputError(f"outline {name}: points: allowed a list of up to {MOST_POINTS} pairs")
    return vision.Body(str(name), points, str(parent) or None, layer)  # type: ignore[arg-type]  # checked there


def worst_frames(subject: FilmSubject) -> list[dict[str, Any]]:
    """Tracked frames to look at first, a dict each of its number and what is wrong in words: most bodies lost, then
    lowest correlation; empty before tracking."""
    found = subject.angles()
    if found is None:
        return []
    table = found[0]
    if "frame" in table:
        table = table[table["frame"] >= 0]  # others are missing in the film
    names = [column.removesuffix("_flag") for column in table.columns if column.endswith("_flag")]
    names = [name for name in names if f"{name}_quality" in table]
    if not names or "frame" not in table or not len(table):
        return []
    flags = np.stack([table[f"{name}_flag"].to_numpy(dtype=int) for name in names], axis=1)
    quality = np.stack([table[f"{name}_quality"].to_numpy(dtype=float) for name in names], axis=1)
    rows = []
    for row in select_worst_rows((flags & int(FAILURE)) != 0, quality, WORST):
        words = describe_problems(names, flags[row], quality[row])
        rows.append({"frame": int(table["frame"].iloc[row]), "words": words})
    return rows


def track_again(subject: FilmSubject, frame: Any, places: Any) -> dict[str, Any]:
    """Fit one frame again, each body from its place in ``places`` (angle rad, x px, y px) where given, and write it
    into table and session; return its number and the bodies lost in it."""
    if type(frame) is not int or not isinstance(places, dict):
        raise CommandInputError("allowed a frame number, and the places of bodies")
    read = {}
    for name, place in places.items():
        if not (isinstance(place, list) and len(place) == 3 and all(map(_is_number, place))):
            raise CommandInputError(f"place of {str(name)[:60]}: allowed angle (rad), x and y (px)")
        read[str(name)] = (float(place[0]), float(place[1]), float(place[2]))
    rows = retrack(subject.film(), subject.table, [frame], read)
    flags = {name.removesuffix("_flag"): int(rows[name].iloc[0]) for name in rows if name.endswith("_flag")}
    return {"frame": frame, "lost": [name for name, flag in flags.items() if flag & int(FAILURE)]}
