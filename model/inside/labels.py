"""Words and time intervals that the sheet and the animation of an inside view share."""

from __future__ import annotations

import numpy as np

from model.kernels import layout as L
from model.parameters.action import STRING, Action
from model.simulation.loads_and_losses import Inside

BODY_COLORS = {
    "key": "#8C6D46", "whippen": "#2A8FC4", "jack": "#D55E00", "repetition": "#009E73", "hammer": "#A8528A",
    "shank": "#A8528A", "motor": "#333333",
}  # fmt: skip
"""One colour for each body in every picture; `vision.output.colours` has the same."""
BEFORE_S, AFTER_S = 0.012, 0.018  # of the close-up, around the strike


def close_up(inside: Inside) -> tuple[float, float]:
    """Interval (s) around the largest force on the string, else of any contact."""
    k = inside.contacts.index(STRING) if STRING in inside.contacts else None
    force = inside.normal_n[:, k] if k is not None and inside.normal_n[:, k].any() else inside.normal_n.sum(axis=1)
    middle = float(inside.time_s[int(np.argmax(force))]) if len(inside.contacts) else float(inside.time_s[0])
    return max(float(inside.time_s[0]), middle - BEFORE_S), min(float(inside.time_s[-1]), middle + AFTER_S)


def input_label(inside: Inside | None) -> tuple[str, str]:
    """Name and unit of a run's input."""
    torque = inside is not None and any(kind == L.JOINT_TORQUE for kind, _ in inside.scene.tables.drive)
    return ("torque of the motor", "N m") if torque else ("force on the key", "N")


def contact_label(action: Action, name: str) -> str:
    """Number and name of a contact."""
    number, description = name.removeprefix("contact"), action.structure.get(f"{name}.description", "")
    return f"{number} {description}" if description else number.replace("_", " ")
