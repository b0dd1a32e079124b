"""Turning the seven screws until the seven targets are met, in a technician's order.

What touches at rest but should not (button, drop screw, back check) is cleared first, and the repetition lever lowered;
then each screw is set to its own target, by a secant kept within its bracket. Screws disturb each other, so rounds are
repeated until a measurement of all seven agrees. An action that cannot be regulated raises ``RegulationError``, which
names target, distance and screw.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from model.errors import InputError, RegulationError
from model.parameters.action import BACK_CHECK, BUTTON, DROP_SCREW, Action
from model.parameters.quantity import allowed_range
from model.parameters.write_toml import write_action as write_action  # public here too: model.regulation.write_action
from model.regulation.contact_gap import contact_gap
from model.regulation.measures import TARGETS, RegulationTarget, TargetValues, at_rest, in_blow, in_press, measure
from model.regulation.screws import SCREWS, Screw
from model.simulation.hand_set_rest import hand_set_rest

TOLERANCE = 20e-6  # m, within which a target counts as met
CONVERGED = {"rest": 0.1e-6, "press": 4e-6, "blow": 4e-6}  # m, error at which a screw is left as it is
ROUNDS = 6
SWEEPS = 20  # over dip, hammer height and jack within a round
MOST_TURNS = 16  # of a screw in a round
LARGEST_TURN = 1e-3  # m in one step
SMALL_TURN = 10e-6  # m, below which the slope of a step is not used again
CLEARANCE = 0.5e-3  # m, of button, drop screw and back check at rest
LOWERED = 0.5e-3  # m, repetition lever below the jack while the height is set
CLEARED = {BUTTON: "let_off", DROP_SCREW: "drop", BACK_CHECK: "check"}
NOT_MEASURABLE = {"let_off": -2e-3, "check": 5e-3}  # error (m) assumed then: jack stuck, hammer free
_TARGET = {t.name: t for t in TARGETS}
_SCREW = {s.target: s for s in SCREWS}


@dataclass(frozen=True)
class Regulation:
    """A regulated action, and the steps to it.

    Attributes
    ----------
    action : regulated parameter set
    before, after : all seven measurements
    turned_m : target name -> how far its screw was turned from the given action
    effect : target name -> change of the target per turn of its own screw, m/m
    evaluations : number of rest states, presses and blows
    """

    action: Action
    before: TargetValues
    after: TargetValues
    turned_m: dict[str, float]
    effect: dict[str, float]
    evaluations: dict[str, int]

    @property
    def looks(self) -> dict[str, int]:
        """Former name of `evaluations`."""
        return self.evaluations


@dataclass
class _Bench:
    """The action being regulated: positions of its screws and their measured effects."""

    given: Action
    turn_m: dict[str, float] = field(default_factory=dict)  # target -> turn of its screw
    effect: dict[str, float] = field(default_factory=dict)
    evaluations: dict[str, int] = field(default_factory=lambda: {"rest": 0, "press": 0, "blow": 0})

    def action(self, turns: dict[str, float] | None = None) -> Action:
        wanted = self.turn_m | (turns or {})
        return self.given.with_values({_SCREW[t].path: self.given[_SCREW[t].path] + x for t, x in wanted.items()})

    def error(self, name: str, turn: float) -> float:
        """Error (m) of let-off, drop or check with its screw at ``turn``; NaN where it cannot be measured."""
        action = self.action({name: turn})
        rest = hand_set_rest(action)
        kind = _TARGET[name].measured_in
        self.evaluations[kind] += 1
        if kind == "rest":
            found = at_rest(action, rest)
        elif kind == "press":
            found, _, _ = in_press(action, rest, at_rest(action, rest)["dip"])
        else:
            found, _ = in_blow(action, rest)
        return found[name] - _TARGET[name].wanted_m


def _limits(given: Action, screw: Screw) -> tuple[float, float]:
    """Travel of a screw (m), within the allowed range of its parameter."""
    low, high, _ = allowed_range(screw.path)
    here = given[screw.path]
    return max(screw.travel_m[0], low - here), min(screw.travel_m[1], high - here)


def _at_limit(given: Action, name: str, turn: float) -> bool:
    low, high = _limits(given, _SCREW[name])
    return min(turn - low, high - turn) < 1e-6


def _fail(given: Action, name: str, error: float, turn: float, why: str = "") -> RegulationError:
    target, screw = _TARGET[name], _SCREW[name]
    low, high = _limits(given, screw)
    where = f"{1e3 * turn:+.2f} mm of {1e3 * low:+.1f} to {1e3 * high:+.1f}"
    where = f"at its limit, {where}" if _at_limit(given, name, turn) else f"at {where}"
    far = f"stays {1e3 * abs(error):.2f} mm from" if math.isfinite(error) else "cannot be brought to"
    return RegulationError(
        f"{given.origin}: cannot be regulated: {target.words} {far} {1e3 * target.wanted_m:.1f} mm "
        f"with the {screw.name} ({screw.path}) {where}{'; ' + why if why else ''}"
    )


def _clear(bench: _Bench, report: Callable[[str], None]) -> None:
    """Turn away what is close at rest: button and drop screw up, back check back."""
    for contact, name in CLEARED.items():
        low, high = _limits(bench.given, _SCREW[name])
        away = -LARGEST_TURN if name == "check" else LARGEST_TURN
        while (room := _room(bench.action(), contact)) < CLEARANCE:
            new = min(high, max(low, bench.turn_m[name] + away))
            if new == bench.turn_m[name]:
                if room > 0.0:
                    break
                raise _fail(bench.given, name, math.nan, new, "it presses on the action at rest")
            report(f"{_SCREW[name].name} out of the way")
            bench.turn_m[name] = new


def _room(action: Action, contact: str) -> float:
    """Gap (m) of a contact with the action at rest."""
    return -contact_gap(action, contact, hand_set_rest(action)).penetration_m


def _set_rest(bench: _Bench, report: Callable[[str], None]) -> None:
    """Dip, hammer height and jack with the repetition lever lowered, then the lever."""
    if bench.error("repetition", bench.turn_m["repetition"]) < 0.5 * LOWERED:
        _set_one(bench, "repetition", report, LOWERED, strict=False)
    first = ("dip", "hammer_height", "jack")
    for _ in range(SWEEPS):
        for name in first:
            _set_one(bench, name, report, strict=False)
        off = {name: bench.error(name, bench.turn_m[name]) for name in first}
        if all(abs(error) < 2.0 * CONVERGED["rest"] for error in off.values()):
            break
    off_target = {name: error for name, error in off.items() if not abs(error) <= TOLERANCE}
    if off_target:  # name a screw at its limit, the capstan first: height determines the others
        for name in ("hammer_height", "jack", "dip"):
            if name in off_target and _at_limit(bench.given, name, bench.turn_m[name]):
                raise _fail(bench.given, name, off_target[name], bench.turn_m[name])
        worst = max(off_target, key=lambda name: abs(off_target[name] / _SCREW[name].usual_effect))
        raise _fail(bench.given, worst, off_target[worst], bench.turn_m[worst])
    _set_one(bench, "repetition", report)


def _set_one(
    bench: _Bench, name: str, report: Callable[[str], None], beyond_m: float = 0.0, strict: bool = True
) -> None:
    """Turn one screw until its target plus ``beyond_m`` is met, or as near as it can where not ``strict``."""
    low, high = _limits(bench.given, _SCREW[name])
    aim = CONVERGED[_TARGET[name].measured_in]
    usual = _SCREW[name].usual_effect
    errors: dict[float, float] = {}

    def error_at(turn: float) -> float:
        if turn not in errors:
            report(f"{_SCREW[name].name} {1e3 * turn:+.3f} mm")
            errors[turn] = bench.error(name, turn) - beyond_m
        return errors[turn] if math.isfinite(errors[turn]) else NOT_MEASURABLE.get(name, math.nan)

    turn = bench.turn_m[name]
    error = error_at(turn)
    slope = bench.effect.get(name, usual)
    idle = 0.0  # last turn, where it hardly had an effect
    low_side = high_side = math.nan  # turns with negative and positive error nearest to each other
    for _ in range(MOST_TURNS):
        if abs(error) < aim:
            break
        if math.isnan(error):
            raise _fail(bench.given, name, error, turn, "it cannot be measured")
        if error < 0.0:
            low_side = turn
        else:
            high_side = turn
        if slope * usual <= 0.0:
            slope = usual
        step = -error / slope
        if idle:  # no effect: something else carries the part, go on until the screw does
            step = math.copysign(max(abs(step), 2.0 * abs(idle)), step)
        new = min(high, max(low, turn + max(-LARGEST_TURN, min(LARGEST_TURN, step))))
        if math.isfinite(low_side + high_side) and not min(low_side, high_side) < new < max(low_side, high_side):
            new = 0.5 * (low_side + high_side)
        if abs(new - turn) < 1e-10:
            break
        new_error = error_at(new)
        idle = new - turn if abs(new_error) > 0.7 * abs(error) and new_error * error > 0.0 else 0.0
        if math.isfinite(errors[turn]) and math.isfinite(errors[new]):
            slope = (new_error - error) / (new - turn)
            if abs(new - turn) > SMALL_TURN and slope * usual > 0.0:
                bench.effect[name] = slope
        turn, error = new, new_error
    best = min(errors, key=lambda x: abs(errors[x]) if math.isfinite(errors[x]) else math.inf)
    bench.turn_m[name] = best
    if strict and not abs(errors[best]) <= TOLERANCE:
        raise _fail(bench.given, name, errors[best], best if math.isfinite(errors[best]) else turn)


def regulate(action: Action, progress: Callable[[str], None] | None = None) -> Regulation:
    """Regulate an action: find the positions of the seven screws that meet the seven targets of thesis Section 2.3.

    Parameters
    ----------
    action : parameter set; not changed
    progress : called with a short text at each step

    Raises
    ------
    RegulationError : a target cannot be met; the message names target, distance, screw and its travel
    StaticsError, IntegrationError : the action has no rest state or cannot be pressed
    """
    report = progress or (lambda _: None)
    before = measure(action)
    bench = _Bench(action, turn_m={s.target: 0.0 for s in SCREWS})
    after, worst = before, ""
    for _ in range(ROUNDS):
        off = {t.name: after.value_m[t.name] - t.wanted_m for t in TARGETS}
        worst = max(off, key=lambda n: math.inf if math.isnan(off[n]) else abs(off[n]))
        if all(abs(x) <= 0.5 * TOLERANCE for x in off.values()):
            break
        _clear(bench, report)
        _set_rest(bench, report)
        for name in ("let_off", "drop", "check"):
            _set_one(bench, name, report)
        report("all seven again")
        bench.turn_m = {target: round(turn, 7) for target, turn in bench.turn_m.items()}  # 0.1 um
        after = measure(bench.action())
    error = after.value_m[worst] - _TARGET[worst].wanted_m
    if not abs(error) <= TOLERANCE:
        raise _fail(action, worst, error, bench.turn_m[worst], f"the screws disturb each other in {ROUNDS} rounds")
    return Regulation(
        action=_finished(bench),
        before=before,
        after=after,
        turned_m=dict(bench.turn_m),
        effect=dict(bench.effect),
        evaluations=dict(bench.evaluations),
    )


def _finished(bench: _Bench) -> Action:
    """The regulated set, with source and uncertainty of what was turned.

    The uncertainty of a screw is that of its target, a rectangular tolerance, divided by the screw's effect.
    """
    action = bench.action()
    quantities = dict(action.quantities)
    for target, turn in bench.turn_m.items():
        screw, wanted = _SCREW[target], _TARGET[target]
        if turn == 0.0:
            quantities[screw.path] = bench.given.quantities[screw.path]
            continue
        effect = abs(bench.effect.get(target, math.nan))
        if not effect > 0.0:
            raise InputError(f"{bench.given.origin}: the {screw.name} ({screw.path}) has no effect on {wanted.words}")
        quantities[screw.path] = replace(
            quantities[screw.path],
            u=float(f"{TOLERANCE / math.sqrt(3.0) / effect:.2g}"),
            basis="assumed",
            source=(
                f"regulated: {wanted.words} {1e3 * wanted.wanted_m:.1f} mm (thesis 2.3); {screw.name} turned "
                f"{1e3 * turn:+.3f} mm; before: {bench.given.quantities[screw.path].source}"
            ),
        )
    return replace(
        action,
        name=f"{bench.given.name}-regulated",
        description=f"{bench.given.description}; regulated as Section 2.3 describes",
        quantities=quantities,
        changed={},
    )


def unmet(measurement: TargetValues, tolerance_m: float = TOLERANCE) -> list[RegulationTarget]:
    """Targets that a measurement does not meet within ``tolerance_m``."""
    return [t for t in TARGETS if not abs(measurement.value_m[t.name] - t.wanted_m) <= tolerance_m]
