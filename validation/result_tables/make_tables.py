"""All tables of a session: the sixth stage of a comparison; SI and rad."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pandas as pd

from model.errors import ModelError
from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS
from validation.events.key_lift import KeyLift, lifted_samples
from validation.events.session_events import SessionEvents
from validation.findings.find_faults import SessionFindings
from validation.findings.finding import counting_events, sound_trials
from validation.measurement.measure_session import representative
from validation.measurement.trial import MeasuredTrial
from validation.options import ComparisonOptions
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.motion_driven import COLUMNS as MOTION_COLUMNS
from validation.prediction.motion_driven import motion_driven, motion_row
from validation.prediction.predict_session import PredictedSession
from validation.result import SessionTables
from validation.result_tables.channels import (
    NO_CEILING,
    channel_tables,
    scorecard,
    with_repeatability,
    with_scores,
)
from validation.result_tables.events import event_summary, event_table
from validation.result_tables.further import FURTHER
from validation.scores.perfect_model import perfect_scores
from validation.scores.score_session import ScoredSession
from validation.statistics.repeatability import event_repeatability, few_trials_warning
from validation.statistics.rivals import Rivals
from validation.verdict.verdict import Verdict

LIFT_COLUMNS = ["trial", "channel", "start_s", "end_s", "largest_at_s", "gap_m", "lift_m", "rail_pull_n", "reason"]


def lift_table(lifts: Mapping[int, Sequence[KeyLift]]) -> pd.DataFrame:
    """Every interval left out of the scores."""
    rows = [{"trial": number, "channel": "key", **asdict(lift)} for number, found in lifts.items() for lift in found]
    return pd.DataFrame(rows, columns=LIFT_COLUMNS)


def uncertainty_table(measurements: Sequence[MeasuredTrial], film: dict[int, pd.DataFrame]) -> pd.DataFrame:
    """Stated standard uncertainty of one sample of every channel; for film the median over frames."""
    rows: list[tuple[object, ...]] = []
    for m in measurements:
        steps = m.resolution_rad / np.sqrt(12)
        for name, *values in zip(ENCODER_CHANNELS, steps, m.u_rad, m.scale_relative_u, strict=True):
            rows.append((m.number, name, "encoder", *map(float, values)))
        for name in FILM_CHANNELS if m.number in film else ():
            u = film[m.number][f"{name}_u_rad"].to_numpy()
            u = u[np.isfinite(u)]
            rows.append((m.number, name, "film", np.nan, float(np.median(u)) if u.size else np.nan, np.nan))
    return pd.DataFrame(rows, columns=["trial", "channel", "source", "quantisation_rad", "u_rad", "scale_relative_u"])


def trial_table(predicted: PredictedSession) -> pd.DataFrame:
    """Every trial of the session, used or not."""
    measured = {m.number: m for m in predicted.trials}
    rows = []
    for number in sorted({*measured, *predicted.refused}):
        if number in measured:
            rows.append(_used(measured[number], predicted.predictions[number].model.reused))
        else:
            rows.append({"trial": number, "used": False, "reason": predicted.refused[number]})
    return pd.DataFrame(rows)


def _used(m: MeasuredTrial, reused: bool) -> dict[str, object]:
    hum = m.force.hum
    row: dict[str, object] = {
        "trial": m.number,
        "used": True,
        "reason": "",
        "quiet_s": m.quiet.length_s,
        "onset_s": m.quiet.onset_s,
        "offset_n": hum.offset_n,
        "u_offset_n": hum.u_offset_n,
        "hum_hz": hum.frequency_hz,
        "hum_searched": hum.frequency_searched,
        "hum_accepted": hum.accepted,
        "hum_reason": hum.reason,
    }
    row |= {f"hum_{k}_n": a for k, a in enumerate(hum.amplitude_n, start=1)}
    row |= {f"hum_{k}_phase_rad": a for k, a in enumerate(hum.phase_rad, start=1)}
    return row | {
        "noise_n": m.force.noise_n,
        "preload_n": m.force.preload_n,
        "u_preload_n": m.force.channel.u_preload_n,
        "group_delay_s": m.force.channel.group_delay_s,
        "peak_force_n": float(m.force.force_n.max()),
        "filmed": m.film is not None,
        "reused": reused,
        "seal": m.seal,
        "notes": "; ".join(m.notes),
    }


FINDING_COLUMNS = ["kind", "trial", "channel", "value", "limit", "text"]
CHANGE_COLUMNS = ["set", "changes", "cause", "change", "u", "unit", "log_odds", "left", "profile", "first", "last"]


def make_tables(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    findings: SessionFindings,
    verdict: Verdict,
    tested: ModelUnderTest,
    options: ComparisonOptions,
    changes: Sequence[Mapping[str, Any]] = (),
) -> SessionTables:
    """Make every table, with the further runs that were asked for, and save what was computed for the next run.

    ``changes`` are rows of `CHANGE_COLUMNS`: what explains the model's difference.
    """
    traces, without = scored.traces, findings.left_out
    uncertainty = uncertainty_table(predicted.trials, traces.film)
    u_sample = uncertainty.groupby("channel")["u_rad"].mean().to_dict()
    ceiling = NO_CEILING
    if options.budget:
        options.say("scores of a perfect model")
        ceiling = perfect_scores(predicted.trials, traces, tested, without, paired=options.paired)
    channels, spread = channel_tables(traces, u_sample, without, verdict, findings.kinds)
    card = scorecard(scored.scores, traces, ceiling, without)
    counting = counting_events(events.trial, without)
    summary = event_summary(counting, events.model)
    rows, trace, notes = _by_motion(predicted, events, findings, tested) if options.by_motion else ([], None, [])
    sound = replace(predicted, trials=tuple(sound_trials(predicted.trials, findings.faults)) or predicted.trials)
    further = {name: make(sound, tested, options) for name, make in FURTHER.items()} if options.further else {}
    warnings = [*_warnings(predicted, findings), *scored.notes, *notes, *tested.store.save()]
    return SessionTables(
        warnings=warnings,
        window=events.window,
        trials=trial_table(predicted),
        scores=with_repeatability(scored.scores, channels, without),
        scorecard=card,
        marked=lift_table({n: found for n, found in events.lifts.items() if n not in findings.trials_without_rest}),
        findings=pd.DataFrame([asdict(f) for f in findings.faults], columns=FINDING_COLUMNS),
        compatible_changes=pd.DataFrame(changes, columns=CHANGE_COLUMNS),
        channels=with_scores(channels, scored.scores, card, without),
        quantities=verdict.quantities,
        events=event_table(events.trial, events.model),
        event_summary=summary,
        event_repeatability=event_repeatability(counting, findings.kinds),
        uncertainty=uncertainty,
        rivals=pd.DataFrame(),
        spread=spread,
        traces=traces.encoder,
        film_traces=traces.film,
        motion_driven=pd.DataFrame(rows, columns=MOTION_COLUMNS),
        motion_trace=trace,
        judgement=dict(verdict.facts),
        nuisance=ceiling.nuisance,
        further=further,
    )


def with_rivals(tables: SessionTables, rivals: Rivals) -> SessionTables:
    """The same with the rivals' errors, each channel's skill against the best of them, and where each trial lies."""
    skill = [rivals.skill.get(str(channel)) for channel in tables.channels["channel"]]
    columns = {
        "best_rival": [one.rival if one else "" for one in skill],
        "skill": [one.skill if one else np.nan for one in skill],
        "skill_low": [one.low if one else np.nan for one in skill],
        "skill_high": [one.high if one else np.nan for one in skill],
    }
    places = tables.trials[["trial"]].merge(rivals.places, on="trial", how="left").drop(columns="trial")
    places["outside"] = places["outside"].astype(object).where(places["outside"].notna(), None)
    trials = pd.concat([tables.trials, places.fillna({"why_outside": ""})], axis=1)
    return replace(tables, trials=trials, channels=tables.channels.assign(**columns), rivals=rivals.errors)


def _warnings(predicted: PredictedSession, findings: SessionFindings) -> Iterator[str]:
    """What a reader must know before using the numbers, faults first."""
    yield from (f.text for f in findings.faults)
    few = few_trials_warning(len(predicted.trials))
    if few:
        yield few
    for m in (m for m in predicted.trials if m.number not in findings.trials_without_rest):
        notes = (*m.notes, *predicted.predictions[m.number].notes)
        yield from (f"trial {m.number}: {text}" for text in notes)
    yield from (f"trial {number} is not used: {reason}" for number, reason in predicted.refused.items())


def _by_motion(
    predicted: PredictedSession, events: SessionEvents, findings: SessionFindings, tested: ModelUnderTest
) -> tuple[list[dict[str, Any]], pd.DataFrame | None, list[str]]:
    """Motion-driven comparison of the sound trial of median peak force: its row, the trace, and why there is none."""
    sound = sound_trials(predicted.trials, findings.faults)
    if not sound:
        return [], None, []
    m = representative(sound)
    at = m.time_s[events.window.mask(m.time_s)]
    try:
        trace = motion_driven(tested, m, at, lifted_samples(at, events.lifts[m.number]))
    except ModelError as error:
        return [], None, [f"trial {m.number}: not driven by its motion: {error}"]
    return [motion_row(m.number, trace, m.force.channel.gain_relative_u)], trace, []
