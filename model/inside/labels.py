"""Words and colours that the sheet of an inside view, the player and the report share."""

from __future__ import annotations

from model.parameters.action import Action
from model.parameters.effects import ARM, FINGER
from model.scene.build import Scene

BODY_COLORS = {
    "key": "#8C6D46", "whippen": "#2A8FC4", "jack": "#D55E00", "repetition": "#009E73", "hammer": "#A8528A",
    "shank": "#A8528A", "motor": "#333333",
}  # fmt: skip
"""One colour for each body in every picture; `vision.output.colours` has the same."""


def input_label(scene: Scene) -> tuple[str, str]:
    if scene.wound:
        return "command of the motor's drive", "V"
    return {FINGER: ("way of the hand", "m"), ARM: ("torque of the motor", "N m")}.get(
        scene.presser, ("force on the key", "N")
    )


def contact_label(action: Action, name: str) -> str:
    number, description = name.removeprefix("contact"), action.structure.get(f"{name}.description", "")
    return f"{number} {description}" if description else number.replace("_", " ")
