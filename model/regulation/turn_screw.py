"""One screw turned until its own target is met: a secant kept within its bracket, then a search over its travel."""

from __future__ import annotations

import math
from collections.abc import Callable

from model.regulation.bench import CONVERGED, MEASURED_IN, SCREW, TOLERANCE, Bench

MOST_TURNS = 16  # of a screw in a round
LARGEST_TURN = 1e-3  # m in one step
SMALL_TURN = 10e-6  # m, below which the slope of a step is not used again
NOT_MEASURABLE = {"let_off": -2e-3, "check": 5e-3}  # error (m) assumed then: jack stuck, hammer free
FINER = 8  # steps from the nearest of these to each of their neighbours
NEAREST, LEVELS = 3, 3  # places so refined, and how often; the last steps are some micrometres
SEARCH = {"rest": 16, "press": 8, "blow": 32}  # places over the travel where the secant fails


def turn_screw(bench: Bench, name: str, report: Callable[[str], None], beyond_m: float = 0.0) -> float:
    """Turn one screw until its target plus ``beyond_m`` is met, or as near as it can; returns the error left (m)."""
    errors: dict[float, float] = {}

    def error_at(turn: float) -> float:
        if turn not in errors:
            report(f"{SCREW[name].name} {1e3 * turn:+.3f} mm")
            errors[turn] = bench.error(name, turn) - beyond_m
        return errors[turn]

    _secant(bench, name, bench.turn_m[name], error_at)
    for places in (_over_the_travel, *(_beside_the_nearest,) * LEVELS):
        if abs(errors[_best(errors)]) <= TOLERANCE:
            break
        for place in places(bench, name, errors):
            error_at(place)
        for start in _sign_changes(errors):
            _secant(bench, name, start, error_at)
            if abs(errors[_best(errors)]) <= TOLERANCE:
                break
    best = _best(errors)
    bench.turn_m[name] = best
    return errors[best]


def _best(errors: dict[float, float]) -> float:
    return min(errors, key=lambda x: abs(errors[x]) if math.isfinite(errors[x]) else math.inf)


def _over_the_travel(bench: Bench, name: str, errors: dict[float, float]) -> list[float]:
    low, high = bench.limits(name)
    count = SEARCH[MEASURED_IN[name]]
    return [low + (high - low) * k / count for k in range(count + 1)]


def _beside_the_nearest(bench: Bench, name: str, errors: dict[float, float]) -> list[float]:
    """Between the nearest turns and their neighbours: a target may come nearer and go away again within a step.

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
    """Turns to start again from: beside each change of sign, the one nearest to the target first."""
    turns = sorted(turn for turn, error in errors.items() if math.isfinite(error))
    changes = [b if abs(errors[b]) < abs(errors[a]) else a
               for a, b in zip(turns, turns[1:], strict=False) if errors[a] * errors[b] <= 0.0]  # fmt: skip
    return sorted(changes, key=lambda turn: abs(errors[turn]))


def _secant(bench: Bench, name: str, turn: float, error_at: Callable[[float], float]) -> None:
    """Follow the target's slope from ``turn``; keeps what it measures in ``bench.effect``."""
    low, high = bench.limits(name)
    aim = CONVERGED[MEASURED_IN[name]]
    usual = SCREW[name].usual_effect

    def known(at: float) -> tuple[float, bool]:
        error = error_at(at)
        return (error, True) if math.isfinite(error) else (NOT_MEASURABLE.get(name, math.nan), False)

    error, measured = known(turn)
    slope = bench.effect.get(name, usual)
    idle = 0.0  # last turn, where it hardly had an effect
    low_side = high_side = math.nan  # turns with negative and positive error nearest to each other
    for _ in range(MOST_TURNS):
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
        if abs(new - turn) < 1e-10:
            return
        new_error, new_measured = known(new)
        if math.isnan(new_error):  # gone too far for the target to be measured
            new = 0.5 * (turn + new)
            new_error, new_measured = known(new)
            if math.isnan(new_error):
                return
        idle = new - turn if abs(new_error) > 0.7 * abs(error) and new_error * error > 0.0 else 0.0
        if measured and new_measured:
            slope = (new_error - error) / (new - turn)
            if abs(new - turn) > SMALL_TURN and slope * usual > 0.0:
                bench.effect[name] = slope
        turn, error, measured = new, new_error, new_measured
