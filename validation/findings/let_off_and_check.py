"""Let-off and check of the hammer that are not the model's.

Conventions: m, trial − model, paired by trial. Let-off is the way of the hammer from where its free flight begins to
where the string turns it, so that another travel hardly enters; strokes without faults differ by less than 0.4 mm. It
is stated from 0.6 mm, in strokes of 1 m/s and more whose hammer does not vibrate about its path, which hides where its
flight begins. The height of check also follows from how fast the hammer comes back; it is stated from 2 mm, in strokes
of 1.5 m/s and more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from validation.events.definitions import Event
from validation.events.flight import LONGEST_S
from validation.findings.finding import SessionFinding, make_finding, name_trials, register_kinds, uncertainty_of_mean
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.numbers import with_named_u
from validation.prediction.predict_session import PredictedAngles
from validation.verdict.quantities import RELEVANT

LET_OFF_M = 0.6e-3  # strokes without faults differ by less than 0.4 mm
LET_OFF_SPEED = 1.0  # softer blows follow friction as well
CHECK_M = RELEVANT["check_height"].default
COVERAGE = 2.0  # standard uncertainties of a trial's difference that it must exceed as well
CHECK_SPEED = 1.5  # softer blows come back too slowly to be caught the same way
CHECKED_WITHIN_M = 0.025  # a hammer held lower was not caught by the back check


def compare_let_off(
    m: MeasuredTrial,
    p: PredictedAngles,
    events: Mapping[str, Event],
    model: Mapping[str, Event],
    geometry: ActionGeometry,
) -> tuple[float, float]:
    """Distance from let-off to the string in the trial less that in its prediction, m, and its standard uncertainty;
    ``events``: the trial's, ``model``: the prediction's, by name. NaN where either lacks an event or is below 1 m/s.

    The way ends where the hammer turns, which a string that yields moves, or where it meets the string, which another
    scale or blow distance moves: stated is what both have, the smaller one of the two.
    """
    if not _has_fast_event(events, model, LET_OFF_SPEED, "let_off"):
        return float("nan"), float("nan")
    known = np.isfinite(p.angle_rad[:, 0])
    predicted = geometry.hammer_height_m(p.angle_rad[known])
    own, theirs = (
        _measure_ways(m.time_s, m.motion.hammer_height_m, events),
        _measure_ways(p.time_s[known], predicted, model),
    )
    to_turn, to_contact = (float(a - b) for a, b in zip(own, theirs, strict=True))
    u = math.hypot(*(e["let_off"].u * e["hammer_speed"].value for e in (events, model)))
    return min(to_turn, to_contact, key=abs) if to_turn * to_contact > 0.0 else 0.0, u


def _measure_ways(time: np.ndarray, height: np.ndarray, events: Mapping[str, Event]) -> tuple[float, float]:
    """From let-off to where the hammer turns, and to where it meets the string, m."""
    at, impact = events["let_off"].value, events["string_impact"].value
    near = np.abs(time - impact) < LONGEST_S
    start, contact = np.interp([at, impact], time, height)
    return float(start - height[near].min()), float(start - contact)


def compare_check_height(events: Mapping[str, Event], model: Mapping[str, Event]) -> tuple[float, float]:
    """Height of check of the trial less the prediction's, m, and u; NaN where not caught, or after a soft blow."""
    if not _has_fast_event(events, model, CHECK_SPEED, "check_height"):
        return float("nan"), float("nan")
    mine, theirs = events["check_height"], model["check_height"]
    is_caught = max(mine.value, theirs.value) < CHECKED_WITHIN_M
    return mine.value - theirs.value if is_caught else float("nan"), math.hypot(mine.u, theirs.u)


def _has_fast_event(events: Mapping[str, Event], model: Mapping[str, Event], speed: float, name: str) -> bool:
    needed = (name, "string_impact", "hammer_speed")
    if any(e[n].status != "found" for e in (events, model) for n in needed):
        return False
    return min(events["hammer_speed"].value, model["hammer_speed"].value) >= speed


@register_kinds(
    {
        "let-off": "Measure the let-off of the action.",
        "check height": "Measure the height of check of the action.",
    }
)
def find_let_off_and_check(
    let_off_m: Mapping[int, tuple[float, float]], check_m: Mapping[int, tuple[float, float]]
) -> list[SessionFinding]:
    """Findings on a let-off more than 0.6 mm, or a check height more than 2 mm, from the model's, and beyond twice its
    uncertainty, one for each side; either argument: trial number → trial less model, m, and its standard uncertainty.
    """
    out = []
    for kind, channel, differences, limit, what in (
        ("let-off", "let_off", let_off_m, LET_OFF_M, "let-off: the hammer's free flight begins"),
        ("check height", "check_height", check_m, CHECK_M, "check: the hammer is caught"),
    ):
        further = {n: d for n, (d, u) in differences.items() if d > max(limit, COVERAGE * u)}
        closer = {n: d for n, (d, u) in differences.items() if d < -max(limit, COVERAGE * u)}
        for away, side in ((further, "further from"), (closer, "closer to")):
            if away:
                size = _format_size(away, float(np.mean([differences[n][1] for n in away])))
                text = f"{what} {size} {side} the string than in the model {name_trials(away, differences)}"
                text += f" (limit {1e3 * limit:g} mm)"
                out.append(make_finding(kind, channel, away, limit, text))
    return out


def _format_size(values: Mapping[int, float], u_each: float) -> str:
    """Text of the mean and its u: the uncertainty of each trial, common to all, and their scatter over root n."""
    u = math.hypot(u_each, float(np.nan_to_num(uncertainty_of_mean(values.values()))))
    return with_named_u(1e3 * abs(float(np.mean(list(values.values())))), 1e3 * u, "mm")
