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
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from validation.channel_tables import channel_tables
from validation.curve_tables import film_trace_table, on_common_base, trace_table
from validation.errors import InputError, TrialError
from validation.event import Event
from validation.event_tables import event_summary, event_table
from validation.events import find_events
from validation.geometry import ActionGeometry, Array, geometry_of
from validation.measurement import ENCODER_CHANNELS, U_REST_LEVEL_M, Measurement, measure
from validation.motion import motion_of
from validation.prediction import Prediction, action_sha256, predict_trial
from validation.provenance import model_version, provenance
from validation.repeatability import STANDS_OUT, distance_ratios, event_repeatability, few_trials_warning
from validation.result import ValidationResult
from validation.score_tables import score_table, scorecard, with_scores
from validation.trial_tables import trial_row, uncertainty_table
from validation.verdict import verdict_lines
from validation.window import common_window

USABLE_STATUS = ("complete", "not at rest")


@dataclass
class _Load:
    """Rest state and geometry of the action under one preload."""

    rest: Any
    geometry: ActionGeometry


def compare_session(
    session: Any,
    action: Any = "hirschkorn2004",
    *,
    tolerance: float = 1e-5,
    predict: Callable[..., Any] | None = None,
    rest_state: Callable[..., Any] | None = None,
    geometry: Callable[[Any, Any], ActionGeometry] | None = None,
    keep_predictions: bool = True,
    u_rest_level_m: float = U_REST_LEVEL_M,
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
        Stand-ins for ``model.simulate``, ``model.rest_state`` and `validation.geometry.geometry_of`.
    keep_predictions : bool
        Keep predictions in the session's ``derived/prediction`` and reuse them when their inputs have not
        changed.
    u_rest_level_m : float
        Standard uncertainty of hammer height and key dip at rest on the bench.
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
    action = _load(action)
    if predict is None or rest_state is None:
        import model

        predict = predict or model.simulate
        rest_state = rest_state or model.rest_state
    geometry = geometry or geometry_of
    action_hash, version = action_sha256(action), model_version(predict)
    loads: dict[float, _Load] = {}

    def load_of(preload_n: float) -> _Load:
        if preload_n not in loads:
            rest = rest_state(action, force_n=preload_n)
            loads[preload_n] = _Load(rest, geometry(action, rest.angle_rad))
        return loads[preload_n]

    measured, refused = _measure_all(session, load_of, u_rest_level_m)
    if not measured:
        reasons = "; ".join(f"trial {number}: {reason}" for number, reason in refused.items()) or "it has no trials"
        raise InputError(f"{session.path}: no usable trial ({reasons}); record or accept at least one")

    trial_events = {m.number: find_events(m.motion, m.quiet.stop) for m in measured}
    window = common_window(measured, trial_events)

    predictions: dict[int, Prediction] = {}
    model_events: dict[int, dict[str, Event]] = {}
    warnings = [few_trials_warning(len(measured))]
    for m in measured:
        load = load_of(m.force.preload_n)
        if progress is not None:
            progress(f"predicting trial {m.number}")
        p, note = predict_trial(
            m,
            action,
            load.rest,
            predict,
            tolerance=tolerance,
            action_hash=action_hash,
            model_version=version,
            session=session if keep_predictions else None,
        )
        predictions[m.number] = p
        model_events[m.number] = _predicted_events(m, p, load.geometry, tolerance)
        warnings += [f"trial {m.number}: {text}" for text in (*m.notes, note) if text]
    warnings += [f"trial {number} is not used: {reason}" for number, reason in refused.items()]
    return _assemble(
        session,
        action,
        measured,
        predictions,
        trial_events,
        model_events,
        refused,
        window,
        [text for text in warnings if text],
        lambda: provenance(
            session,
            action,
            action_hash,
            version,
            tolerance,
            window,
            {m.number: m.seal for m in measured},
            now().strftime("%Y-%m-%dT%H:%M:%SZ"),
        ),
    )


def _assemble(
    session: Any,
    action: Any,
    measured: list[Measurement],
    predictions: dict[int, Prediction],
    trial_events: dict[int, dict[str, Event]],
    model_events: dict[int, dict[str, Event]],
    refused: dict[int, str],
    window: Any,
    warnings: list[str],
    origin: Callable[[], dict[str, Any]],
) -> ValidationResult:
    """Build every table of the result."""
    traces = {m.number: trace_table(m, predictions[m.number]) for m in measured}
    film = {m.number: film_trace_table(m, predictions[m.number]) for m in measured}
    filmed = {number: frame for number, frame in film.items() if frame is not None}
    uncertainty = uncertainty_table(measured, filmed)
    u_sample = uncertainty.groupby("channel")["u_rad"].mean().to_dict()
    channels, spread = channel_tables(traces, filmed, u_sample, window)
    impact = {
        number: events["string_impact"].value
        for number, events in trial_events.items()
        if events["string_impact"].status != "absent"
    }
    base = spread["time_s"].to_numpy()
    warnings = warnings + _outlying(base, traces)
    u_encoder = {m.number: m.u_rad for m in measured}
    scores = score_table(traces, filmed, u_encoder, channels, window, impact)
    card = scorecard(scores, traces, filmed, window, impact)
    channels = with_scores(channels, scores, card)
    summary = event_summary(trial_events, model_events)
    by_number = {m.number: m for m in measured}
    rows = [
        trial_row(n, by_number.get(n), refused.get(n, ""), predictions.get(n)) for n in sorted({*by_number, *refused})
    ]
    name = getattr(session.info, "name", "") or session.path.name
    action_name = str(getattr(action, "name", "unknown"))
    return ValidationResult(
        session_name=name,
        action_name=action_name,
        verdict_lines=verdict_lines(name, action_name, channels, summary, len(measured)),
        warnings=warnings,
        window=window,
        trials=pd.DataFrame(rows),
        scores=scores,
        scorecard=card,
        channels=channels,
        events=event_table(trial_events, model_events),
        event_summary=summary,
        event_repeatability=event_repeatability(trial_events),
        uncertainty=uncertainty,
        spread=spread,
        traces=traces,
        film_traces=filmed,
        provenance=origin(),
    )


def _outlying(base: Array, traces: dict[int, pd.DataFrame]) -> list[str]:
    """Trials that stand out from the others in a channel, said and kept."""
    texts = []
    for channel in ENCODER_CHANNELS:
        ratios = distance_ratios(on_common_base(base, traces, f"{channel}_measured_rad"))
        texts += [
            f"trial {number} stands out in {channel}: {ratio:.1f} times as far from the others as is usual; it is kept"
            for number, ratio in zip(traces, ratios, strict=True)
            if ratio > STANDS_OUT
        ]
    return texts


def open_session(session: Any) -> Any:
    """The session itself, or the session at a path."""
    if not isinstance(session, str | Path):
        return session
    from rig.session import Session

    return Session.open(session)


def _load(action: Any) -> Any:
    if not isinstance(action, str | Path):
        return action
    import model

    return model.load_action(action)


def _measure_all(
    session: Any, load_of: Callable[[float], _Load], u_rest_level_m: float
) -> tuple[list[Measurement], dict[int, str]]:
    """Usable trials, and the reason of each that is not."""
    from rig.errors import RigError

    measured, refused = [], {}
    for trial in session.trials:
        if trial.rejected is not None:
            refused[trial.number] = f"rejected: {trial.rejected}"
            continue
        try:
            data = trial.read()
            if data.status not in USABLE_STATUS:
                raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
            derived = session.read_derived("angles", trial.number)
            measured.append(
                measure(
                    data,
                    None if derived is None else derived[0],
                    load_of(data.force_info.preload_n).geometry,
                    u_rest_level_m=u_rest_level_m,
                    seal=trial.sha256,
                )
            )
        except (RigError, TrialError) as error:
            refused[trial.number] = str(error)
    return measured, refused


def _predicted_events(m: Measurement, p: Prediction, geometry: ActionGeometry, tolerance: float) -> dict[str, Event]:
    """Events of a prediction by the same definitions; a sample is as uncertain as the tolerance asked for."""
    change = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    motion = motion_of(geometry, p.time_s, change, np.full(3, tolerance), u_zero_rad=np.full(3, tolerance))
    return find_events(motion, m.quiet.stop)
