"""What is looked at beside the scores: faults of the session, a wrong friction, and the comparison the other way round.

Place in the data flow: measurements, predictions, marks and events → here → findings and motion-driven comparison of
`validation.pipeline.compare_session`.
Conventions: one sound trial of median peak force stands for all where many runs are needed.
Failure: what cannot be done is said in a note.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pandas as pd

from validation.events.definitions import Event
from validation.events.evaluation_window import Window
from validation.events.key_lift import Lift
from validation.findings.friction_search import wrong_friction
from validation.findings.outlier_trials import outlying
from validation.findings.session_checks import (
    WIRING,
    Finding,
    camera_clock,
    dead,
    hum,
    lifts,
    rates,
    short_records,
    wiring,
)
from validation.measurement.geometry import Array
from validation.measurement.trial import Measurement
from validation.prediction.model_under_test import Predictor, TrialPrediction
from validation.prediction.motion_driven import COLUMNS as MOTION_COLUMNS
from validation.prediction.motion_driven import motion_driven, motion_row
from validation.statistics.event_budget import representative
from validation.tables.scores import WORKERS

NOTHING = (pd.DataFrame(columns=MOTION_COLUMNS), None, "")


def compare_by_motion(
    predictor: Predictor,
    measured: list[Measurement],
    marks: dict[int, list[Lift]],
    window: Window,
    findings: list[Finding],
) -> tuple[pd.DataFrame, pd.DataFrame | None, str]:
    """Motion-driven comparison of the sound trial of median peak force; table, trace and a note when it fails."""
    from model.errors import ModelError

    sound = _sound(measured, findings)
    if not sound:
        return NOTHING
    m = representative(sound)
    try:
        with ThreadPoolExecutor(WORKERS) as pool:
            trace = motion_driven(predictor, m, marks[m.number], window, run=pool.map)
    except ModelError as error:
        return *NOTHING[:2], f"trial {m.number}: not driven by its motion: {error}"
    return pd.DataFrame([motion_row(m.number, trace, m.force.gain_relative_u)], columns=MOTION_COLUMNS), trace, ""


def _sound(measured: list[Measurement], findings: list[Finding]) -> list[Measurement]:
    """Trials without a fault that spoils the comparison of one trial with the model."""
    broken = {f.trial for f in findings if f.kind in (*WIRING, "outlying trial")}
    return [m for m in measured if m.number not in broken]


def find_faults(
    predictor: Predictor,
    measured: list[Measurement],
    predictions: dict[int, TrialPrediction],
    marks: dict[int, list[Lift]],
    events: dict[int, dict[str, Event]],
    base: Array,
    traces: dict[int, pd.DataFrame],
    suspect: bool,
) -> list[Finding]:
    """Faults of the session, wiring first; the model is suspected on a trial without any."""
    found = rates(measured) + short_records(measured) + lifts(marks)
    for m in measured:
        found += wiring(m, predictions[m.number]) + dead(m, predictions[m.number]) + hum(m) + camera_clock(m)
    found += outlying(base, traces, measured, events, {(int(f.trial), f.channel) for f in found})
    sound = _sound(measured, found)
    if sound and suspect:
        m = representative(sound)
        release = events[m.number]["key_release"]
        until = release.value if release.status == "found" else float(m.time_s[-1])
        with ThreadPoolExecutor(WORKERS) as pool:
            found += wrong_friction(predictor, m, until, run=pool.map)
    return found
