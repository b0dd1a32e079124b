"""Model against experiment, trial by trial: the straight line from a session to its `ValidationResult`.

Conventions: each trial's own corrected force drives the model from rest, or the measured motion of its key where there
is none or that is asked for; model and trial are never aligned; the evaluation window is fixed from measured events
before anything is scored. A trial that cannot be used is listed with its reason and the rest goes on.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

import model
from rig.session import Session
from rig.session.info import MAPPING
from validation.cache.result_store import ResultStore
from validation.events.definitions import EVENTS
from validation.events.session_events import Window, find_session_events
from validation.findings.find_faults import SessionFindings, find_faults
from validation.findings.finding import CHANGED_CONDITION, OTHER_PROGRAM, RIG, select_sound_trials
from validation.infer.causes.explain import Explained, explain_difference
from validation.infer.hypotheses import STEP
from validation.measurement.measure_session import OTHER_CONDITION, measure_session, select_representative
from validation.measurement.trial import MeasuredTrial
from validation.options import ComparisonOptions
from validation.part_names import name_parts
from validation.pipeline.advice import what_to_do
from validation.pipeline.verdict import fitted_trials, identified_warnings, prediction_lines, verdict_lines
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession, predict_session
from validation.result import AGREES, CANNOT_TELL, ValidationResult
from validation.scores.score_session import score_session
from validation.statistics.repeatability import few_trials_warning
from validation.statistics.rivals import compare_rivals
from validation.tables.channels import summary
from validation.tables.comparison import Comparison
from validation.verdict.conditions import separate_conditions
from validation.verdict.error_draws import TrialErrors, errors_of_trials, select_usable_errors, session_errors
from validation.verdict.observed import observed_text
from validation.verdict.quantities import relevance_limits
from validation.verdict.verdict import Verdict, judge_model, undecided_verdict

SOFTWARE = ("piano-action-rig", "numpy", "scipy", "pandas", "matplotlib", "numba", "h5py")


def versions() -> dict[str, str]:
    """Versions, as text, of Python, the platform and the packages that shape the numbers, by name; ``unknown`` where a
    package is not installed."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in SOFTWARE:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found


def provenance(
    session: Session, tested: ModelUnderTest, trials: Sequence[MeasuredTrial], window: Window, now: datetime
) -> dict[str, Any]:
    """Plain values by name that reproduce a report, ready for JSON: hashes of trials and model, versions, tolerance,
    window, what was done to the force; ``now``: date of the report, UTC.

    Conventions: SHA-256 in hexadecimal; times in UTC; a version that cannot be found is the word ``unknown``.
    """
    info, action = session.info, tested.action
    return {
        "created_utc": now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "session": {
            "name": info.name or session.path.name,
            "operator": info.operator,
            "created_utc": info.created_utc,
            "simulated": info.simulated,
            "rig_sha256": info.rig.sha256,
            "profile": info.profile.name,
            "profile_sha256": info.profile.sha256,
        },
        "trials_sha256": {f"trial_{m.number:04d}": m.seal for m in trials},
        "action": {
            "name": action.name,
            "origin": Path(action.origin).name,
            "values_sha256": tested.action_hash,
            "changed": {k: float(v) for k, v in action.changed.items()},
            "fitted_to": [f"trial_{number:04d}" for number in fitted_trials(action, trials)],
        },
        "model": tested.version,
        "tolerance_rad": tested.tolerance,
        "window": {
            "start_s": window.start_s,
            "end_s": window.end_s,
            "start_rule": window.start_rule,
            "end_rule": window.end_rule,
        },
        "driven_by": "key" if any(m.driven_by_key for m in trials) else "force",
        "force": "offset and mains hum fitted on the quiet baseline and subtracted, declared preload added; channel "
        "delay taken off the time axis; never smoothed",
        "alignment": "none: model and trial share the DAQ clock",
        "event_definitions": {name: kind.definition for name, kind in EVENTS.items()},
        "versions": versions(),
        "reused": tested.store.summary(),
    }


FINER = "; the verdict's test of the primary quantities does not resolve it"


@threadpool_limits.wrap(limits=1, user_api="blas")
def compare_by(session: Session, action: model.Action, chosen: ComparisonOptions) -> ValidationResult:
    """Compare a session with an action under ``chosen`` options: measure, predict, score, find faults, judge; results
    are kept with the session where the options say so."""
    tested = model_under_test(session, action, chosen)
    measured = measure_session(
        session, tested.geometry_at, chosen.u_rest_level_m, chosen.condition, chosen.by_motion, tested.calibration
    )
    predicted = predict_session(measured, tested, chosen.say)
    events = find_session_events(predicted, tested)
    scored = score_session(predicted, events, tested.store)
    errors = errors_of_trials(predicted, scored.traces, events, tested)
    findings = find_faults(predicted, events, scored, tested, errors, relevance_limits(chosen.relevant))
    found = select_usable_errors(errors, findings.left_out)
    if text := observed_text(found):
        chosen.say(text)
    verdict = _verdict(predicted, found, findings, tested, chosen)
    shown = bool(verdict.facts.get("rejected")) or any(f.kind in (ODD, CHANGED_CONDITION) for f in findings.faults)
    by_key = any(m.driven_by_key for m in predicted.trials)  # causes are told by the force
    asked = chosen.wants_causes(shown) and not by_key
    if not asked:
        chosen.say(f"verdict: {verdict.outcome}")  # nothing that follows changes it
    explained = _explain(predicted, findings, tested, chosen) if asked else Explained()
    if explained.findings:
        before = findings
        findings = replace_explained(before, explained, sorted(found))
        if (findings.left_out, findings.conditions) != (before.left_out, before.conditions):
            found = select_usable_errors(errors, findings.left_out)
            verdict = _verdict(predicted, found, findings, tested, chosen)
    findings, verdict = name_all_parts(findings, verdict, action)
    changes = [asdict(change) | {"part": name_parts(change.cause, action)} for change in explained.changes]
    rivals = compare_rivals(predicted, scored, tested, findings.left_out)
    made = Comparison(predicted, events, scored, findings, verdict, rivals, tested, chosen, changes)
    tables = made.tables
    warnings = [*_warnings(predicted, findings), *made.motion[2], *tested.store.save()]
    warnings += identified_warnings(action)
    name = session.info.name or session.path.name
    if explained.sentence:
        finer = verdict.outcome in (AGREES, CANNOT_TELL) and not explained.nothing
        warnings.append(name_parts(explained.sentence, action) + (FINER if finer else ""))
    source = OTHER_PROGRAM if session.info.rig.copy_name == MAPPING else RIG
    said = what_to_do(findings.faults, explained, rivals, verdict.outcome, source)
    advice = tuple(name_parts(text, action) for text in said)
    head, *rest = verdict_lines(name, action.name, tables, verdict, findings.faults, rivals.nearer, by_key)
    judgement = dict(verdict.facts)
    return ValidationResult(
        session_name=name,
        action_name=action.name,
        verdict_lines=[
            head,
            *([f"What to do: {' '.join(advice)}"] if advice else []),
            *prediction_lines(action, predicted.trials),
            *rivals.domain,
            *rest,
            *rivals.skills,
        ],
        provenance=provenance(session, tested, predicted.trials, events.window, chosen.now())
        | {"judgement": judgement, "cost": cost_of(predicted)},
        warnings=warnings,
        window=events.window,
        tables=tables,
        spread=summary(made)[1],
        traces=scored.traces.encoder,
        film_traces=scored.traces.film,
        motion_trace=made.motion[1],
        judgement=judgement,
        nuisance=made.ceiling.nuisance,
        outcome=verdict.outcome,
        sentence=verdict.sentence,
        advice=advice,
    )


def name_all_parts(
    findings: SessionFindings, verdict: Verdict, action: model.Action
) -> tuple[SessionFindings, Verdict]:
    """Copies of findings and verdict whose texts name the parts of the action instead of its parameters' paths."""
    faults = tuple(replace(fault, text=name_parts(fault.text, action)) for fault in findings.faults)
    inputs = [name_parts(text, action) for text in verdict.quantities["main_input"]]
    named = replace(
        verdict, sentence=name_parts(verdict.sentence, action), quantities=verdict.quantities.assign(main_input=inputs)
    )
    return replace(findings, faults=faults), named


def _warnings(predicted: PredictedSession, findings: SessionFindings) -> Iterator[str]:
    """Yield the warnings of a comparison: findings first, then few trials, notes on trials and predictions, and trials
    not used for a reason that no finding names."""
    yield from (f.text for f in findings.faults)
    few = few_trials_warning(len(predicted.trials))
    if few:
        yield few
    for m in (m for m in predicted.trials if m.number not in findings.trials_without_rest):
        notes = (*m.notes, *predicted.predictions[m.number].notes)
        yield from (f"trial {m.number}: {text}" for text in notes)
    named = {number for f in findings.faults for number in f.numbers}
    told = {n: reason for n, reason in predicted.refused.items() if n not in named}
    yield from (f"trial {n} is not used: {r}" for n, r in told.items() if not r.startswith(OTHER_CONDITION))


def _explain(
    predicted: PredictedSession, findings: SessionFindings, tested: ModelUnderTest, chosen: ComparisonOptions
) -> Explained:
    """Causes of what the model and the sound trials of one kind of stroke differ by; with outlying trials only where
    their cause is found. Simulates; ``chosen`` says whether effects that the model lacks count."""
    chosen.say("which causes explain the difference")
    every, apart = (select_one_kind(predicted.trials, findings, but) for but in (ODD, ""))
    explained = explain_difference(tested, every, chosen.effects)
    if len(apart) < len(every) and not explained.findings:  # odd trials count only where what they differ by is found
        explained = explain_difference(tested, apart, chosen.effects)
    return explained


def _verdict(
    predicted: PredictedSession,
    found: Mapping[int, TrialErrors],
    findings: SessionFindings,
    tested: ModelUnderTest,
    chosen: ComparisonOptions,
) -> Verdict:
    """Verdict on the model from the errors ``found`` in usable trials, by number, within each condition; simulates the
    draws it needs, unless stored; undecided where none were requested."""
    limits = relevance_limits(chosen.relevant)
    if not chosen.budget:
        return undecided_verdict("the uncertainties were not drawn")
    chosen.say("error of the model: draws of all inputs")
    return judge_model(session_errors(predicted, tested, found, findings.conditions, chosen.u_rest_level_m), limits)


def cost_of(predicted: PredictedSession) -> dict[str, float]:
    """Cost of predicting one trial, by name: ``right_hand_sides``, mean number over trials, and ``seconds`` of
    processor time, the least of any trial; NaN for a stand-in.

    The least, since the first may compile; each with the run that estimates its error.
    """
    counters = [predicted.predictions[m.number].model.counters for m in predicted.trials]
    rhs, seconds = ([c.get(name, math.nan) for c in counters] for name in ("n_rhs", "seconds"))
    return {"right_hand_sides": sum(rhs) / len(rhs), "seconds": min(seconds)}


ODD = "outlying residual"


def replace_explained(findings: SessionFindings, explained: Explained, numbers: Sequence[int]) -> SessionFindings:
    """Copy of the findings in which those of the search for causes replace what they explain; where they begin at one
    trial and no change was seen, the trials from there on are a condition. ``numbers``: of the usable trials.

    A change that was seen stays unless a cause from a trial on explains it, and then says where the condition begins.
    """
    steps = {change.first for change in explained.changes if change.profile == STEP}
    odd = {f.trial for f in explained.findings}
    kept = [
        f
        for f in findings.faults
        if not (f.kind == CHANGED_CONDITION and steps) and not (f.kind == ODD and f.trial in odd)
    ]
    is_cut = any(f.kind == CHANGED_CONDITION for f in findings.faults)
    cuts = steps if len(steps) == 1 and not is_cut else set()
    conditions = separate_conditions(numbers, findings.conditions, cuts)
    return replace(findings, faults=(*kept, *explained.findings), conditions=conditions)


def select_one_kind(
    trials: Sequence[MeasuredTrial], findings: SessionFindings, ignored_kind: str = ""
) -> list[MeasuredTrial]:
    """Trials without a fault (those of the fault ``ignored_kind`` aside); of several kinds of stroke only the kind of
    the trial with the median peak force."""
    sound = select_sound_trials(trials, findings.faults, ignored_kind)
    if not sound or not findings.kinds:
        return sound
    first = select_representative(sound)
    kind = next((kind for kind in findings.kinds if first.number in kind), (first.number,))
    return [m for m in sound if m.number in kind]


def model_under_test(session: Session, action: model.Action, chosen: ComparisonOptions) -> ModelUnderTest:
    """The model to test, with the store of the session's results: kept in the session's folder where ``chosen`` says
    so, else for this run only.

    Predictions of a stand-in are stored under its name; values that depend on it are not, for its code is not known.
    """
    values = session.path if chosen.keep_predictions and chosen.stand_ins.are_absent else None
    store = ResultStore(values, session if chosen.keep_predictions else None)
    return ModelUnderTest(action, chosen.tolerance, chosen.stand_ins, chosen.rivals, store)


def load_model(action: model.Action | str | Path) -> model.Action:
    return model.load_action(action) if isinstance(action, str | Path) else action
