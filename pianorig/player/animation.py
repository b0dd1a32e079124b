"""An animation as one HTML file: the page's own player with its data and scripts in it; needs no other file.

``#t=0.112`` in the address stops it at that time.
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

import model
from model.inside.body_poses import SeenMotion
from model.inside.labels import contact_label, input_label
from pianorig.player.moving_action import moving_action, pack, unpack
from rig.atomic_write import replace_when_complete
from validation.curves.display_signs import TITLE, degrees
from vision.output.colours import body_colour

WEB = Path(__file__).parent / "web"
IMPORT = re.compile(r'^import \{(.*)\} from "\./(\w+)\.js";$', flags=re.MULTILINE)
VISIBLE_RAD = 2e-4  # turn of a body that is seen: 0.02 mm at 0.1 m
BEFORE_S = 5e-3  # of rest before the first motion


@dataclass(frozen=True)
class Animation:
    """What an exported animation shows."""

    title: str  # of the file
    drawings: Sequence[tuple[str, dict[str, Any]]]  # title and `moving_action` data of each drawing
    curves: Sequence[dict[str, Any]]  # title, unit, color, time_s and value (packed) of each curve below
    events: Sequence[dict[str, Any]]  # time_s, title, source, meaning


def animation_html(animation: Animation) -> str:
    """Text of an HTML file that plays the animation without a network: drawings, curves, events; it spans the times of
    the first drawing."""
    first = animation.drawings[0][1]
    times, pose = unpack(first["time_s"]), unpack(first["pose"])
    data = {
        "drawings": [{"title": title, "drawing": drawing} for title, drawing in animation.drawings],
        "curves": list(animation.curves),
        "events": list(animation.events),
        "span_s": [float(times[0]), float(times[-1])],
        "start_s": motion_start_s(times, pose),
    }
    text = json.dumps(data, default=float).replace("<", "\\u003c")  # nothing in it can end the element
    title = html.escape(animation.title)
    styles = "".join((WEB / f"{name}.css").read_text(encoding="utf-8") for name in ("animation", "player"))
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{styles}</style></head>\n'
        f'<body><main><h1>{title}</h1></main>\n<script type="application/json" id="data">{text}</script>\n'
        f'<script type="module">\n{player_script()}</script></body></html>\n'
    )


def scripts(name: str = "animation") -> dict[str, str]:
    """Texts of a module and of all that it imports, by name, in the order in which each uses those before it."""
    text = (WEB / f"{name}.js").read_text(encoding="utf-8")
    found: dict[str, str] = {}
    for _, other in IMPORT.findall(text):
        found = scripts(other) | found
    return found | {name: text}


def player_script() -> str:
    """The player's JavaScript modules joined to one script, in which each keeps its own names and takes from the others
    what it imports."""
    parts = ["const modules = {};"]
    for name, text in scripts().items():
        given = re.findall(r"^export (?:function|class|const) (\w+)", text, flags=re.MULTILINE)
        text = IMPORT.sub(r"const {\1} = modules.\2;", text)
        text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
        parts.append(f"modules.{name} = (() => {{\n{text}return {{ {', '.join(given)} }};\n}})();")
    return "\n".join(parts) + "\n"


def motion_start_s(time_s: NDArray[Any], pose: NDArray[Any]) -> float:
    """A moment before a body of ``pose`` (m, n, 3) first turns visibly, s; the first time where none does."""
    away = np.abs(pose[:, :, 2] - pose[0, :, 2]).max(axis=1) > VISIBLE_RAD
    return max(float(time_s[int(np.argmax(away))]) - BEFORE_S, float(time_s[0]))


def thin_motion(motion: SeenMotion, row_indices: NDArray[np.int64]) -> SeenMotion:
    """The motion at the rising ``row_indices`` alone; the contact forces of each row are the largest since the row
    before it, so that no short peak is lost."""
    starts = np.concatenate([[row_indices[0]], row_indices[:-1] + 1])
    peak = np.maximum.reduceat(motion.normal_n, np.minimum(starts, len(motion.normal_n) - 1), axis=0)
    return replace(
        motion,
        time_s=motion.time_s[row_indices],
        pose=motion.pose[row_indices],
        point_m=motion.point_m[row_indices],
        penetration_m=motion.penetration_m[row_indices],
        normal_n=peak,
    )


View = dict[str, Any]


def trial_animation(view: View) -> Animation | None:
    """Animation of a trial, measured beside model, from the dict that `pianorig.page.review.trial_view` gives; None
    where that has no drawings."""
    if not view["drawings"]:
        return None
    curves = [{"title": "Force on the key", "color": "", **view["force"]}]
    for channel in view["channels"].values():
        lines = [*([channel["measured"]] if channel["measured"] else []), *channel["models"][:1]]
        if lines:
            beside = lines[1] if len(lines) > 1 else None
            title = f"{channel['title']}{': measured, dashed model' if beside else ''}"
            curves.append({"title": title, "unit": "°", "color": channel["color"], **lines[0], "beside": beside})
    drawings = [
        (f"{'Measured and ' if drawing['measured'] else ''}{name}", drawing)
        for name, drawing in zip(view["models"], view["drawings"], strict=True)
    ]
    return Animation(f"{view['session']}, trial {view['trial']}", drawings, curves, view["events"])


def blow_animation(name: str, changes: list[str], view: View) -> Animation:
    """Animation of a simulated blow on a changed action, from the dict that `pianorig.page.action.live_blow` gives;
    ``name`` and ``changes`` (path=value) make its title."""
    times = view["time_s"]
    curves = [{"title": "Force on the key", "unit": "N", "color": "", "time_s": times, "value": view["force_n"]}]
    for channel in view["channels"].values():
        curves.append({"title": channel["title"], "unit": "°", "color": channel["color"], "time_s": times})
        curves[-1]["value"] = channel["value"]
    events = [{**event, "source": "model"} for event in view["events"] if event["time_s"] is not None]
    title = f"{name}{', ' if changes else ''}{', '.join(changes)}"
    return Animation(title, [("Model", view["drawing"])], curves, events)


BLOW_RATE_HZ = 2_000.0  # poses a second: choice; a blow of half a second has a thousand


def write_blow_animation(
    action: model.Action, solution: model.Solution, force_n: NDArray[np.float64], path: Path
) -> None:
    """Write a simulated blow as an HTML file that plays it; the solution needs an inside view (``inside=True``, else
    InputError); ``force_n`` (m,): the scene's input at the solution's times."""
    inside = solution.inside
    if inside is None:
        raise model.InputError("animation: the solution has no inside view; simulate with inside=True")
    seen = SeenMotion(inside.scene, inside.time_s, inside.pose, inside.point_m, inside.penetration_m, inside.normal_n)
    rate_hz = (len(seen.time_s) - 1) / float(seen.time_s[-1] - seen.time_s[0])
    rows = np.arange(0, len(seen.time_s), max(1, round(rate_hz / BLOW_RATE_HZ)))
    drawing = moving_action(thin_motion(seen, rows), labels=[contact_label(action, name) for name in seen.contacts])
    quantity, unit = input_label(inside.scene)
    curves = [{"title": quantity.capitalize(), "unit": unit, "color": "", "value": pack(force_n[rows])}]
    for i, body in enumerate(solution.bodies):
        if body in TITLE:
            change = degrees(body, solution.angle_rad[rows, i] - solution.angle_rad[0, i])
            curves.append({"title": TITLE[body], "unit": "°", "color": body_colour(body, i), "value": pack(change)})
    times = pack(seen.time_s[rows])
    curves = [{**curve, "time_s": times} for curve in curves]
    text = animation_html(Animation(f"{action.name}: a blow", [("Model", drawing)], curves, []))
    with replace_when_complete(path) as part:
        part.write_text(text, encoding="utf-8")
