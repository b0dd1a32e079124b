"""Traces of all trials and every score of every curve: the fourth stage of a comparison.

Conventions: SI and rad; differences are model − trial; nothing is aligned; samples in which the key lifts are left out
and counted; what cannot be stated is NaN.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.cache.result_store import ResultStore
from validation.conventions import CHANNEL_GROUPS, FILM_CHANNELS, WORKERS, Array, rms
from validation.events.session_events import SessionEvents
from validation.prediction.predict_session import PredictedSession
from validation.scores.curve_scores import SCORES, compute_scores, score_curve
from validation.scores.iso18571_guards import list_guard_notes
from validation.scores.traces import (
    INFIX,
    SessionTraces,
    make_film_trace_table,
    make_speed_table,
    make_trace_table,
    select_scored_angles,
)


@dataclass(frozen=True)
class ScoredSession:
    """Traces of a session, and the scores of each curve: trial, channel, source, every score, u_rms_rad."""

    traces: SessionTraces
    scores: pd.DataFrame


def score_session(predicted: PredictedSession, events: SessionEvents, store: ResultStore) -> ScoredSession:
    """Put together the traces of every trial and score every curve inside the evaluation window."""
    traces = trace_session(predicted, events)
    channels = {m.number: (*m.channels, *FILM_CHANNELS) for m in predicted.trials}
    scores = score_curves(traces, {m.number: m.u_rad for m in predicted.trials}, channels, store)
    return ScoredSession(traces, scores)


def trace_session(predicted: PredictedSession, events: SessionEvents) -> SessionTraces:
    """Tables of measured and predicted curves of every trial, by number, on encoder and film times, with the evaluation
    window and the times of the string impacts."""
    encoder, film = {}, {}
    for m in predicted.trials:
        p = predicted.predictions[m.number]
        speeds = make_speed_table(m, events.trial[m.number])
        encoder[m.number] = make_trace_table(m, p, events.lifts[m.number], speeds)
        filmed = make_film_trace_table(m, p)
        if filmed is not None:
            film[m.number] = filmed
    return SessionTraces(encoder, film, events.window, events.impact_s)


def score_curves(
    traces: SessionTraces, u_encoder: dict[int, Array], channels: dict[int, tuple[str, ...]], store: ResultStore
) -> pd.DataFrame:
    """Table with a row for each trial and channel compared: scores inside the window of the model and its rivals;
    ``u_encoder``: u of key, whippen and hammer, rad, ``channels``: names compared, both by trial number. Kept in
    ``store``."""
    jobs = [
        (number, name, i, source, frame)
        for names, source in CHANNEL_GROUPS
        for number, frame in traces.select_source(source).items()
        for i, name in enumerate(names)
        if name in channels[number]
    ]

    def row(job: tuple[int, str, int, str, pd.DataFrame]) -> dict[str, object]:
        number, name, i, source, whole = job
        known = {"time_s", f"{name}_marked", f"{name}_u_rad", f"{name}_measured_rad", f"{name}_predicted_rad"}
        known |= {f"{name}_{infix}_rad" for infix in INFIX.values()}
        own = whole[[column for column in whole.columns if column in known]]
        frame = own[traces.window.mask(whole["time_s"].to_numpy())]
        u = float(u_encoder[number][i]) if source == "encoder" else rms(frame[f"{name}_u_rad"].to_numpy())
        time, trial, model = (
            frame["time_s"].to_numpy(),
            select_scored_angles(frame, name),
            frame[f"{name}_predicted_rad"].to_numpy(),
        )
        early = time < traces.impact_s.get(number, np.inf)
        columns = {label: f"{name}_{infix}_rad" for label, infix in INFIX.items()}
        rivals = {label: frame[column].to_numpy() for label, column in columns.items() if column in frame}
        scores = store.value(
            "curve scores",
            (time, trial, model, rivals, early),
            lambda: _score_with_rivals(time, trial, model, rivals, early),
        )
        return {"trial": number, "channel": name, "source": source, **scores, "u_rms_rad": u}

    with ThreadPoolExecutor(WORKERS) as pool:
        return pd.DataFrame(list(pool.map(row, jobs)))


def _score_with_rivals(
    time: Array, trial: Array, model: Array, rivals: dict[str, Array], early: NDArray[np.bool_]
) -> dict[str, object]:
    """Scores by name of the curve ``model`` against ``trial``, (n,) rad, and of each of the ``rivals`` (n,), whose
    names lead theirs, with notes on the ISO-style score; ``early``: mask of the samples before the impact."""
    whole = score_curve(time, trial, model)
    scores = compute_scores(time, trial, model, early)
    beside = ("bias_rad", "scatter_rad", "largest_rad", "largest_at_s", "n", "n_lost")
    out: dict[str, object] = {**scores, **{name: whole[name] for name in beside}}
    out["iso_guards"] = "; ".join(list_guard_notes(time, trial, model, scores))
    for label in INFIX:
        rival = compute_scores(time, trial, rivals[label], early) if label in rivals else {}
        out |= {f"{label}_{score}": rival.get(score, np.nan) for score in SCORES}
    return out
