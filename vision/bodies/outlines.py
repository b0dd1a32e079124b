"""Outlines of the bodies on the reference, as polygons, and their file.

Conventions: polygon points are picture coordinates (x right, y down, pixel centres at whole numbers) on the
still frames. ``parent`` names the body relative to which the angle is wanted and through whose motion the
body is predicted. ``layer`` says what is in front: a body covers those with a smaller layer; bodies of one
layer cover each other, which is the safe assumption when nothing is known. Bad files and outlines raise
`BodyError`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.arrays import as_numbers
from vision.errors import BodyError, VisionInputError
from vision.files import read_toml, toml_text, whole_file


@dataclass(frozen=True)
class Body:
    """One rigid body on the film.

    Parameters
    ----------
    name : str
        Unique, non-empty.
    polygon_px : array_like, shape (m, 2)
        Outline (x, y) on the still frames, pixels, y down, at least three points.
    parent : str or None
        Name of the body it turns on.
    layer : int
        What is in front has the larger number.

    Raises
    ------
    BodyError
        For an outline that encloses nothing, or with NaN.
    """

    name: str
    polygon_px: NDArray[np.float64]
    parent: str | None = None
    layer: int = 0

    def __post_init__(self) -> None:
        if not self.name or not isinstance(self.name, str):
            raise BodyError(f"body name {self.name!r}: give a non-empty text")
        try:
            points = as_numbers(self.polygon_px, "polygon_px").copy()
        except VisionInputError:
            raise BodyError(f"body {self.name}: polygon_px must be a list of [x, y] pairs of numbers") from None
        if points.ndim != 2 or points.shape[1] != 2 or points.shape[0] < 3:
            raise BodyError(
                f"body {self.name}: polygon_px has shape {points.shape}, needs (m, 2) with m >= 3 points [x, y]"
            )
        if not np.all(np.isfinite(points)):
            raise BodyError(f"body {self.name}: polygon_px contains NaN or infinity; give finite pixel coordinates")
        if np.abs(points).max() > 1e6:
            raise BodyError(f"body {self.name}: polygon_px reaches {np.abs(points).max():g} px, allowed up to 1e6")
        if abs(polygon_area(points)) < 1.0:
            raise BodyError(f"body {self.name}: polygon_px encloses less than one pixel; draw an outline")
        points.setflags(write=False)
        object.__setattr__(self, "polygon_px", points)


def polygon_area(points: NDArray[np.float64]) -> float:
    """Signed area of a polygon, shape (m, 2), in square units of the points (shoelace formula)."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def check_bodies(bodies: Sequence[Body]) -> None:
    """Refuse an empty list, repeated names, unknown parents and circles of parents (`BodyError`)."""
    names = [body.name for body in bodies]
    if not names:
        raise BodyError("no bodies given; name at least one with its outline polygon")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise BodyError(f"body name {repeated[0]!r} is used {names.count(repeated[0])} times; names must be unique")
    parents = {body.name: body.parent for body in bodies}
    for name in names:
        seen = [name]
        while (parent := parents[seen[-1]]) is not None:
            if parent not in parents:
                raise BodyError(f"body {seen[-1]}: parent {parent!r} is not among {', '.join(names)}")
            if parent in seen:
                raise BodyError(f"body {name}: its parents form a circle ({' -> '.join([*seen, parent])})")
            seen.append(parent)


def sort_parents_first(bodies: Sequence[Body]) -> list[int]:
    """Indices of the bodies in an order in which parents come before their children; `BodyError` for bodies that do not
    fit together."""
    check_bodies(bodies)
    parents = {body.name: body.parent for body in bodies}

    def depth(name: str) -> int:
        parent = parents[name]
        return 0 if parent is None else 1 + depth(parent)

    return sorted(range(len(bodies)), key=lambda i: depth(bodies[i].name))


def load_bodies(toml_path: str | os.PathLike[str]) -> list[Body]:
    """Bodies, in the file's order, of a TOML file with a ``[[body]]`` table each: ``name``, ``polygon_px = [[x, y],
    ...]`` (y down), optionally ``parent`` (a name) and ``layer`` (a whole number, larger in front); `BodyError` for all
    else.

    Parameters
    ----------
    toml_path : path

    Returns
    -------
    list of Body
        In the order of the file.

    Raises
    ------
    BodyError
        With file, body, value found and value allowed.

    Examples
    --------
    >>> import vision
    >>> [body.name for body in vision.load_bodies("bodies.toml")]
    ['whippen', 'jack', 'repetition']
    """
    path = Path(toml_path)
    tables = read_toml(path, BodyError, "give a TOML file of bodies").get("body")
    if not isinstance(tables, list) or not tables:
        raise BodyError(f"{path}: holds no [[body]] table; give one per body with name and polygon_px")
    try:
        bodies = [_body_from_table(table) for table in tables]
        check_bodies(bodies)
    except BodyError as error:
        raise BodyError(f"{path}: {error}") from None
    return bodies


BodiesLike = Sequence[Body] | str | os.PathLike[str]
"""Outlines, or the file that holds them."""


def as_bodies(bodies: BodiesLike) -> list[Body]:
    if isinstance(bodies, str | os.PathLike):
        return load_bodies(bodies)
    return list(bodies)


def _body_from_table(table: Any) -> Body:
    """Body of one [[body]] table of a TOML file; `BodyError` for unknown keys and values that are not allowed."""
    if not isinstance(table, dict):
        raise BodyError("[[body]] must be a table with name and polygon_px")
    name = table.get("name", "")
    unknown = sorted(set(table) - {"name", "polygon_px", "parent", "layer"})
    if unknown:
        raise BodyError(f"body {name}: unknown key {unknown[0]!r}; allowed: name, polygon_px, parent, layer")
    parent, layer = table.get("parent"), table.get("layer", 0)
    if parent is not None and not isinstance(parent, str):
        raise BodyError(f"body {name}: parent {parent!r} must be the name of a body")
    if isinstance(layer, bool) or not isinstance(layer, int):
        raise BodyError(f"body {name}: layer {layer!r} must be a whole number")
    return Body(name, table.get("polygon_px", []), parent, layer)


def save_bodies(toml_path: str | os.PathLike[str], bodies: Sequence[Body]) -> None:
    """Write outlines to a TOML file, in place of one that is there, so that `load_bodies` returns the same bodies; the
    file appears whole or not at all. `BodyError` for bodies that do not fit together.

    Parameters
    ----------
    toml_path : path
    bodies : sequence of Body

    Examples
    --------
    >>> import vision
    >>> vision.save_bodies("plate.toml", [vision.Body("plate", [[10, 10], [90, 10], [90, 60], [10, 60]])])
    >>> vision.load_bodies("plate.toml")[0].polygon_px.shape
    (4, 2)
    """
    check_bodies(bodies)
    path = Path(toml_path)
    lines = ["# Outlines on the still frames: picture coordinates (x right, y down), pixels."]
    for body in bodies:
        points = ", ".join(f"[{float(x)!r}, {float(y)!r}]" for x, y in body.polygon_px)
        lines += ["", "[[body]]", f"name = {toml_text(body.name)}"]
        if body.parent is not None:
            lines.append(f"parent = {toml_text(body.parent)}")
        lines += [f"layer = {body.layer}", f"polygon_px = [{points}]"]
    with whole_file(path, BodyError, "choose a writable folder") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def signed_distance(polygon_px: NDArray[np.float64], height: int, width: int) -> NDArray[np.float32]:
    """Distance of every pixel centre from a polygon's outline, px, positive inside, shape (height, width)."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    inside = np.zeros((height, width), dtype=bool)
    nearest = np.full((height, width), np.inf, dtype=np.float32)
    for (x0, y0), (x1, y1) in zip(polygon_px, np.roll(polygon_px, -1, axis=0), strict=True):
        ex, ey = np.float32(x1 - x0), np.float32(y1 - y0)
        length2 = float(ex * ex + ey * ey)
        if length2 == 0.0:
            continue
        px, py = x - np.float32(x0), y - np.float32(y0)
        along = np.clip((px * ex + py * ey) / np.float32(length2), 0.0, 1.0)
        np.minimum(nearest, (px - along * ex) ** 2 + (py - along * ey) ** 2, out=nearest)
        if y0 != y1:
            # even-odd rule: count the edges crossed by the ray to the right of the pixel
            crosses = ((y0 > y) != (y1 > y)) & (px < ex * (y - np.float32(y0)) / ey)
            inside ^= crosses
    distance = np.sqrt(nearest)
    return np.where(inside, distance, -distance)
