"""Reading ``--set path=value`` and ``--scale name=factor`` of the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    from model import Action

SCALE_HELP = (
    "Parameter, law, pattern or group (damping, friction, joint_friction) to multiply, name=factor; repeatable."
)
_EXAMPLES = {
    "--set": "path=value, for example contact04.friction.A=0.3",
    "--scale": "name=factor, for example damping=0.1",
}


def read_settings(settings: Sequence[str], option: str = "--set") -> dict[str, float]:
    """Turn ``["contact04.friction=0"]`` into ``{"contact04.friction": 0.0}``.

    Raises
    ------
    InputError : no equals sign, the value is not a number, or one name is given twice
    """
    out: dict[str, float] = {}
    for setting in settings:
        path, equals, text = (part.strip() for part in setting.partition("="))
        if not equals or not path:
            raise InputError(f"{option} {setting!r}: allowed {_EXAMPLES[option]}")
        if path in out:
            raise InputError(f"{option} {path}: given twice; allowed once")
        try:
            out[path] = float(text)
        except ValueError:
            raise InputError(f"{option} {path}: value found {text!r}, allowed a number") from None
    return out


def load_changed(action: str, set_: Sequence[str] | None, scale: Sequence[str] | None) -> Action:
    """The action with what ``--set`` gives, then with what ``--scale`` multiplies."""
    import model

    values, factors = read_settings(set_ or []), read_settings(scale or [], "--scale")
    return model.scaled(model.load_action(action, values), factors)
