"""Outlines as the page edits them: read, proposed, checked and saved; the frames that tracking fits worst."""

from __future__ import annotations

import math
import shutil
from typing import Any

import numpy as np

import vision
from pianorig.errors import CommandInputError
from pianorig.page.outlines.film_subject import FilmSubject
from pianorig.page.outlines.marks import marks_of
from pianorig.workflows.film.retrack import retrack
from vision.output.overlay import reasons, worst_of
from vision.results.flags import FAILURE

MOST_BODIES, MOST_POINTS, LONGEST_NAME = 32, 500, 60
WORST = 12


def outlines_of(subject: FilmSubject) -> dict[str, Any]:
    """The film, its saved outlines, and the worst of the tracked frames.

    Raises
    ------
    vision.VisionError : film or outlines cannot be read
    """
    bodies = vision.load_bodies(subject.bodies) if subject.bodies.is_file() else []
    return {
        "film": subject.view(),
        "file": subject.bodies.name,
        "table": subject.table.name if subject.table.is_file() else "",
        "outlines": [_plain(body) for body in bodies],
        "worst": worst_frames(subject),
        "marks": marks_of(subject),
        "doubt": subject.film().doubt_about_times or "",
    }


def propose(subject: FilmSubject) -> list[dict[str, Any]]:
    """Outlines proposed from the film, to be corrected and named.

    Raises
    ------
    vision.VisionError : nothing in the film moves as a rigid textured body
    """
    with vision.open_film(subject.path, allow_truncated=True) as film:
        return [_plain(body) for body in vision.propose_bodies(film)]


def _plain(body: vision.Body) -> dict[str, Any]:
    points = body.polygon_px.tolist()
    return {"name": body.name, "parent": body.parent or "", "layer": body.layer, "points": points}


def save(subject: FilmSubject, rows: Any) -> dict[str, Any]:
    """Check outlines against the film and write them; a file that was there is kept as ``….previous.toml``.

    Parameters
    ----------
    rows : list of name, parent (empty for none), layer, points [[x, y], …] in film pixels

    Raises
    ------
    CommandInputError : what was sent are no outlines
    vision.BodyError : an outline cannot be used, with its name and the reason
    """
    if not isinstance(rows, list) or not 1 <= len(rows) <= MOST_BODIES:
        raise CommandInputError(f"outlines: allowed a list of 1 to {MOST_BODIES}")
    bodies = [_body(row) for row in rows]
    with vision.open_film(subject.path, allow_truncated=True) as film:
        vision.build_masks(bodies, film.height, film.width)  # raises where too few pixels are left to fit
    if subject.bodies.is_file():
        shutil.copyfile(subject.bodies, subject.bodies.with_suffix(".previous.toml"))
    vision.save_bodies(subject.bodies, bodies)
    return {"file": subject.bodies.name, "bodies": [body.name for body in bodies]}


def _body(row: Any) -> vision.Body:
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
    """Frames to look at first, with what is wrong: most bodies lost, then lowest correlation."""
    found = subject.angles()
    if found is None:
        return []
    table = found[0]
    names = [column.removesuffix("_flag") for column in table.columns if column.endswith("_flag")]
    names = [name for name in names if f"{name}_quality" in table]
    if not names or "frame" not in table or not len(table):
        return []
    flags = np.stack([table[f"{name}_flag"].to_numpy(dtype=int) for name in names], axis=1)
    quality = np.stack([table[f"{name}_quality"].to_numpy(dtype=float) for name in names], axis=1)
    lost = (flags & int(FAILURE)) != 0
    rows = []
    for row in worst_of(lost, quality, WORST):
        words = [f"{name} lost: {reasons(int(flags[row, i]))}" for i, name in enumerate(names) if lost[row, i]]
        if not words:
            least = int(np.nanargmin(quality[row]))
            remarks = reasons(int(flags[row, least]))
            words = [f"{names[least]} correlates {quality[row, least]:.3f}{', ' if remarks else ''}{remarks}"]
        rows.append({"frame": int(table["frame"].iloc[row]), "words": "; ".join(words)})
    return rows


def track_again(subject: FilmSubject, frame: Any, places: Any) -> dict[str, Any]:
    """Fit one frame again, the named bodies from where they were placed, and put it into the table and session.

    Parameters
    ----------
    frame : number in the film
    places : body → [angle rad counter-clockwise, x px, y px]

    Raises
    ------
    CommandInputError : no such frame or body, or the film was not tracked
    """
    if type(frame) is not int or not isinstance(places, dict):
        raise CommandInputError("allowed a frame number, and the places of bodies")
    read = {}
    for name, place in places.items():
        numbers = place if isinstance(place, list) else []
        good = len(numbers) == 3 and all(type(x) in (int, float) and math.isfinite(x) for x in numbers)
        if not good:
            raise CommandInputError(f"place of {str(name)[:60]}: allowed angle (rad), x and y (px)")
        read[str(name)] = (float(numbers[0]), float(numbers[1]), float(numbers[2]))
    rows = retrack(subject.film(), subject.table, [frame], read)
    flags = {name.removesuffix("_flag"): int(rows[name].iloc[0]) for name in rows if name.endswith("_flag")}
    return {"frame": frame, "lost": [name for name, flag in flags.items() if flag & int(FAILURE)]}
