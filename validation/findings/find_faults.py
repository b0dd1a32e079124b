"""All findings of a session: the fifth stage of a comparison.

A check stands in its subject's file, entered by `finding.register_kinds`; only what needs a prediction or other
findings is called here. Order: what makes a channel no measurement comes first, and explains what follows from it. One
sound trial of median peak force stands for all where many runs of the model are needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from validation.conventions import ENCODER_CHANNELS
from validation.events.session_events import SessionEvents
from validation.findings.changed_condition import find_changed_condition
from validation.findings.encoders import (
    find_capstan_gaps,
    find_encoder_returns,
    find_miswired_encoders,
    find_motionless_encoders,
    find_stuck_bits,
    find_travel_differences,
    measure_travel,
)
from validation.findings.film import check_camera_clock, find_miswired_film
from validation.findings.finding import (
    BLOW,
    CHANNEL,
    CONDITIONS,
    CURVES,
    KINDS,
    OF_TRIAL,
    OF_TRIALS,
    PREDICTION,
    Kind,
    SessionFinding,
    select_sound_trials,
)
from validation.findings.force import estimate_force_lag, find_force_drift, find_force_factor, find_force_lags
from validation.findings.force_spikes import align_like_trials, find_unanswered_spikes
from validation.findings.let_off_and_check import compare_check_height, compare_let_off, find_let_off_and_check
from validation.findings.outlying_trials import (
    estimate_force_effect,
    find_outlying_residuals,
    find_outlying_trials,
    make_residuals,
)
from validation.findings.readings import NO_REST, find_encoder_faults, find_force_standstill, find_missing_rest
from validation.findings.stroke_kinds import find_mixed_strokes, find_single_strokes, group_strokes
from validation.findings.trial_records import find_short_records, find_unused_trials
from validation.findings.unusable import UnusableData, list_unusable_data, list_unusable_pairs
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession
from validation.scores.score_session import ScoredSession
from validation.verdict.error_draws import TrialErrors


def order_kinds() -> dict[str, Kind]:
    """Every kind of finding, those that spoil most first; of the rest, those of several conditions."""
    order = (CHANNEL, CURVES, BLOW, PREDICTION, "")
    return dict(sorted(KINDS.items(), key=lambda item: (order.index(item[1].spoils), item[0] not in CONDITIONS)))


@dataclass(frozen=True)
class SessionFindings:
    """Findings, the trials of each kind of stroke where there are several, and those of each stroke and condition."""

    faults: tuple[SessionFinding, ...]
    kinds: tuple[tuple[int, ...], ...] = ()
    conditions: tuple[tuple[int, ...], ...] = ()  # nothing is pooled beyond one of them
    not_compared: frozenset[tuple[int, str]] = frozenset()  # trials and encoders: not measured, or what drives

    @property
    def unusable(self) -> tuple[UnusableData, ...]:
        """Trials and channels that neither the verdict nor a pooled figure may rest on."""
        return list_unusable_data(self.faults)

    @property
    def trials_without_rest(self) -> frozenset[int]:
        """Trials whose angles have no zero, so that nothing else is said of them."""
        return frozenset(int(f.trial) for f in self.faults if f.kind == NO_REST)

    @property
    def left_out(self) -> frozenset[tuple[int, str]]:
        """(trial, curve) pairs that are left out: faults of encoders and film, and curves that are not compared."""
        return list_unusable_pairs(self.unusable) | self.not_compared


@dataclass(frozen=True)
class _Stage:
    """What the checks of several trials are given."""

    predicted: PredictedSession
    events: SessionEvents
    scored: ScoredSession
    tested: ModelUnderTest
    errors: Mapping[int, TrialErrors]
    limits: Mapping[str, float]  # of relevance

    def select_trials(self, numbers: Sequence[int]) -> _Stage:
        """Copy with the trials of these numbers only."""
        traces = self.scored.traces
        encoder = {n: f for n, f in traces.encoder.items() if n in numbers}
        return replace(
            self,
            predicted=replace(self.predicted, trials=tuple(m for m in self.predicted.trials if m.number in numbers)),
            events=replace(self.events, trial={n: e for n, e in self.events.trial.items() if n in numbers}),
            scored=replace(self.scored, traces=replace(traces, encoder=encoder)),
        )


def find_faults(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    tested: ModelUnderTest,
    errors: Mapping[int, TrialErrors],
    limits: Mapping[str, float],
) -> SessionFindings:
    """Findings of all checks, wiring first, with the kinds of stroke and the conditions of a session. ``errors``: model
    − trial by trial number, ``limits``: limits of relevance in SI by name. Trials in which the key drives the model are
    not checked.

    Trials in which the key drives the model are skipped because the checks compare with a prediction by the force;
    ``limits`` are those of `validation.verdict.quantities.relevance_limits`.
    """
    aside = frozenset((m.number, c) for m in predicted.trials for c in ENCODER_CHANNELS if c not in m.channels)
    by_force = tuple(m.number for m in predicted.trials if not m.driven_by_key)
    session = _Stage(predicted, events, scored, tested, errors, limits)
    if len(by_force) < len(predicted.trials):
        unused = SessionFindings(tuple(find_unused_trials(predicted.refused)))
        stage = session.select_trials(by_force)
        sound = find_faults(stage.predicted, stage.events, stage.scored, tested, errors, limits) if by_force else unused
        return replace(sound, not_compared=aside)
    trials = predicted.trials
    found = find_unused_trials(predicted.refused) + [f for check in OF_TRIALS for f in check(trials)]
    found += [f for m in trials for f in find_missing_rest(m, tested.geometry_at(m.force.preload_n))]
    begun = {f.trial for f in found if f.kind == NO_REST}
    if begun:  # nothing that follows holds of them
        kept = [m.number for m in trials if m.number not in begun]
        session = session.select_trials(kept)
        predicted, events, trials = session.predicted, session.events, session.predicted.trials
    if not trials:
        return SessionFindings(tuple(found))
    found += _check_single_trials(predicted, events, tested)
    travel = _check_travel(predicted, events, tested, found)
    found += travel + _check_let_off_and_check(predicted, events, tested, [*found, *travel])
    wrong = {number for f in found if f.channel == "force" and KINDS[f.kind].spoils for number in f.numbers}
    with_force = [m for m in trials if m.has_force]
    sound_force = [m for m in with_force if m.number not in wrong] or with_force
    kinds = group_strokes(sound_force)
    found += find_mixed_strokes(sound_force, kinds) + find_single_strokes(sound_force, kinds)
    found += _check_capstan(events, found)
    conditions: list[tuple[int, ...]] = []
    for numbers in kinds:
        stage = session.select_trials(numbers)
        found += find_short_records(stage.predicted.trials)
        unlike, parts = _split_conditions(stage, found)
        found += unlike
        conditions += parts
    return SessionFindings(tuple(found), _select_several(kinds), _select_several(conditions))


def _select_several(groups: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Groups of more than one trial, where there are several; of one trial each where all are so."""
    of_many = tuple(group for group in groups if len(group) > 1) or tuple(groups)
    return of_many if len(of_many) > 1 else ()


def _check_single_trials(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest
) -> list[SessionFinding]:
    """Findings of the checks of one trial against its prediction, for every trial, and of the lag of the force. An
    encoder with faulty readings is not judged further; a wrong force factor skips the checks of wiring, motion and
    return."""
    found: list[SessionFinding] = []
    lags = {}
    bottom_s = {number: named["key_bottom"].value for number, named in events.trial.items()}
    kinds = group_strokes([m for m in predicted.trials if m.has_force])
    for m in predicted.trials:
        p = predicted.predictions[m.number].model
        release = events.trial[m.number]["key_release"]
        until = release.value if release.status != "absent" else float(m.time_s[-1])
        wrong = find_force_factor(tested, m, p, until)
        forces = wrong or find_force_drift(m)
        forces = forces + find_force_standstill(m)
        readings = find_encoder_faults(m, p)
        encoders = [*readings, *_keep_other_channels(find_stuck_bits(m), readings)]
        if not wrong:
            others = find_miswired_encoders(m, p) + find_motionless_encoders(m, p) + find_encoder_returns(m, p)
            encoders += _keep_other_channels(others, readings)
        sound = not any(f.channel in ("whippen", "") for f in encoders)
        films = find_miswired_film(m, p, whippen_sound=sound)
        films += check_camera_clock(m) if sound and not films else []
        if not forces and not any(f.channel in ("key", "whippen", "") for f in encoders):
            kind = next((kind for kind in kinds if m.number in kind), ())
            same = [(o, predicted.predictions[o.number].model) for o in predicted.trials if o.number in kind]
            forces = find_unanswered_spikes(tested, m, p, until, align_like_trials(m, same, bottom_s))
        if not forces and not any(f.channel in ("key", "") for f in encoders):
            lags[m.number] = estimate_force_lag(m, p)
        found += [f for check in OF_TRIAL for f in check(m)] + forces + encoders + films
    return found + find_force_lags(lags)


def _check_travel(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest, found: Sequence[SessionFinding]
) -> list[SessionFinding]:
    """Findings on how far encoders travel compared with the prediction; trials whose prediction a finding in ``found``
    makes wrong are skipped, and so are the encoders that ``found`` already names."""
    travels = {
        m.number: measure_travel(
            m,
            predicted.predictions[m.number].model,
            events.model[m.number],
            tested.geometry_at(m.force.preload_n),
        )
        for m in predicted.trials
        if not any(m.number in f.numbers and KINDS[f.kind].spoils == PREDICTION for f in found)
    }
    return find_travel_differences(travels, _list_explained(found))


def _check_let_off_and_check(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest, found: Sequence[SessionFinding]
) -> list[SessionFinding]:
    """Findings on let-off and check height, over the trials that no finding in ``found`` makes unfit for a comparison;
    none where ``found`` has a travel difference of the hammer."""
    if any(f.kind == "travel difference" and f.channel == "hammer" for f in found):
        return []
    let_off, check = {}, {}
    for m in select_sound_trials(predicted.trials, found):
        own, model = events.trial[m.number], events.model[m.number]
        p = predicted.predictions[m.number].model
        let_off[m.number] = compare_let_off(m, p, own, model, tested.geometry_at(m.force.preload_n))
        check[m.number] = compare_check_height(own, model)
    return find_let_off_and_check(let_off, check)


def _list_explained(found: Sequence[SessionFinding]) -> set[tuple[int, str]]:
    """Trials and channels of which something is said that spoils them, or that is said of one trial alone."""
    return {(n, f.channel) for f in found if KINDS[f.kind].spoils or len(f.numbers) == 1 for n in f.numbers}


def _split_conditions(
    stage: _Stage, found: Sequence[SessionFinding]
) -> tuple[list[SessionFinding], list[tuple[int, ...]]]:
    """Findings of outlying trials and of changed conditions, and the trial numbers of each condition, in order; trials
    are cut, recursively, where the error of the model steps. ``found``: findings so far, which explain trials.

    A change is looked for before single trials are, which would else be those of the shorter part, and again without
    the trials that stand out.
    """
    numbers = tuple(m.number for m in stage.predicted.trials)
    change, odd = _find_change(stage, found), []
    if not change:
        odd = _find_outlying(stage, found)
        change = _find_change(stage, [*found, *odd]) if odd else []
    if not change:
        return odd, [numbers]
    first, out, parts = int(change[0].trial), list(change), []
    for part in (tuple(n for n in numbers if n < first), tuple(n for n in numbers if n >= first)):
        unlike, own = _split_conditions(stage.select_trials(part), found)
        out += unlike
        parts += own
    return out, parts


def _find_outlying(stage: _Stage, found: Sequence[SessionFinding]) -> list[SessionFinding]:
    """Findings of outlying trials: first by their curves, in channels that ``found`` does not name, then by their
    difference from the model, of the trials still sound; a gap at the capstan explains the latter."""
    predicted, events, tested, traces = stage.predicted, stage.events, stage.tested, stage.scored.traces
    by_number = {m.number: m for m in predicted.trials}
    release = [e["key_release"].value for e in events.trial.values() if e["key_release"].status != "absent"]
    until = min(release, default=events.window.end_s)

    def reach(number: int) -> float:
        return estimate_force_effect(tested, by_number[number], events.window.start_s, until)

    odd = find_outlying_trials(
        traces.base_s, traces.encoder, predicted.trials, events.trial, _list_explained(found), reach, until
    )
    sound = select_sound_trials(predicted.trials, [*found, *odd])
    by_model = find_outlying_residuals(tested, {m.number: m for m in sound}, make_residuals(predicted, events, sound))
    lifted = {f.trial for f in found if f.kind == "capstan gap"}  # which explains it
    return odd + [f for f in by_model if f.trial not in lifted]


def _find_change(stage: _Stage, found: Sequence[SessionFinding]) -> list[SessionFinding]:
    sound = [m.number for m in select_sound_trials(stage.predicted.trials, found)]
    return find_changed_condition({number: stage.errors[number] for number in sound}, stage.limits)


def _check_capstan(events: SessionEvents, found: Sequence[SessionFinding]) -> list[SessionFinding]:
    """Findings on gaps between key and whippen at the capstan, but for trials with a fault of an encoder or of the
    force in ``found``; none at all where ``found`` has a travel difference of key or whippen, a let-off or a force lag.
    """
    travel = any(f.kind == "travel difference" and f.channel != "hammer" for f in found)
    if travel or any(f.kind in ("let-off", "force lag") for f in found):
        return []
    broken = {
        number
        for f in found
        for number in f.numbers
        if f.kind in ("encoder return", "stuck bit", "reading leaps", "reading stands still", "gap")
        or KINDS[f.kind].spoils in (CHANNEL, PREDICTION)
    }
    release = {number: e["key_release"].value for number, e in events.trial.items()}
    return find_capstan_gaps({number: x for number, x in events.lifts.items() if number not in broken}, release)


def _keep_other_channels(found: Sequence[SessionFinding], before: Sequence[SessionFinding]) -> list[SessionFinding]:
    """Findings of channels of which nothing is said before; a gap is said of all of them."""
    said = {f.channel for f in before}
    return [] if "" in said else [f for f in found if f.channel not in said]
