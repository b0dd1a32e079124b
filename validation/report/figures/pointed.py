"""Values under the pointer in figures whose curves are not among the page's: film, force from motion, control charts.

Conventions: as shown, in degrees, newtons and the units of the charts; at most `MOST_SAMPLES` places along a curve;
null where there is no value. The page's script ``pointed.js`` shows the nearest place.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.conventions import Array

MOST_SAMPLES = 300


@dataclass(frozen=True)
class Pointed:
    """What is said of a place in some panels.

    Attributes
    ----------
    panels : Axes that share the values
    along : (n,) places along the horizontal axis
    head : what leads the first line, with ``{}`` for the place, and its digits
    lines : name, unit, digits and (n,) values of each further line
    """

    panels: tuple[Axes, ...]
    along: Array
    head: tuple[str, int]
    lines: tuple[tuple[str, str, int, Array], ...]


def pointed_json(figure: Figure, key: str, pointed: Sequence[Pointed]) -> str:
    """Values and places of the panels, in the units of the SVG; known once the figure has been drawn."""
    width, height = (72 * float(v) for v in figure.get_size_inches())
    out: list[dict[str, Any]] = []
    for one in pointed:
        some = slice(None, None, -(-one.along.size // MOST_SAMPLES) if one.along.size else 1)
        boxes = []
        for axes in one.panels:
            box = axes.get_position()
            boxes.append(
                {
                    "id": f"{key}-axes_{figure.axes.index(axes) + 1}",
                    "left": round(width * box.x0, 3),
                    "right": round(width * box.x1, 3),
                    "top": round(height * (1 - box.y1), 3),
                    "bottom": round(height * (1 - box.y0), 3),
                    "x": [round(float(v), 6) for v in axes.get_xlim()],
                }
            )
        lines: list[dict[str, Any]] = [
            {"name": name, "unit": unit, "digits": digits, "y": _plain(values[some], digits)}
            for name, unit, digits, values in one.lines
        ]
        head, digits = one.head
        out.append(
            {
                "panels": boxes,
                "head": head,
                "digits": digits,
                "x": _plain(one.along[some], digits + 1),
                "lines": [line for line in lines if any(y is not None for y in line["y"])],
            }
        )
    return json.dumps(out, separators=(",", ":"), ensure_ascii=False)


def _plain(values: Array, digits: int) -> list[float | None]:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]
