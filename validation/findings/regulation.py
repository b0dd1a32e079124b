"""Regulation that is not the model's: the hammer is let off, or caught, elsewhere.

Conventions: m, trial − model, paired by trial, median over trials. Let-off is the way of the hammer from where its
free flight begins to where the string turns it, so that a wrong scale or blow distance hardly enters; it is geometry,
and the strokes without faults differ by less than 0.4 mm. The height of check also follows from friction at the back
check and from how fast the hammer comes back: both causes are named together, from 2 mm, in strokes of 1.5 m/s and
more. Detectable: let-off from 0.6 mm, in strokes of 1 m/s and more. A drop screw alone shows only where it takes the
hammer over from the button, as a let-off; a jack or lever pad does not show.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from validation.events.definitions import Event
from validation.findings.finding import SessionFinding, finds
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

LET_OFF_M = 0.6e-3
LET_OFF_SPEED = 1.0  # softer blows follow friction as well
CHECK_M = 2e-3
CHECK_SPEED = 1.5
CHECKED_WITHIN_M = 0.025  # a hammer held lower was not caught by the back check
AGREE = 0.5  # of the deviation, largest scatter between trials


def let_off_way_m(
    m: MeasuredTrial,
    p: PredictedAngles,
    events: Mapping[str, Event],
    model: Mapping[str, Event],
    geometry: ActionGeometry,
) -> float:
    """Way from let-off to the string of the trial less that of its prediction, m; NaN where either has none."""
    if not _resolved(events, model, LET_OFF_SPEED, "let_off"):
        return float("nan")
    known = np.isfinite(p.angle_rad[:, 0])
    predicted = geometry.hammer_height_m(p.angle_rad[known])
    return _way(m.time_s, m.motion.hammer_height_m, events) - _way(p.time_s[known], predicted, model)


def _way(time: np.ndarray, height: np.ndarray, events: Mapping[str, Event]) -> float:
    at, impact = events["let_off"].value, events["string_impact"].value
    near = np.abs(time - impact) < 5e-3
    return float(np.interp(at, time, height) - height[near].min())


def check_difference_m(events: Mapping[str, Event], model: Mapping[str, Event]) -> float:
    """Height of check of the trial less that of its prediction, m; NaN where not caught, or after a soft blow."""
    if not _resolved(events, model, CHECK_SPEED, "check_height"):
        return float("nan")
    mine, theirs = events["check_height"].value, model["check_height"].value
    return mine - theirs if max(mine, theirs) < CHECKED_WITHIN_M else float("nan")


def _resolved(events: Mapping[str, Event], model: Mapping[str, Event], speed: float, name: str) -> bool:
    needed = (name, "string_impact", "hammer_speed")
    if any(e[n].status != "found" for e in (events, model) for n in needed):
        return False
    return min(events["hammer_speed"].value, model["hammer_speed"].value) >= speed


@finds(
    {
        "regulation": "Measure the let-off.",
        "check height": "Measure the height of check.",
    }
)
def regulation(let_off_m: Mapping[int, float], check_m: Mapping[int, float]) -> list[SessionFinding]:
    """Differences of let-off and check that all trials share; arguments by trial, of the two functions above."""
    out = []
    for kind, channel, differences, limit, what, cause in (
        ("regulation", "let_off", let_off_m, LET_OFF_M, "regulation: in all trials the hammer is let off",
         "let-off button or drop screw are not regulated as the model's; measure let-off, or regulate the model alike "
         "(pianorig regulate)"),
        ("check height", "check_height", check_m, CHECK_M, "check: in all trials the hammer is caught",
         "the back check is not regulated as the model's, or its friction is not the model's"),
    ):  # fmt: skip
        d = _common(differences, limit)
        if d is not None:
            side = "further from" if d > 0 else "closer to"
            text = (
                f"{what} {1e3 * abs(d):.1f} mm {side} the string than in the model (limit {1e3 * limit:g} mm): {cause}"
            )
            out.append(SessionFinding(kind, float("nan"), channel, d, limit, text))
    return out


def _common(by_trial: Mapping[int, float], limit: float) -> float | None:
    known = np.array([v for v in by_trial.values() if np.isfinite(v)])
    if known.size < max(2, (len(by_trial) + 1) // 2):
        return None
    middle = float(np.median(known))
    scatter = float(np.median(np.abs(known - middle)))
    return middle if abs(middle) > limit and scatter < AGREE * abs(middle) else None
