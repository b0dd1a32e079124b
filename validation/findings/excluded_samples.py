"""Which samples of which trial are left out of the scores, and why: false readings of the key encoder.

Place in the data flow: measurements, predictions and events of all trials → here (with `validation.events.key_lift`)
→ traces, scores, warnings, and the table of marked intervals.
Conventions: s on the DAQ clock; a marked sample stays in the traces and figures and is left out of every score.
Failure: none; a trial without an impact is judged with the widest allowance for timing.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import cache, partial
from typing import Any

import pandas as pd

from validation.events.definitions import Event
from validation.events.key_lift import Lift, capstan_of, find_lifts
from validation.findings.session_checks import wiring
from validation.measurement.geometry import KEY, WHIPPEN
from validation.measurement.trial import Measurement
from validation.prediction.model_under_test import Predictor, TrialPrediction
from validation.statistics.event_budget import representative

COLUMNS = ["trial", "channel", "start_s", "end_s", "largest_at_s", "gap_m", "lift_m", "rail_pull_n", "reason"]
KEY_EVENTS = ("key_bottom", "key_release")


def find_marks(
    predictor: Predictor,
    measured: list[Measurement],
    predictions: dict[int, TrialPrediction],
    events: dict[int, dict[str, Event]],
) -> dict[int, list[Lift]]:
    """Marked intervals of every trial; none in trials whose encoders are wired wrong.

    The rail's pull is looked up in the trial of median peak force, moved to each trial's own impact.
    """
    if not measured:
        return {}
    capstan = capstan_of(predictor.action)
    middle = representative(measured)

    @cache
    def pulls() -> tuple[Any, ...]:
        return tuple(predictor.rail_tensions(middle))

    def impact(number: int) -> float:
        return events[number]["string_impact"].value

    def moved(number: int) -> list[Any]:
        by = impact(number) - impact(middle.number)
        if math.isnan(by):  # no impact in one of them
            by = 0.0
        return [replace(t, start_s=t.start_s + by, end_s=t.end_s + by) for t in pulls()]

    found: dict[int, list[Lift]] = {}
    for m in measured:
        if wiring(m, predictions[m.number]):
            found[m.number] = []
            continue
        load = predictor.load(m.force.preload_n)
        angle = load.geometry.absolute({KEY: m.change_rad[:, 0], WHIPPEN: m.change_rad[:, 1]})
        found[m.number] = find_lifts(
            capstan,
            m.time_s,
            angle,
            predictions[m.number].model.angle_rad,
            impact_s=impact(m.number),
            release_s=events[m.number]["key_release"].value,
            rail=partial(moved, m.number),
        )
    return found


def mark_table(marks: dict[int, list[Lift]]) -> pd.DataFrame:
    """Every marked interval."""
    rows = [{"trial": number, "channel": "key", **asdict(lift)} for number, lifts in marks.items() for lift in lifts]
    return pd.DataFrame(rows, columns=COLUMNS)


def doubtful_events(events: dict[int, dict[str, Event]], marks: dict[int, list[Lift]]) -> dict[int, dict[str, Event]]:
    """The same events; those of the key inside a marked interval become ambiguous."""
    out = {}
    for number, found in events.items():
        out[number] = dict(found)
        for name in KEY_EVENTS:
            event = found[name]
            if any(x.start_s <= event.value <= x.end_s for x in marks.get(number, [])):
                out[number][name] = replace(event, status="ambiguous", note="inside a marked lift of the key")
    return out
