"""Marks: points and straight lines of the picture to follow, and their file.

Conventions: picture coordinates on the still frames (x right, y down, pixel centres at whole numbers), px. A line is
followed across itself only; seen from its first point towards its second, positive is to the left.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import BodyError
from vision.files import read_toml

LEAST_PX = 3.0


@dataclass(frozen=True)
class PointMark:
    """A spot with contrast in all directions: a painted dot, a screw's head, a piece of texture.

    Parameters
    ----------
    name : str
    at_px : (float, float)
        Its middle.
    radius_px : float
        Of the disc that is followed; it should hold the spot's whole edge.

    Raises
    ------
    BodyError
        For numbers that describe no disc.
    """

    name: str
    at_px: tuple[float, float]
    radius_px: float = 10.0

    def __post_init__(self) -> None:
        _check(self.name, self.at_px, self.radius_px)

    def mask(self, height: int, width: int) -> NDArray[np.bool_]:
        """Pixels that are followed, shape (height, width)."""
        y, x = np.mgrid[0:height, 0:width]
        return np.asarray(np.hypot(x - self.at_px[0], y - self.at_px[1]) <= self.radius_px)


@dataclass(frozen=True)
class LineMark:
    """A straight edge or line: the string, the rim of a felt, a rail.

    Parameters
    ----------
    name : str
    from_px, to_px : (float, float)
        Two points on it.
    width_px : float
        Of the band around it that is followed; it should hold the whole edge and nothing else that moves.

    Raises
    ------
    BodyError
        For numbers that describe no band.
    """

    name: str
    from_px: tuple[float, float]
    to_px: tuple[float, float]
    width_px: float = 16.0

    def __post_init__(self) -> None:
        _check(self.name, (*self.from_px, *self.to_px), self.width_px)
        if self.length_px < 2.0 * LEAST_PX:
            raise BodyError(f"mark {self.name}: its two points are {self.length_px:g} px apart; draw a longer line")

    @property
    def length_px(self) -> float:
        """Distance of its points."""
        return float(np.hypot(self.to_px[0] - self.from_px[0], self.to_px[1] - self.from_px[1]))

    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit vector (x, y) to the left of the line."""
        along = np.subtract(self.to_px, self.from_px) / self.length_px
        return np.array([along[1], -along[0]])

    def mask(self, height: int, width: int) -> NDArray[np.bool_]:
        """Pixels that are followed, shape (height, width)."""
        y, x = np.mgrid[0:height, 0:width]
        dx, dy = x - self.from_px[0], y - self.from_px[1]
        across, left = dx * self.normal[0] + dy * self.normal[1], self.normal
        along = -dx * left[1] + dy * left[0]
        return np.asarray((abs(across) <= 0.5 * self.width_px) & (along >= 0.0) & (along <= self.length_px))


Mark = PointMark | LineMark


def load_marks(toml_path: str | os.PathLike[str]) -> list[Mark]:
    """Read marks from a TOML file with one ``[[point]]`` or ``[[line]]`` table per mark.

    A point has ``name``, ``at_px = [x, y]`` and optionally ``radius_px``; a line ``name``, ``from_px``, ``to_px`` and
    optionally ``width_px``.

    Parameters
    ----------
    toml_path : path

    Returns
    -------
    list of PointMark or LineMark

    Raises
    ------
    BodyError
        The file is missing or describes no mark; says what is allowed.

    Examples
    --------
    >>> from pathlib import Path
    >>> import vision
    >>> _ = Path("marks.toml").write_text('[[point]]\\nname = "dot"\\nat_px = [40, 30]\\nradius_px = 9\\n')
    >>> vision.load_marks("marks.toml")
    [PointMark(name='dot', at_px=(40.0, 30.0), radius_px=9.0)]
    """
    path = Path(toml_path)
    tables = read_toml(path, BodyError, "give a TOML file of marks")
    unknown = sorted(set(tables) - {"point", "line"})
    if unknown or not tables:
        found = f"table {unknown[0]!r}" if unknown else "nothing"
        raise BodyError(f"{path}: holds {found}; allowed are [[point]] and [[line]]")
    marks: list[Mark] = [_mark(path, kind, table) for kind in ("point", "line") for table in tables.get(kind, [])]
    names = [mark.name for mark in marks]
    for name in names:
        if names.count(name) > 1:
            raise BodyError(f"{path}: mark {name!r} is named {names.count(name)} times; names must be unique")
    return marks


def _mark(path: Path, kind: str, table: Any) -> Mark:
    needed = {"point": ("name", "at_px"), "line": ("name", "from_px", "to_px")}[kind]
    size = {"point": "radius_px", "line": "width_px"}[kind]
    if not isinstance(table, dict):
        raise BodyError(f"{path}: [[{kind}]] must be a table")
    wrong = [key for key in needed if key not in table] or sorted(set(table) - {*needed, size})
    if wrong:
        raise BodyError(f"{path}: [[{kind}]] lacks or does not know {wrong[0]!r}; it has {', '.join((*needed, size))}")
    values: dict[str, Any] = {"name": table["name"]}
    try:
        for key in needed[1:]:
            x, y = table[key]
            values[key] = (float(x), float(y))
        if size in table:
            values[size] = float(table[size])
    except (TypeError, ValueError):
        raise BodyError(f"{path}: [[{kind}]] {table['name']}: places are [x, y], sizes a number, px") from None
    return PointMark(**values) if kind == "point" else LineMark(**values)


def _check(name: str, places: tuple[float, ...], size: float) -> None:
    if not name or not isinstance(name, str):
        raise BodyError(f"mark name {name!r}: give a non-empty text")
    if not (np.all(np.isfinite(places)) and LEAST_PX <= size <= 1e5):
        raise BodyError(
            f"mark {name}: places {places} and size {size:g} px; needs finite numbers, {LEAST_PX:g} px at least"
        )
