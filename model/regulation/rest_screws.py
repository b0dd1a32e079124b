"""Dip, hammer height, jack and repetition lever: the four targets of an action at rest, met by four screws together.

With the repetition lever lowered the other three are a smooth problem in three screws, solved by Newton's method from
where they are and, if that fails, from a grid over capstan and jack pad; the lever follows. Where the hammer lies on
its rest rail the capstan cannot set its height: then the rail is lowered clear of it. What stays in the way is found by
solving once more with longer screws, and named in a ``RegulationError``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from model.errors import RegulationError
from model.regulation.bench import CONVERGED, RAIL, SCREW, TOLERANCE, Bench
from model.regulation.screws import REST_RAIL
from model.regulation.turn_screw import turn_screw

REST_TARGETS = ("dip", "hammer_height", "jack", "repetition")
LOWERED = 0.5e-3  # m, repetition lever below the jack while the other three are set
CLEARANCE = 0.5e-3  # m, rest rail below the shank once it had to be lowered
WIDER = 6e-3  # m, beyond a screw's travel, in the search for what is in the way
DIFFERENCE = 10e-6  # m, turn for a slope
IDLE = 0.1  # of a screw's usual effect, below which it does not carry its part
LARGEST_TURN = 1e-3  # m in one iteration
ITERATIONS, HALVINGS = 25, 6
GRID = tuple(product((0.0, -0.6, 0.6), repeat=2))  # starts, in shares of the travel of capstan and jack pad
NEAR, NEAR_STARTS = 1e-3, 2  # m of screw, and number of starts, tried again by least squares
LOST = 20e-3  # m, taken for a target that cannot be measured
REST_CONTACT = "contact13"

Array = NDArray[np.float64]
Report = Callable[[str], None]


def set_rest(bench: Bench, report: Report) -> None:
    """Meet the four targets at rest.

    Raises
    ------
    RegulationError : they cannot be met; names the screw in the way and how far it would have to go
    """
    given = dict(bench.turn_m)
    if (_met(bench) and not bench.aim_m) or _solve(bench, report, [(0.0, 0.0)]):
        return
    bench.turn_m = given
    low, _ = bench.limits(RAIL)
    lowered = replace(bench, turn_m=bench.turn_m | {RAIL: low})
    if _solve(lowered, report):
        bench.turn_m = lowered.turn_m
        _raise_rail(bench, report)
        return
    raise _in_the_way(bench, lowered, report)


def _solve(bench: Bench, report: Report, starts: Iterable[tuple[float, ...]] = GRID) -> bool:
    """Turn the four screws with the rest rail where it is; whether they meet their targets, else as near as it gets."""
    usual = dict(bench.turn_m)
    attempts: list[tuple[float, dict[str, float]]] = []
    for capstan, pad in starts:
        bench.turn_m = dict(usual)
        if capstan or pad:
            for name, share in (("hammer_height", capstan), ("jack", pad)):
                low, high = bench.limits(name)
                bench.turn_m[name] = share * (high if share > 0.0 else -low)
        if _newton(bench, report):
            turn_screw(bench, "repetition", report)
            if _met(bench):
                return True
        off = bench.rest_errors(REST_TARGETS[:3]) / [SCREW[name].usual_effect for name in REST_TARGETS[:3]]
        attempts.append((float(np.nan_to_num(np.abs(off).max(), nan=np.inf)), bench.turn_m))
    attempts.sort(key=lambda attempt: attempt[0])
    for how_far, turns in attempts[:NEAR_STARTS]:
        # near the edge of slipping the lever must carry its share: as it was, not lowered
        bench.turn_m = turns | {"repetition": usual["repetition"]}
        if how_far < NEAR and _least_squares(bench, report):
            return True
    bench.turn_m = attempts[0][1]
    return False


def _met(bench: Bench) -> bool:
    return bool(np.all(np.abs(bench.rest_errors(REST_TARGETS)) <= 0.5 * TOLERANCE))


def _least_squares(bench: Bench, report: Report) -> bool:
    """Turn all four screws by SciPy's least squares, from where Newton's method went to and fro over a kink."""
    from scipy.optimize import least_squares  # start-up: 0.3 s, and few actions need it

    low, high = np.array([bench.limits(name) for name in REST_TARGETS]).T

    def errors(turns: Array) -> Array:
        found = bench.rest_errors(REST_TARGETS, dict(zip(REST_TARGETS, map(float, turns), strict=True)))
        return np.where(np.isfinite(found), found, LOST)

    def slopes(turns: Array) -> Array:
        inward = np.where(turns + DIFFERENCE > high, -DIFFERENCE, DIFFERENCE)
        here = errors(turns)
        return np.column_stack([(errors(turns + step) - here) / step[j] for j, step in enumerate(np.diag(inward))])

    report("dip, hammer height, jack and repetition lever by least squares")
    start = np.clip([bench.turn_m[name] for name in REST_TARGETS], low + 1e-9, high - 1e-9)
    found = least_squares(errors, start, slopes, bounds=(low, high), x_scale="jac", max_nfev=ITERATIONS, xtol=1e-9)
    bench.turn_m |= dict(zip(REST_TARGETS, map(float, found.x), strict=True))
    return _met(bench)


def _newton(bench: Bench, report: Report) -> bool:
    """Set dip, hammer height and jack together, the lever `LOWERED` below the jack; whether the first three are met."""
    low, high = np.array([bench.limits(name) for name in REST_TARGETS]).T
    usual = np.array([SCREW[name].usual_effect for name in REST_TARGETS])

    def errors(x: Array) -> Array:
        found = bench.rest_errors(REST_TARGETS, dict(zip(REST_TARGETS, map(float, x), strict=True)))
        return found - np.array([0.0, 0.0, 0.0, LOWERED])

    x = np.array([bench.turn_m[name] for name in REST_TARGETS])
    e = errors(x)
    for _ in range(ITERATIONS):
        if np.all(np.abs(e[:3]) < CONVERGED["rest"]) and e[3] > -0.5 * LOWERED or not np.all(np.isfinite(e)):
            break
        report(f"dip, hammer height and jack off by {', '.join(f'{1e3 * one:+.3f}' for one in e[:3])} mm")
        inward = np.where(x + DIFFERENCE > high, -DIFFERENCE, DIFFERENCE)
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
        if np.all(np.abs(new - x) < 1e-9):
            break
        x, e = new, e_new
    bench.turn_m |= dict(zip(REST_TARGETS, map(float, x), strict=True))
    return bool(np.all(np.abs(e[:3]) <= 0.25 * TOLERANCE))  # near the edge where the jack slips it gets no nearer


def _raise_rail(bench: Bench, report: Report) -> None:
    """Bring the rest rail back up to where it clears the shank, at most to where it was."""
    for _ in range(3):  # the shank is not level: the gap closes by a little less than the rail rises
        up = max(0.0, bench.room(REST_CONTACT) - CLEARANCE)
        bench.turn_m[RAIL] = round(min(0.0, bench.turn_m[RAIL] + up), 5)
    report(f"rest rail {1e3 * bench.turn_m[RAIL]:+.2f} mm, clear of the shank")


def _in_the_way(bench: Bench, lowered: Bench, report: Report) -> RegulationError:
    """What keeps the targets at rest from being met: screws that are too short, else the worst target."""
    longer = replace(lowered, wider_m=WIDER, turn_m=lowered.turn_m | {RAIL: lowered.limits(RAIL)[0] - WIDER})
    if _solve(longer, report):
        _raise_rail(longer, report)
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
            nearest = replace(lowered, turn_m=longer.turn_m | {name: min(high, max(low, needed))})
            also = [
                f"the {SCREW[n].name} to {1e3 * longer.turn_m[n]:+.2f} mm"
                for n in REST_TARGETS
                if n != name and beyond[n] > 0.0
            ]
            why = f"it would have to go to {1e3 * needed:+.2f} mm" + "".join(f", {one}" for one in also)
            return nearest.failure(name, float(nearest.rest_errors([name])[0]), why)
    off = dict(zip(REST_TARGETS, lowered.rest_errors(REST_TARGETS), strict=True))
    if abs(off["dip"]) + abs(off["hammer_height"]) + abs(off["jack"]) > 3.0 * TOLERANCE:
        del off["repetition"]  # set last, once the others are met
    worst = max(off, key=lambda n: np.inf if np.isnan(off[n]) else abs(off[n] / SCREW[n].usual_effect))
    return lowered.failure(
        worst, float(off[worst]), "no position of the screws was found that meets it with the other targets at rest"
    )
