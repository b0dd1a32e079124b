"""What the page shows of a trial or of a blow, as an animation to keep: the same data, in one file."""

from __future__ import annotations

from typing import Any

import numpy as np

from pianorig.player.animation import BEFORE_S, VISIBLE_RAD, Animation
from pianorig.player.packing import unpack

View = dict[str, Any]


def trial_animation(view: View) -> Animation | None:
    """A trial as `pianorig.page.review.trial_view` gives it: measured beside model; None where nothing is drawn.

    Parameters
    ----------
    view : with ``session``, ``trial``, ``models``, ``drawings``, ``force``, ``channels``, ``events``
    """
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
    return _animation(f"{view['session']}, trial {view['trial']}", drawings, curves, view["events"])


def blow_animation(name: str, changes: list[str], view: View) -> Animation:
    """A blow on the action as it is set, as `pianorig.page.action.live_blow` gives it."""
    times = view["time_s"]
    curves = [{"title": "Force on the key", "unit": "N", "color": "", "time_s": times, "value": view["force_n"]}]
    for channel in view["channels"].values():
        curves.append({"title": channel["title"], "unit": "°", "color": channel["color"], "time_s": times})
        curves[-1]["value"] = channel["value"]
    events = [{**event, "source": "model"} for event in view["events"] if event["time_s"] is not None]
    title = f"{name}{', ' if changes else ''}{', '.join(changes)}"
    return _animation(title, [("Model", view["drawing"])], curves, events)


def _animation(title: str, drawings: list[tuple[str, View]], curves: list[View], events: list[View]) -> Animation:
    times, pose = unpack(drawings[0][1]["time_s"]), unpack(drawings[0][1]["pose"])
    away = np.abs(pose[:, :, 2] - pose[0, :, 2]).max(axis=1) > VISIBLE_RAD
    start = float(times[int(np.argmax(away))]) - BEFORE_S if away.any() else float(times[0])
    span = float(times[0]), float(times[-1])
    return Animation(title, drawings, curves, events, span, max(start, span[0]))
