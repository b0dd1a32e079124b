"""The seven screws of an action, their travel, and the bench that knows their positions and target errors.

A screw's travel is counted from where the given action has it. Lengths in metres; a target that cannot be measured has
the error NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError, RegulationError, StaticsError
from model.parameters.action import BACK_CHECK, BUTTON, DROP_SCREW, Action
from model.parameters.quantity import allowed_range
from model.regulation.measures import (
    TARGETS,
    RegulationTarget,
    contact_penetration,
    measure_at_rest,
    measure_blow,
    measure_press,
    pivot_displacements,
)
from model.simulation.hand_set_rest import hand_set_rest

CLEARANCE = 0.5e-3  # m, at rest, between parts that must not touch: choice, above any error of a scan
LARGEST_TURN = 1e-3  # m in one step or iteration: choice, an eighth or more of a travel
ROUNDING = 1e-9  # m or its share: below it a turn is none
TOLERANCE = 20e-6  # m, within which a target counts as met
AT_REST, IN_MOTION = 0.1e-6, 4e-6  # m, error at which a screw is left as it is; a press or blow scatters by microns
CONVERGED = {"rest": AT_REST, "press": IN_MOTION, "blow": IN_MOTION}
TOO_FAR = 50e-3  # m, taken for a target that cannot be measured, as where a screw presses on the action at rest

Array = NDArray[np.float64]


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

# button, drop screw, back check: their contacts, open at rest, and the turn that takes them away
AT_REST_CLEAR = {"let_off": (BUTTON, 1.0), "drop": (DROP_SCREW, 1.0), "check": (BACK_CHECK, -1.0)}
MEASURED_IN = {t.name: t.measured_in for t in TARGETS}
SCREW = {s.target: s for s in SCREWS}
RAIL = "rest_rail"  # key of the rest rail among the turns


def limits(given: Action, screw: Screw, wider: float = 0.0) -> tuple[float, float]:
    """Smallest and largest turn (m) within the screw's travel, ``wider`` by so many m, and the parameter's range."""
    low, high, _ = allowed_range(screw.path)
    here = given[screw.path]
    return max(screw.travel_m[0] - wider, low - here), min(screw.travel_m[1] + wider, high - here)


@dataclass
class Bench:
    """The action being regulated: positions of its screws and their measured effects."""

    given: Action  # action as it came
    targets: tuple[RegulationTarget, ...] = TARGETS  # what is wanted
    # target name (or `RAIL`) -> turn of its screw
    turn_m: dict[str, float] = field(default_factory=lambda: {s.target: 0.0 for s in SCREWS} | {RAIL: 0.0})
    # target name -> change of the target per turn of its own screw
    effect: dict[str, float] = field(default_factory=dict)
    # number of rest states, presses and blows
    evaluations: dict[str, int] = field(default_factory=lambda: {"rest": 0, "press": 0, "blow": 0})
    # target at rest -> how far beside what is wanted it is set (m), within its tolerance
    aim_m: Mapping[str, float] = field(default_factory=dict)
    # by how much screws may pass the ends of their travel; above 0 only to find out what is in the way
    wider_m: float = 0.0

    def target(self, name: str) -> RegulationTarget:
        """The target of this name, with the length that is wanted."""
        return next(t for t in self.targets if t.name == name)

    def limits(self, name: str) -> tuple[float, float]:
        """Travel of a screw (m)."""
        return limits(self.given, REST_RAIL if name == RAIL else SCREW[name], self.wider_m)

    def action(self, turns: Mapping[str, float] | None = None) -> Action:
        """The action with its screws as they are, or some of them at ``turns`` (m)."""
        wanted = self.turn_m | dict(turns or {})
        path = {name: REST_RAIL.path if name == RAIL else SCREW[name].path for name in wanted}
        return self.given.with_values({path[name]: self.given[path[name]] + x for name, x in wanted.items() if x})

    def rest_errors(self, names: Iterable[str], turns: Mapping[str, float] | None = None) -> Array:
        """Measured length less that aimed at, m, of the targets ``names`` at rest, with screws at ``turns`` (m; None:
        as they are); NaN where the action does not rest. Counted in ``evaluations``."""
        self.evaluations["rest"] += 1
        try:
            found = measure_at_rest(self.action(turns))
        except (StaticsError, InputError):
            found = {}
        aimed = {name: self.target(name).wanted_m + self.aim_m.get(name, 0.0) for name in names}
        return np.array([found.get(name, math.nan) - x for name, x in aimed.items()])

    def error(self, name: str, turn: float) -> float:
        """Measured length less that wanted, m, of one target with its screw at ``turn`` (m), the others as they are;
        NaN where it cannot be measured. Counted in ``evaluations``."""
        kind = MEASURED_IN[name]
        if kind == "rest":
            return float(self.rest_errors([name], {name: turn})[0])
        action = self.action({name: turn})
        self.evaluations[kind] += 1
        try:
            rest = hand_set_rest(action)
            contact, way = AT_REST_CLEAR[name]
            if contact_penetration(action, contact, rest, pivot_displacements(action, rest)).penetration_m > 0.0:
                # what it holds at rest it neither lets off nor catches; the error of one turned much too far
                return -math.copysign(TOO_FAR, way * SCREW[name].usual_effect)
            if kind == "press":
                found, _, _ = measure_press(action, rest, measure_at_rest(action, rest)["dip"])
            else:
                found, _ = measure_blow(action, rest)
        except (StaticsError, InputError):
            return math.nan
        return found[name] - self.target(name).wanted_m

    def clearance(self, contact: str) -> float:
        """Gap (m) of a contact with the action at rest."""
        action = self.action()
        rest = hand_set_rest(action)
        return -contact_penetration(action, contact, rest, pivot_displacements(action, rest)).penetration_m

    def failure(self, name: str, error: float, why: str = "") -> RegulationError:
        """Build (not raise) the error that names a target, its deviation (m) and its screw's position."""
        target, screw, turn = self.target(name), SCREW[name], self.turn_m[name]
        low, high = self.limits(name)
        where = f"{1e3 * turn:+.2f} mm of {1e3 * low:+.1f} to {1e3 * high:+.1f}"
        at_limit = min(turn - low, high - turn) <= IN_MOTION  # the search ends beside it
        where = f"at its limit, {where}" if at_limit else f"at {where}"
        far = f"stays {1e3 * abs(error):.2f} mm from" if math.isfinite(error) else "cannot be brought to"
        return RegulationError(
            f"{self.given.origin}: cannot be regulated: {target.words} {far} {1e3 * target.wanted_m:.1f} mm "
            f"with the {screw.name} ({screw.path}) {where}{'; ' + why if why else ''}",
            target=name,
            off_m=error,
        )
