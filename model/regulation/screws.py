"""The adjustments of an action, each one geometric parameter, and how far each can be turned.

Seven screws have a target each. The rest rail has none: it is lowered where the hammer lies on it instead of the jack.

A screw's travel is counted from where the given action has it, as on a bench: what is inside the travel is reachable
without another part. Why: docs/explanation/regulation.md.
"""

from __future__ import annotations

from dataclasses import dataclass

from model.parameters.action import Action
from model.parameters.quantity import allowed_range


@dataclass(frozen=True)
class Screw:
    """An adjustment.

    Attributes
    ----------
    target : name of the target it adjusts
    name : everyday name
    path : its parameter
    travel_m : range of its turn, down and up
    usual_effect : change of the target per turn (m/m) on an action much like the built-in one; only its sign
        and order of magnitude matter
    """

    target: str
    name: str
    path: str
    travel_m: tuple[float, float]
    usual_effect: float


SCREWS = (
    Screw("dip", "key-dip washers", "contact02.first.y", (-3e-3, 3e-3), -1.0),
    Screw("hammer_height", "capstan", "contact01.first.y", (-3e-3, 3e-3), -10.0),
    Screw("jack", "jack rest pad", "contact05.second.x", (-2e-3, 2e-3), 1.9),
    Screw("repetition", "repetition rest pad", "contact06.second.y", (-2e-3, 2e-3), 1.2),
    Screw("let_off", "button", "contact08.second.y", (-4e-3, 4e-3), -5.0),
    Screw("drop", "drop screw", "contact11.first.y", (-4e-3, 4e-3), -4.5),
    Screw("check", "back-check wire", "contact04.second.x", (-8e-3, 8e-3), -3.0),
)

REST_RAIL = Screw("hammer_height", "rest rail", "contact13.first.y", (-5e-3, 0.0), -5.0)


def limits(given: Action, screw: Screw, wider: float = 0.0) -> tuple[float, float]:
    """Smallest and largest turn (m) within travel and allowed range of the parameter, the travel ``wider`` (m)."""
    low, high, _ = allowed_range(screw.path)
    here = given[screw.path]
    return max(screw.travel_m[0] - wider, low - here), min(screw.travel_m[1] + wider, high - here)
