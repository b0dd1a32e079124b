"""All tables of a session: the sixth stage of a comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import pandas as pd

from model.errors import ModelError
from validation.events.key_lift import lifted_samples
from validation.events.session import SessionEvents
from validation.findings.finding import are_faulty, distorted_trials
from validation.findings.pooling import counting_events, sound_trials
from validation.findings.session import SessionFindings
from validation.measurement.session import representative
from validation.options import ComparisonOptions
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.motion_driven import COLUMNS as MOTION_COLUMNS
from validation.prediction.motion_driven import motion_driven, motion_row
from validation.prediction.session import PredictedSession
from validation.result import SessionTables
from validation.scores.perfect_model import perfect_scores
from validation.scores.session import ScoredSession
from validation.statistics.difference_draws import difference_draws
from validation.statistics.event_budget import COLUMNS as BUDGET_COLUMNS
from validation.statistics.event_budget import event_budget
from validation.statistics.paired_difference import Judgement, judge
from validation.statistics.repeatability import event_repeatability, few_trials_warning
from validation.tables.channels import channel_tables
from validation.tables.events import event_summary, event_table
from validation.tables.phases import phase_table
from validation.tables.scorecard import NO_CEILING, scorecard, with_repeatability, with_scores
from validation.tables.trials import lift_table, trial_table, uncertainty_table

FINDING_COLUMNS = ["kind", "trial", "channel", "value", "limit", "text"]
CHANGE_COLUMNS = ["set", "changes", "cause", "change", "u", "unit", "log_odds", "left"]


@dataclass(frozen=True)
class MotionComparison:
    """Force predicted from the key's motion: the table's row, the trace over time, and why there is none."""

    table: pd.DataFrame
    trace: pd.DataFrame | None = None
    notes: tuple[str, ...] = ()


NO_MOTION = MotionComparison(pd.DataFrame(columns=MOTION_COLUMNS))


def make_tables(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    findings: SessionFindings,
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
    judgement, ceiling = Judgement(), NO_CEILING
    if options.budget:
        options.say("uncertainty of the difference: draws of all inputs")
        judgement = judge(difference_draws(predicted.trials, traces, tested, without))
        ceiling = perfect_scores(predicted.trials, traces, tested, without, paired=options.paired)
    channels, spread = channel_tables(traces, u_sample, without, judgement, findings.kinds)
    card = scorecard(scored.scores, traces, ceiling, without)
    counting = counting_events(events.trial, without)
    summary = event_summary(counting, events.model)
    motion = _by_motion(predicted, events, findings, tested) if options.by_motion else NO_MOTION
    budget = pd.DataFrame(columns=BUDGET_COLUMNS)
    if options.budget:
        options.say("uncertainty budget of the events")
        budget = event_budget(tested, representative(predicted.trials), summary)
    warnings = [*_warnings(predicted, findings), *scored.notes, *motion.notes, *tested.store.save()]
    return SessionTables(
        warnings=warnings,
        window=events.window,
        trials=trial_table(predicted),
        scores=with_repeatability(scored.scores, channels, without),
        scorecard=card,
        marked=lift_table(events.lifts),
        findings=pd.DataFrame([asdict(f) for f in findings.faults], columns=FINDING_COLUMNS),
        compatible_changes=pd.DataFrame(changes, columns=CHANGE_COLUMNS),
        channels=with_scores(channels, scored.scores, card, without),
        phases=phase_table(_in_verdict(judgement, findings), summary, channels, events.window),
        events=event_table(events.trial, events.model),
        event_summary=summary,
        event_repeatability=event_repeatability(counting, findings.kinds),
        budget=budget,
        uncertainty=uncertainty,
        spread=spread,
        traces=traces.encoder,
        film_traces=traces.film,
        motion_driven=motion.table,
        motion_trace=motion.trace,
        judgement=judgement.facts(),
        nuisance=ceiling.nuisance,
    )


def _in_verdict(judgement: Judgement, findings: SessionFindings) -> Judgement:
    """The judgement as the verdict takes it: faulty trials judge nothing."""
    distorted = distorted_trials(findings.faults)
    return Judgement(why=are_faulty(distorted)) if distorted else judgement


def _warnings(predicted: PredictedSession, findings: SessionFindings) -> Iterator[str]:
    """What a reader must know before using the numbers, faults first."""
    yield from (f.text for f in findings.faults)
    yield from findings.notes
    few = few_trials_warning(len(predicted.trials))
    if few:
        yield few
    for m in predicted.trials:
        notes = (*m.notes, *predicted.predictions[m.number].notes)
        yield from (f"trial {m.number}: {text}" for text in notes)
    yield from (f"trial {number} is not used: {reason}" for number, reason in predicted.refused.items())


def _by_motion(
    predicted: PredictedSession, events: SessionEvents, findings: SessionFindings, tested: ModelUnderTest
) -> MotionComparison:
    """Motion-driven comparison of the sound trial of median peak force."""
    sound = sound_trials(predicted.trials, findings.faults)
    if not sound:
        return NO_MOTION
    m = representative(sound)
    at = m.time_s[events.window.mask(m.time_s)]
    try:
        trace = motion_driven(tested, m, at, lifted_samples(at, events.lifts[m.number]))
    except ModelError as error:
        return replace(NO_MOTION, notes=(f"trial {m.number}: not driven by its motion: {error}",))
    row = motion_row(m.number, trace, m.force.channel.gain_relative_u)
    return MotionComparison(pd.DataFrame([row], columns=MOTION_COLUMNS), trace)
