"""An animation as one HTML file: the page's own player with its data and scripts in it; needs no other file.

It starts where the motion does, shows the force at every contact on one scale, and the measured action where there is
one. ``#t=0.112`` in the address stops it at that time.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.files.atomic_write import whole_file
from model.inside.seen_motion import SeenMotion

WEB = Path(__file__).parent / "web"
SCRIPTS = ("elements", "numbers", "player", "forces", "drawing", "strip", "animation")
"""In the order in which each uses those before it."""
IMPORT = re.compile(r'^import \{(.*)\} from "\./(\w+)\.js";$', flags=re.MULTILINE)
VISIBLE_RAD = 2e-4
BEFORE_S = 5e-3


@dataclass(frozen=True)
class Animation:
    """What an exported animation shows.

    Attributes
    ----------
    title : of the file
    drawings : title and `moving_action` data of each drawing
    curves : title, unit, color, time_s and value (packed) of each curve below
    events : time_s, title, source, meaning
    span_s : first and last time
    start_s : where it starts
    """

    title: str
    drawings: Sequence[tuple[str, dict[str, Any]]]
    curves: Sequence[dict[str, Any]]
    events: Sequence[dict[str, Any]]
    span_s: tuple[float, float]
    start_s: float


def animation_html(animation: Animation) -> str:
    """The file's text."""
    data = {
        "drawings": [{"title": title, "drawing": drawing} for title, drawing in animation.drawings],
        "curves": list(animation.curves),
        "events": list(animation.events),
        "span_s": list(animation.span_s),
        "start_s": animation.start_s,
    }
    text = json.dumps(data, default=float).replace("<", "\\u003c")  # nothing in it can end the element
    title = html.escape(animation.title)
    styles = "".join((WEB / f"{name}.css").read_text(encoding="utf-8") for name in ("animation", "player"))
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{styles}</style></head>\n'
        f'<body><h1>{title}</h1><main></main>\n<script type="application/json" id="data">{text}</script>\n'
        f'<script type="module">\n{player_script()}</script></body></html>\n'
    )


def player_script() -> str:
    """The player's modules as one script; each keeps its own names, and takes from the others what it imports."""
    parts = ["const modules = {};"]
    for name in SCRIPTS:
        text = (WEB / f"{name}.js").read_text(encoding="utf-8")
        given = re.findall(r"^export (?:function|class|const) (\w+)", text, flags=re.MULTILINE)
        text = IMPORT.sub(r"const {\1} = modules.\2;", text)
        text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
        parts.append(f"modules.{name} = (() => {{\n{text}return {{ {', '.join(given)} }};\n}})();")
    return "\n".join(parts) + "\n"


def write_animation_page(animation: Animation, path: Path) -> None:
    """Write the file, whole or not at all."""
    with whole_file(path) as part:
        part.write_text(animation_html(animation), encoding="utf-8")


def motion_start_s(seen: SeenMotion) -> float:
    """A moment before a body first turns visibly; the first time where none does."""
    away = np.abs(seen.pose[:, :, 2] - seen.pose[0, :, 2]).max(axis=1) > VISIBLE_RAD
    first = float(seen.time_s[int(np.argmax(away))]) if away.any() else float(seen.time_s[0])
    return max(first - BEFORE_S, float(seen.time_s[0]))


def thinned(seen: SeenMotion, rows: NDArray[np.int64]) -> SeenMotion:
    """Some rows of a motion; each shows the largest force since the row before, so that no short peak is lost."""
    starts = np.concatenate([[rows[0]], rows[:-1] + 1])
    peak = np.maximum.reduceat(seen.normal_n, np.minimum(starts, len(seen.normal_n) - 1), axis=0)
    return replace(
        seen,
        time_s=seen.time_s[rows],
        pose=seen.pose[rows],
        point_m=seen.point_m[rows],
        penetration_m=seen.penetration_m[rows],
        normal_n=peak,
    )
