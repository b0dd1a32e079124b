"""Turn screws until their targets are met: one by itself, or the four of the rest targets together.

One screw: a secant kept within its bracket, then a search over its travel.

Dip, hammer height, jack and repetition lever: with the repetition lever lowered the other three are a smooth problem in
three screws, solved by Newton's method from where they are and, if that fails, from a grid over capstan and jack pad;
the lever follows. Where the hammer lies on its rest rail the capstan cannot set its height: then the rail is lowered
clear of it. What stays in the way is found by solving once more with longer screws, and named in a ``RegulationError``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from model.errors import RegulationError
from model.regulation.screws import (
    CLEARANCE,
    CONVERGED,
    LARGEST_TURN,
    MEASURED_IN,
    RAIL,
    REST_RAIL,
    ROUNDING,
    SCREW,
    TOLERANCE,
    TOO_FAR,
    Bench,
)

ITERATIONS = 25  # of a secant or of Newton's method, then a search over the travel follows
SMALL_TURN = 0.5 * TOLERANCE  # m, least turn for a slope
NOT_MEASURABLE = {"let_off": -2e-3, "check": 5e-3}  # error (m) assumed then: jack stuck, hammer free
FINER = 8  # steps from the nearest of these to each of their neighbours
NEAREST = 3  # places so refined, as often; the last steps are some micrometres
SEARCH = {"rest": 16, "press": 8, "blow": 32}  # places over the travel where the secant fails

REST_TARGETS = ("dip", "hammer_height", "jack", "repetition")
WIDER = 6e-3  # m, beyond a screw's travel, in the search for what is in the way
IDLE = 0.1  # of a screw's usual effect, below which it does not carry its part
HALVINGS = 6  # of a step that leads away from the targets: to a sixtieth
GRID = tuple(product((0.0, -0.6, 0.6), repeat=2))  # starts, in shares of the travel of capstan and jack pad
REST_CONTACT = "contact13"

Array = NDArray[np.float64]
Say = Callable[[str], None]  # progress callback: called with a line of text


def turn_screw(bench: Bench, name: str, say: Say, beyond_m: float = 0.0) -> float:
    """Turn the screw of the target ``name`` on ``bench`` until the target's error is ``beyond_m``, or nearest; return
    what is left, m, NaN where it cannot be measured; ``say`` is told each turn."""
    errors: dict[float, float] = {}

    def error_at(turn: float) -> float:
        if turn not in errors:
            say(f"{SCREW[name].name} {1e3 * turn:+.3f} mm")
            errors[turn] = bench.error(name, turn) - beyond_m
        return errors[turn]

    _iterate_secant(bench, name, bench.turn_m[name], error_at)
    for places in (_sample_travel, *(_sample_near_best,) * NEAREST):
        if abs(errors[_best_turn(errors)]) <= TOLERANCE:
            break
        for place in places(bench, name, errors):
            error_at(place)
        for start in _sign_changes(errors):
            _iterate_secant(bench, name, start, error_at)
            if abs(errors[_best_turn(errors)]) <= TOLERANCE:
                break
    best = _best_turn(errors)
    bench.turn_m[name] = best
    return errors[best]


def _best_turn(errors: dict[float, float]) -> float:
    return min(errors, key=lambda x: abs(errors[x]) if math.isfinite(errors[x]) else math.inf)


def _sample_travel(bench: Bench, name: str, errors: dict[float, float]) -> list[float]:
    low, high = bench.limits(name)
    count = SEARCH[MEASURED_IN[name]]
    return [low + (high - low) * k / count for k in range(count + 1)]


def _sample_near_best(bench: Bench, name: str, errors: dict[float, float]) -> list[float]:
    """Turns (m) between the best and their neighbours in ``errors`` (turn -> error), where a target may be met.

    A turn is near where its neighbours are further off, or cannot be measured: there a height may end just beyond.
    """
    turns = sorted(errors)
    off = [abs(errors[turn]) if math.isfinite(errors[turn]) else math.inf for turn in turns]
    inside = [math.inf, *off, math.inf]
    near = [k for k, here in enumerate(off) if here < math.inf and here <= min(inside[k], inside[k + 2])]
    ends = []
    for k in sorted(near, key=lambda k: off[k])[:NEAREST]:
        ends += [(turns[k], turns[j]) for j in (k - 1, k + 1) if 0 <= j < len(turns)]
    return sorted({start + (end - start) * k / FINER for start, end in ends for k in range(1, FINER)})


def _sign_changes(errors: dict[float, float]) -> list[float]:
    """Turns (m) to restart from: at each change of sign of the error the better of both, the best first."""
    turns = sorted(turn for turn, error in errors.items() if math.isfinite(error))
    changes = [b if abs(errors[b]) < abs(errors[a]) else a
               for a, b in zip(turns, turns[1:], strict=False) if errors[a] * errors[b] <= 0.0]  # fmt: skip
    return sorted(changes, key=lambda turn: abs(errors[turn]))


def _iterate_secant(bench: Bench, name: str, turn: float, error_at: Callable[[float], float]) -> None:
    """Secant iteration on the screw of target ``name`` from ``turn``, m, within its travel; ``error_at``: turn ->
    error, m, which keeps what it finds; updates the slope in ``bench.effect``."""
    low, high = bench.limits(name)
    aim = CONVERGED[MEASURED_IN[name]]
    usual = SCREW[name].usual_effect

    def cached_error(at: float) -> tuple[float, bool]:
        error = error_at(at)
        return (error, True) if math.isfinite(error) else (NOT_MEASURABLE.get(name, math.nan), False)

    error, measured = cached_error(turn)
    slope = bench.effect.get(name, usual)
    idle = 0.0  # last turn, where it hardly had an effect
    low_side = high_side = math.nan  # turns with negative and positive error nearest to each other
    for _ in range(ITERATIONS):
        if abs(error) < aim or math.isnan(error):
            return
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
        if abs(new - turn) < ROUNDING:
            return
        new_error, new_measured = cached_error(new)
        if math.isnan(new_error):  # gone too far for the target to be measured
            new = 0.5 * (turn + new)
            new_error, new_measured = cached_error(new)
            if math.isnan(new_error):
                return
        idle = new - turn if abs(new_error) > (1.0 - IDLE) * abs(error) and new_error * error > 0.0 else 0.0
        if measured and new_measured:
            slope = (new_error - error) / (new - turn)
            if abs(new - turn) > SMALL_TURN and slope * usual > 0.0:
                bench.effect[name] = slope
        turn, error, measured = new, new_error, new_measured


def meet_rest_targets(bench: Bench, say: Say) -> None:
    """Turn the four screws of the rest targets until all are met, the rest rail if need be; else raise why not."""
    given = dict(bench.turn_m)
    if (_is_met(bench) and not bench.aim_m) or _search_rest_turns(bench, say, [(0.0, 0.0)]):
        return
    bench.turn_m = given
    low, _ = bench.limits(RAIL)
    with_rail_lowered = replace(bench, turn_m=bench.turn_m | {RAIL: low})
    if _search_rest_turns(with_rail_lowered, say):
        bench.turn_m = with_rail_lowered.turn_m
        _raise_rail(bench, say)
        return
    raise _rest_targets_error(bench, with_rail_lowered, say)


def _search_rest_turns(bench: Bench, say: Say, starts: Iterable[tuple[float, ...]] = GRID) -> bool:
    """Turn the four screws of ``bench`` with its rest rail as it is, from each of ``starts`` (shares of the travel of
    capstan and jack); True if all rest targets are met, else nearest."""
    usual = dict(bench.turn_m)
    attempts: list[tuple[float, dict[str, float]]] = []
    for capstan, pad in starts:
        bench.turn_m = dict(usual)
        if capstan or pad:
            for name, share in (("hammer_height", capstan), ("jack", pad)):
                low, high = bench.limits(name)
                bench.turn_m[name] = share * (high if share > 0.0 else -low)
        if _meet_by_newton(bench, say):
            turn_screw(bench, "repetition", say)
            if _is_met(bench):
                return True
        off = bench.rest_errors(REST_TARGETS[:3]) / [SCREW[name].usual_effect for name in REST_TARGETS[:3]]
        attempts.append((float(np.nan_to_num(np.abs(off).max(), nan=np.inf)), bench.turn_m))
    attempts.sort(key=lambda attempt: attempt[0])
    for how_far, turns in attempts[:NEAREST]:
        # near the edge of slipping the lever must carry its share: as it was, not lowered
        bench.turn_m = turns | {"repetition": usual["repetition"]}
        if how_far < LARGEST_TURN and _meet_by_least_squares(bench, say):
            return True
    bench.turn_m = attempts[0][1]
    return False


def _is_met(bench: Bench) -> bool:
    return bool(np.all(np.abs(bench.rest_errors(REST_TARGETS)) <= 0.5 * TOLERANCE))


def _meet_by_least_squares(bench: Bench, say: Say) -> bool:
    """Turn the four screws of ``bench`` by bounded least squares, where Newton's method fails; True if all are met."""
    from scipy.optimize import least_squares  # start-up: 0.3 s, and few actions need it

    low, high = np.array([bench.limits(name) for name in REST_TARGETS]).T

    def errors(turns: Array) -> Array:
        found = bench.rest_errors(REST_TARGETS, dict(zip(REST_TARGETS, map(float, turns), strict=True)))
        return np.where(np.isfinite(found), found, TOO_FAR)

    def slopes(turns: Array) -> Array:
        inward = np.where(turns + SMALL_TURN > high, -SMALL_TURN, SMALL_TURN)
        here = errors(turns)
        return np.column_stack([(errors(turns + step) - here) / step[j] for j, step in enumerate(np.diag(inward))])

    say("dip, hammer height, jack and repetition lever by least squares")
    start = np.clip([bench.turn_m[name] for name in REST_TARGETS], low + ROUNDING, high - ROUNDING)
    found = least_squares(errors, start, slopes, bounds=(low, high), x_scale="jac", max_nfev=ITERATIONS, xtol=ROUNDING)
    bench.turn_m |= dict(zip(REST_TARGETS, map(float, found.x), strict=True))
    return _is_met(bench)


def _meet_by_newton(bench: Bench, say: Say) -> bool:
    """Turn the four screws of ``bench`` by Newton's method, the lever clear of the jack; True if three are met."""
    low, high = np.array([bench.limits(name) for name in REST_TARGETS]).T
    usual = np.array([SCREW[name].usual_effect for name in REST_TARGETS])

    def errors(x: Array) -> Array:
        found = bench.rest_errors(REST_TARGETS, dict(zip(REST_TARGETS, map(float, x), strict=True)))
        return found - np.array([0.0, 0.0, 0.0, CLEARANCE])

    x = np.array([bench.turn_m[name] for name in REST_TARGETS])
    e = errors(x)
    for _ in range(ITERATIONS):
        if np.all(np.abs(e[:3]) < CONVERGED["rest"]) and e[3] > -0.5 * CLEARANCE or not np.all(np.isfinite(e)):
            break
        say(f"dip, hammer height and jack off by {', '.join(f'{1e3 * one:+.3f}' for one in e[:3])} mm")
        inward = np.where(x + SMALL_TURN > high, -SMALL_TURN, SMALL_TURN)
        slope = np.column_stack([(errors(x + step) - e) / step[j] for j, step in enumerate(np.diag(inward))])
        if not np.all(np.isfinite(slope)):
            break
        own = np.diag(slope)
        idle = own * np.sign(usual) < IDLE * np.abs(usual)  # something else carries the part: go on
        slope[idle] = np.diag(usual)[idle]
        bench.effect |= {n: float(own[j]) for j, n in enumerate(REST_TARGETS[:3]) if not idle[j]}
        full = np.clip(np.linalg.lstsq(slope, -e, rcond=1e-6)[0], -LARGEST_TURN, LARGEST_TURN)
        for k in range(HALVINGS):
            new = np.clip(x + full * 0.5**k, low, high)
            e_new = errors(new)
            if np.any(idle) or np.linalg.norm(e_new / usual) < np.linalg.norm(e / usual):
                break
        else:
            break
        if np.all(np.abs(new - x) < ROUNDING):
            break
        x, e = new, e_new
    bench.turn_m |= dict(zip(REST_TARGETS, map(float, x), strict=True))
    return bool(np.all(np.abs(e[:3]) <= 0.25 * TOLERANCE))  # near the edge where the jack slips it gets no nearer


def _raise_rail(bench: Bench, say: Say) -> None:
    """Raise the rest rail of ``bench`` until it just clears the shank, at most to its unturned position."""
    for _ in range(3):  # the shank is not level: the gap closes by a little less than the rail rises
        up = max(0.0, bench.clearance(REST_CONTACT) - CLEARANCE)
        bench.turn_m[RAIL] = round(min(0.0, bench.turn_m[RAIL] + up), 5)
    say(f"rest rail {1e3 * bench.turn_m[RAIL]:+.2f} mm, clear of the shank")


def _rest_targets_error(bench: Bench, with_rail_lowered: Bench, say: Say) -> RegulationError:
    """Build (not raise) the error of unmet rest targets: a screw that would exceed its limit, else the worst."""
    rail_m = with_rail_lowered.limits(RAIL)[0] - WIDER
    longer = replace(with_rail_lowered, wider_m=WIDER, turn_m=with_rail_lowered.turn_m | {RAIL: rail_m})
    if _search_rest_turns(longer, say):
        _raise_rail(longer, say)
        beyond = {}
        for name in REST_TARGETS:
            low, high = bench.limits(name)
            beyond[name] = max(low - longer.turn_m[name], longer.turn_m[name] - high)
        low, _ = bench.limits(RAIL)
        short = low - longer.turn_m[RAIL]
        if short > max(0.0, *beyond.values()):
            return RegulationError(
                f"{bench.given.origin}: cannot be regulated: the hammer lies on the rest rail ({REST_RAIL.path}) at "
                f"its limit, {1e3 * low:+.2f} mm; it would have to go to {1e3 * longer.turn_m[RAIL]:+.2f} mm"
            )
        name = max(beyond, key=lambda n: beyond[n])
        if beyond[name] > 0.0:
            needed = longer.turn_m[name]
            low, high = bench.limits(name)
            nearest = replace(with_rail_lowered, turn_m=longer.turn_m | {name: min(high, max(low, needed))})
            also = [
                f"the {SCREW[n].name} to {1e3 * longer.turn_m[n]:+.2f} mm"
                for n in REST_TARGETS
                if n != name and beyond[n] > 0.0
            ]
            why = f"it would have to go to {1e3 * needed:+.2f} mm" + "".join(f", {one}" for one in also)
            return nearest.failure(name, float(nearest.rest_errors([name])[0]), why)
    off = dict(zip(REST_TARGETS, with_rail_lowered.rest_errors(REST_TARGETS), strict=True))
    if abs(off["dip"]) + abs(off["hammer_height"]) + abs(off["jack"]) > 3.0 * TOLERANCE:
        del off["repetition"]  # set last, once the others are met
    worst = max(off, key=lambda n: np.inf if np.isnan(off[n]) else abs(off[n] / SCREW[n].usual_effect))
    return with_rail_lowered.failure(
        worst, float(off[worst]), "no position of the screws was found that meets it with the other targets at rest"
    )
