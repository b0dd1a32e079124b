"""Words and colours that the sheet of an inside view, the player and the report share."""

from __future__ import annotations

from model import tabular
from model.parameters.action import Action
from model.parameters.effects import ARM, FINGER
from model.scene.build import Scene

BODY_COLORS = {**tabular.BODY_COLORS, "shank": "#A8528A", "motor": "#333333"}


def input_label(scene: Scene) -> tuple[str, str]:
    if scene.wound:
        return "command of the motor's drive", "V"
    return {FINGER: ("way of the hand", "m"), ARM: ("torque of the motor", "N m")}.get(
        scene.presser, ("force on the key", "N")
    )


def contact_label(action: Action, name: str) -> str:
    number, description = name.removeprefix("contact"), action.structure.get(f"{name}.description", "")
    return f"{number} {description}" if description else number.replace("_", " ")
