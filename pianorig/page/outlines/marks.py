"""Points and lines to follow on a film, as the page edits them: read, checked, saved, and where they were found."""

from __future__ import annotations

import math
import shutil
from typing import Any

import pandas as pd

import vision
from pianorig.errors import CommandInputError
from pianorig.page.outlines.film_subject import FilmSubject
from pianorig.player.packing import pack
from rig.configuration.toml_file import dump_toml
from rig.storage.atomic_write import write_text
from vision.results.flags import FAILURE

MOST_MARKS, LONGEST_NAME = 32, 60
Row = dict[str, Any]


def marks_of(subject: FilmSubject) -> dict[str, Any]:
    """The saved marks, and where following found them; files that cannot be read are a ``problem``."""
    view: Row = {"file": subject.marks.name, "marks": [], "found": {}, "problem": ""}
    try:
        marks = vision.load_marks(subject.marks) if subject.marks.is_file() else []
        view["marks"] = [_plain(mark) for mark in marks]
        view["found"] = _found(subject)
    except (vision.BodyError, CommandInputError) as error:
        view["problem"] = str(error)
    return view


def _plain(mark: vision.PointMark | vision.LineMark) -> Row:
    if isinstance(mark, vision.PointMark):
        return {"kind": "point", "name": mark.name, "points": [list(mark.at_px)], "size": mark.radius_px}
    points = [list(mark.from_px), list(mark.to_px)]
    return {"kind": "line", "name": mark.name, "points": points, "size": mark.width_px}


def _found(subject: FilmSubject) -> dict[str, Any]:
    """Of each followed mark: frames, values and uncertainties (px), and where it was lost."""
    if not subject.marks_table.is_file():
        return {}
    try:
        table = pd.read_csv(subject.marks_table)
    except (OSError, ValueError) as error:
        raise CommandInputError(
            f"{subject.marks_table.name}: cannot be read ({error}); follow the marks again"
        ) from None
    found = {}
    for column in table.columns:
        name = column.removesuffix("_flag")
        kinds = ("offset_px",) if f"{name}_offset_px" in table else ("x_px", "y_px")
        if name == column or any(f"{name}_{kind}" not in table for kind in kinds) or "frame" not in table:
            continue
        found[name] = {
            "frame": table["frame"].to_numpy(dtype=int).tolist(),
            "lost": ((table[column].to_numpy(dtype=int) & int(FAILURE)) != 0).tolist(),
            **{kind: pack(table[f"{name}_{kind}"].to_numpy(dtype=float)) for kind in kinds},
            **{f"u_{kind}": pack(table[f"{name}_u_{kind}"].to_numpy(dtype=float)) for kind in kinds},
        }
    return found


def save_marks(subject: FilmSubject, rows: Any) -> dict[str, Any]:
    """Check marks against the film and write them; a file that was there is kept as ``….previous.toml``.

    Parameters
    ----------
    rows : list of kind (``point``, ``line``), name, points (one or two [x, y] in film pixels), size (px)

    Raises
    ------
    CommandInputError : what was sent are no marks
    vision.BodyError : a mark cannot be used, with its name and the reason
    """
    if not isinstance(rows, list) or not 1 <= len(rows) <= MOST_MARKS:
        raise CommandInputError(f"marks: allowed a list of 1 to {MOST_MARKS}")
    marks = [_mark(row) for row in rows]
    names = [mark.name for mark in marks]
    for name in names:
        if names.count(name) > 1:
            raise CommandInputError(f"mark {name}: named {names.count(name)} times; names must be unique")
    with vision.open_film(subject.path, allow_truncated=True) as film:
        for mark in marks:
            if not mark.mask(film.height, film.width).any():
                raise CommandInputError(
                    f"mark {mark.name}: lies outside the picture of {film.width} x {film.height} px"
                )
    if subject.marks.is_file():
        shutil.copyfile(subject.marks, subject.marks.with_suffix(".previous.toml"))
    write_text(subject.marks, _toml(marks))
    return {"file": subject.marks.name, "marks": names}


def _toml(marks: list[vision.PointMark | vision.LineMark]) -> str:
    tables: dict[str, list[Row]] = {"point": [], "line": []}
    for mark in marks:
        if isinstance(mark, vision.PointMark):
            tables["point"].append({"name": mark.name, "at_px": list(mark.at_px), "radius_px": mark.radius_px})
        else:
            line = {"from_px": list(mark.from_px), "to_px": list(mark.to_px), "width_px": mark.width_px}
            tables["line"].append({"name": mark.name, **line})
    return "\n".join(f"[[{kind}]]\n{dump_toml(row)}" for kind, found in tables.items() for row in found)


def _mark(row: Any) -> vision.PointMark | vision.LineMark:
    if not isinstance(row, dict) or row.get("kind") not in ("point", "line"):
        raise CommandInputError(f"mark {str(row)[:60]!r}: allowed a table with the kind point or line")
    name, points, size = row.get("name"), row.get("points"), row.get("size")
    if not isinstance(name, str) or not 1 <= len(name) <= LONGEST_NAME:
        raise CommandInputError(f"mark: name {str(name)[:60]!r}: allowed text of 1 to {LONGEST_NAME} characters")
    wanted = 1 if row["kind"] == "point" else 2
    if not isinstance(points, list) or len(points) != wanted or not all(_is_place(point) for point in points):
        raise CommandInputError(f"mark {name}: allowed {wanted} place{'s' if wanted > 1 else ''} [x, y]; click it")
    if not _is_number(size):
        raise CommandInputError(f"mark {name}: size {str(size)[:40]}: allowed a number of pixels")
    places = [(float(x), float(y)) for x, y in points]
    if row["kind"] == "point":
        return vision.PointMark(name, places[0], float(size))  # type: ignore[arg-type]  # checked
    return vision.LineMark(name, places[0], places[1], float(size))  # type: ignore[arg-type]  # checked


def _is_place(point: Any) -> bool:
    return isinstance(point, list) and len(point) == 2 and all(_is_number(x) for x in point)


def _is_number(x: Any) -> bool:
    return type(x) in (int, float) and math.isfinite(x)
