"""Model against experiment, trial by trial: the one function that turns a session into a `ValidationResult`.

Place in the data flow: `rig.session` → measurement → prediction → events, scores, repeatability →
`ValidationResult`.
Conventions: each trial's own corrected force drives the model from rest; model and trial are never aligned;
the evaluation window is fixed from measured events before anything is scored.
Failure: a trial that cannot be used is listed with its reason and the rest goes on; no usable trial is an
`InputError`.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from validation.cache.provenance import provenance
from validation.cache.result_cache import Kept
from validation.errors import InputError
from validation.events.angular_speed import keep_speeds, speed_table
from validation.events.definitions import Event
from validation.events.evaluation_window import Window, common_window
from validation.events.key_lift import Lift
from validation.findings.excluded_samples import doubtful_events, find_marks, mark_table
from validation.findings.pooling import counting_events, left_out, with_and_without
from validation.findings.run_checks import NOTHING, compare_by_motion, find_faults
from validation.findings.session_checks import finding_table
from validation.measurement.geometry import ActionGeometry
from validation.measurement.session import measure_all, open_session
from validation.measurement.trial import U_REST_LEVEL_M, Measurement
from validation.pipeline.verdict import verdict_lines
from validation.prediction.model_under_test import RIVALS, Predictor, TrialPrediction
from validation.result import ValidationResult
from validation.statistics.event_budget import COLUMNS, event_budget, representative
from validation.statistics.repeatability import event_repeatability, few_trials_warning
from validation.tables.channels import channel_tables
from validation.tables.events import event_summary, event_table
from validation.tables.scores import WORKERS, score_table, scorecard, with_scores
from validation.tables.traces import film_trace_table, trace_table
from validation.tables.trials import trial_row, uncertainty_table

MOST_NAMED = 4
"""Trials named of those that share a reason."""


def compare_session(
    session: Any,
    action: Any = "hirschkorn2004",
    *,
    tolerance: float = 1e-5,
    predict: Callable[..., Any] | None = None,
    rest_state: Callable[..., Any] | None = None,
    geometry: Callable[[Any, Any], ActionGeometry] | None = None,
    rivals: tuple[str, ...] = RIVALS,
    budget: bool = True,
    suspect: bool = True,
    by_motion: bool = False,
    keep_predictions: bool = True,
    u_rest_level_m: float = U_REST_LEVEL_M,
    condition: str | None = None,
    now: Callable[[], datetime] = lambda: datetime.now(UTC),
    progress: Callable[[str], None] | None = None,
) -> ValidationResult:
    """Compare every usable trial of a session with its own prediction.

    Parameters
    ----------
    session : rig.session.Session or path
    action : name, path or model action
    tolerance : float
        Requested largest error of any predicted angle, rad.
    predict, rest_state, geometry : callable, optional
        Stand-ins for ``model.simulate``, ``model.rest_state`` and `validation.measurement.geometry.geometry_of`.
    rivals : tuple of str
        What is scored beside the model: ``null`` (the null model), ``raw_force`` (the model under the recorded force).
    budget : bool
        Make the uncertainty budget of the events, some fifty runs of one trial.
    suspect : bool
        Look for a wrong friction of the model, some thirty runs of one trial.
    by_motion : bool
        Also drive the model by the key's measured motion and compare the force, in the trial of median peak force.
    keep_predictions : bool
        Keep predictions and scores in the session's ``derived`` and reuse them when their inputs have not changed.
    u_rest_level_m : float
        Standard uncertainty of hammer height and key dip at rest on the bench.
    condition : str, optional
        Condition of the session's trial plan to compare; needed where usable trials are of several.
    now : callable
        The clock of the report's date.
    progress : callable, optional
        Called with a line of text per trial.

    Returns
    -------
    ValidationResult

    Raises
    ------
    InputError
        When the session or the action cannot be read, or no trial is usable.
    """
    session = open_session(session)
    # what a stand-in computes is known by its name only
    own = predict is None and rest_state is None and geometry is None
    predictor = Predictor(
        load_model(action),
        tolerance=tolerance,
        predict=predict,
        rest_state=rest_state,
        geometry=geometry,
        rivals=rivals,
        session=session if keep_predictions else None,
        kept=Kept(Path(session.path) if keep_predictions and own else None),
    )
    measured, refused = measure_all(
        session, lambda preload: predictor.load(preload).geometry, u_rest_level_m, condition
    )
    predictions = _predict_all(predictor, measured, refused, progress)
    measured = [m for m in measured if m.number in predictions]
    if not measured:
        raise InputError(f"{session.path}: no usable trial ({_reasons(refused)}); record or accept at least one")
    trial_events = {m.number: predictor.events(m.motion, m.quiet.stop) for m in measured}
    window = common_window(measured, trial_events)
    marks = find_marks(predictor, measured, predictions, trial_events)
    trial_events = doubtful_events(trial_events, marks)
    warnings = [few_trials_warning(len(measured))]
    for m in measured:
        warnings += [f"trial {m.number}: {text}" for text in (*m.notes, *predictions[m.number].notes)]
    warnings += [f"trial {number} is not used: {reason}" for number, reason in refused.items()]
    if progress is not None and budget:
        progress("uncertainty budget of the events")
    return _assemble(
        session,
        predictor,
        measured,
        predictions,
        trial_events,
        marks,
        refused,
        window,
        [text for text in warnings if text],
        budget,
        suspect,
        by_motion,
        lambda: provenance(
            session,
            predictor.action,
            predictor.action_hash,
            predictor.version,
            tolerance,
            window,
            {m.number: m.seal for m in measured},
            now().strftime("%Y-%m-%dT%H:%M:%SZ"),
        ),
    )


def _reasons(refused: dict[int, str]) -> str:
    """Why trials are not used, in one line however many they are."""
    numbers: dict[str, list[int]] = {}
    for number, reason in refused.items():
        numbers.setdefault(reason, []).append(number)
    lines = []
    for reason, found in numbers.items():
        named = ", ".join(map(str, found[:MOST_NAMED]))
        more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
        lines.append(f"trial{'s' if found[1:] else ''} {named}{more}: {reason}")
    return "; ".join(lines) or "it has no trials"


def _predict_all(
    predictor: Predictor,
    measured: list[Measurement],
    refused: dict[int, str],
    progress: Callable[[str], None] | None,
) -> dict[int, TrialPrediction]:
    """Predictions by trial; a trial the model cannot predict is put among the refused."""
    from model.errors import ModelError

    found = {}
    for m in measured:
        if progress is not None:
            progress(f"predicting trial {m.number}")
        try:
            found[m.number] = predictor.trial(m)
        except ModelError as error:
            refused[m.number] = f"not predicted: {error}"
    return found


def _assemble(
    session: Any,
    predictor: Predictor,
    measured: list[Measurement],
    predictions: dict[int, TrialPrediction],
    trial_events: dict[int, dict[str, Event]],
    marks: dict[int, list[Lift]],
    refused: dict[int, str],
    window: Window,
    warnings: list[str],
    budget: bool,
    suspect: bool,
    by_motion: bool,
    origin: Callable[[], dict[str, Any]],
) -> ValidationResult:
    """Build every table of the result."""
    model_events = {number: p.events for number, p in predictions.items()}
    traces = {
        m.number: trace_table(m, predictions[m.number].model, predictions[m.number].rivals, marks[m.number])
        for m in measured
    }
    speeds = {m.number: speed_table(m, trial_events[m.number]) for m in measured}
    traces = {number: frame.join(speeds[number].drop(columns="time_s")) for number, frame in traces.items()}
    if predictor.session is not None:
        unkept = {keep_speeds(predictor.session, m, speeds[m.number]) for m in measured}
        warnings += sorted(unkept - {""})[:1]
    film = {m.number: film_trace_table(m, predictions[m.number].model, predictions[m.number].rivals) for m in measured}
    filmed = {number: frame for number, frame in film.items() if frame is not None}
    uncertainty = uncertainty_table(measured, filmed)
    u_sample = uncertainty.groupby("channel")["u_rad"].mean().to_dict()
    impact = {
        number: events["string_impact"].value
        for number, events in trial_events.items()
        if events["string_impact"].status != "absent"
    }
    base = measured[0].time_s[window.mask(measured[0].time_s)]
    findings = find_faults(predictor, measured, predictions, marks, trial_events, base, traces, suspect)
    without = left_out(findings)
    warnings = [f.text for f in findings] + with_and_without(base, traces, findings, without) + warnings
    u_scale = uncertainty.groupby("channel")["scale_relative_u"].mean().fillna(0.0).to_dict()
    channels, spread = channel_tables(traces, filmed, u_sample, window, without, u_scale)
    u_encoder = {m.number: m.u_rad for m in measured}
    scores = score_table(traces, filmed, u_encoder, channels, window, impact, predictor.kept)
    card = scorecard(scores, traces, filmed, window, impact, predictor.kept, without)
    channels = with_scores(channels, scores, card, without)
    summary = event_summary(counting_events(trial_events, without), model_events)
    by_number = {m.number: m for m in measured}
    rows = [
        trial_row(n, by_number.get(n), refused.get(n, ""), predictions[n].model if n in predictions else None)
        for n in sorted({*by_number, *refused})
    ]
    force_table, force_trace, note = (
        compare_by_motion(predictor, measured, marks, window, findings) if by_motion else NOTHING
    )
    budget_table = _budget(predictor, measured, summary) if budget else pd.DataFrame(columns=COLUMNS)
    warnings += [*([note] if note else []), *predictor.kept.save()]
    name = getattr(session.info, "name", "") or session.path.name
    action_name = str(getattr(predictor.action, "name", "unknown"))
    return ValidationResult(
        session_name=name,
        action_name=action_name,
        verdict_lines=verdict_lines(name, action_name, channels, summary, len(measured), findings),
        warnings=warnings,
        window=window,
        trials=pd.DataFrame(rows),
        scores=scores,
        scorecard=card,
        marked=mark_table(marks),
        findings=finding_table(findings),
        channels=channels,
        events=event_table(trial_events, model_events),
        event_summary=summary,
        event_repeatability=event_repeatability(counting_events(trial_events, without)),
        budget=budget_table,
        uncertainty=uncertainty,
        spread=spread,
        traces=traces,
        film_traces=filmed,
        motion_driven=force_table,
        motion_trace=force_trace,
        provenance=origin() | {"reused": predictor.kept.summary()},
    )


def _budget(predictor: Predictor, measured: list[Measurement], summary: pd.DataFrame) -> pd.DataFrame:
    """Budget of the events; the runs share the processors, a simulation holds no lock."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return event_budget(predictor, representative(measured), summary, run=pool.map)


def load_model(action: Any) -> Any:
    """The action itself, or the one of a name or path."""
    if not isinstance(action, str | Path):
        return action
    import model

    return model.load_action(action)
