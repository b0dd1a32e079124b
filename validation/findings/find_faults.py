"""All findings of a session: the fifth stage of a comparison.

A check stands in its subject's file, entered by `finding.finds`; only what needs a prediction or other findings is
called here. Order: what makes a channel no measurement comes first, and explains what follows from it. One sound trial
of median peak force stands for all where many runs of the model are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from validation.events.session_events import SessionEvents
from validation.findings.encoders import (
    capstan_gaps,
    encoder_return,
    encoder_travel,
    find_miswired_encoders,
    find_motionless_encoders,
    stuck_bits,
    travel_of,
)
from validation.findings.film import camera_clock, film_wiring
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
    sound_trials,
)
from validation.findings.force import force_delay, force_drift, force_lag, force_sign_and_unit
from validation.findings.force_spikes import like_trials, unanswered_spikes
from validation.findings.let_off_and_check import check_difference_m, let_off_and_check, let_off_way_m
from validation.findings.outlying_trials import (
    changed_condition,
    find_outlying_trials,
    force_reach,
    outlying_residuals,
    residuals_of,
)
from validation.findings.readings import NO_REST, encoder_readings, force_stands_still, starts_at_rest
from validation.findings.stroke_kinds import mixed_strokes, stroke_kinds, strokes_of_their_own
from validation.findings.trial_records import short_records, unused_trials
from validation.findings.unusable import UnusableData, unusable_data, unusable_pairs
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession
from validation.scores.score_session import ScoredSession


def urgent_first() -> dict[str, Kind]:
    """Every kind of finding, those that spoil most first; of the rest, those of several conditions."""
    order = (CHANNEL, CURVES, BLOW, PREDICTION, "")
    return dict(sorted(KINDS.items(), key=lambda item: (order.index(item[1].spoils), item[0] not in CONDITIONS)))


@dataclass(frozen=True)
class SessionFindings:
    """Findings, the trials of each kind of stroke where there are several, and those of each stroke and condition."""

    faults: tuple[SessionFinding, ...]
    kinds: tuple[tuple[int, ...], ...] = ()
    conditions: tuple[tuple[int, ...], ...] = ()  # nothing is pooled beyond one of them

    @property
    def unusable(self) -> tuple[UnusableData, ...]:
        """Trials and channels that neither the verdict nor a pooled figure may rest on."""
        return unusable_data(self.faults)

    @property
    def trials_without_rest(self) -> frozenset[int]:
        """Trials whose angles have no zero, so that nothing else is said of them."""
        return frozenset(int(f.trial) for f in self.faults if f.kind == NO_REST)

    @property
    def left_out(self) -> frozenset[tuple[int, str]]:
        """The same by trial and curve, of encoders and film."""
        return unusable_pairs(self.unusable)


def find_faults(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    tested: ModelUnderTest,
) -> SessionFindings:
    """Faults of the session, wiring first."""
    trials = predicted.trials
    found = unused_trials(predicted.refused) + [f for check in OF_TRIALS for f in check(trials)]
    found += [f for m in trials for f in starts_at_rest(m, tested.geometry_at(m.force.preload_n))]
    begun = {f.trial for f in found if f.kind == NO_REST}
    if begun:  # nothing that follows holds of them
        kept = tuple(m.number for m in trials if m.number not in begun)
        predicted, events, scored = _only(kept, predicted, events, scored)
        trials = predicted.trials
    if not trials:
        return SessionFindings(tuple(found))
    found += _single_trials(predicted, events, tested)
    travel = _travel(predicted, events, tested, found)
    found += travel + _let_off_and_check(predicted, events, tested, [*found, *travel])
    wrong = {number for f in found if f.channel == "force" and KINDS[f.kind].spoils for number in f.numbers}
    with_force = [m for m in trials if m.has_force]
    sound_force = [m for m in with_force if m.number not in wrong] or with_force
    kinds = stroke_kinds(sound_force)
    found += mixed_strokes(sound_force, kinds) + strokes_of_their_own(sound_force, kinds)
    found += _capstan_gaps(events, found)
    conditions: list[tuple[int, ...]] = []
    for numbers in kinds:
        of_kind = _only(numbers, predicted, events, scored)
        found += short_records(of_kind[0].trials)
        unlike, parts = _unlike_others(*of_kind, tested, found)
        found += unlike
        conditions += parts
    return SessionFindings(tuple(found), _several(kinds), _several(conditions))


def _several(groups: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Groups of more than one trial, where there are several; of one trial each where all are so."""
    of_many = tuple(group for group in groups if len(group) > 1) or tuple(groups)
    return of_many if len(of_many) > 1 else ()


def _single_trials(predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest) -> list[SessionFinding]:
    """Checks of one trial alone; a wrong force makes the prediction useless for the others."""
    found: list[SessionFinding] = []
    lags = {}
    bottom_s = {number: named["key_bottom"].value for number, named in events.trial.items()}
    kinds = stroke_kinds([m for m in predicted.trials if m.has_force])
    for m in predicted.trials:
        p = predicted.predictions[m.number].model
        release = events.trial[m.number]["key_release"]
        until = release.value if release.status != "absent" else float(m.time_s[-1])
        wrong = force_sign_and_unit(tested, m, p, until)
        forces = wrong or force_drift(m)
        forces = forces + force_stands_still(m)
        readings = encoder_readings(m, p)
        encoders = [*readings, *_keep_other_channels(stuck_bits(m), readings)]
        if not wrong:
            others = find_miswired_encoders(m, p) + find_motionless_encoders(m, p) + encoder_return(m, p)
            encoders += _keep_other_channels(others, readings)
        sound = not any(f.channel in ("whippen", "") for f in encoders)
        films = film_wiring(m, p, whippen_sound=sound)
        films += camera_clock(m) if sound and not films else []
        if not forces and not any(f.channel in ("key", "whippen", "") for f in encoders):
            kind = next((kind for kind in kinds if m.number in kind), ())
            same = [(o, predicted.predictions[o.number].model) for o in predicted.trials if o.number in kind]
            forces = unanswered_spikes(tested, m, p, until, like_trials(m, same, bottom_s))
        if not forces and not any(f.channel in ("key", "") for f in encoders):
            lags[m.number] = force_lag(m, p)
        found += [f for check in OF_TRIAL for f in check(m)] + forces + encoders + films
    return found + force_delay(lags)


def _travel(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest, found: Sequence[SessionFinding]
) -> list[SessionFinding]:
    """Travel of the encoders between the stops, of those that nothing else is said of."""
    travels = {
        m.number: travel_of(
            m,
            predicted.predictions[m.number].model,
            events.model[m.number],
            tested.geometry_at(m.force.preload_n),
        )
        for m in predicted.trials
        if not any(m.number in f.numbers and KINDS[f.kind].spoils == PREDICTION for f in found)
    }
    return encoder_travel(travels, _explained(found))


def _let_off_and_check(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest, found: Sequence[SessionFinding]
) -> list[SessionFinding]:
    """Let-off and check, of the trials without a fault of an encoder or of the force; a scale explains both."""
    if any(f.kind == "travel difference" and f.channel == "hammer" for f in found):
        return []
    let_off, check = {}, {}
    for m in sound_trials(predicted.trials, found):
        own, model = events.trial[m.number], events.model[m.number]
        p = predicted.predictions[m.number].model
        let_off[m.number] = let_off_way_m(m, p, own, model, tested.geometry_at(m.force.preload_n))
        check[m.number] = check_difference_m(own, model)
    return let_off_and_check(let_off, check)


def _only(
    numbers: Sequence[int], predicted: PredictedSession, events: SessionEvents, scored: ScoredSession
) -> tuple[PredictedSession, SessionEvents, ScoredSession]:
    """The same of some trials."""
    traces = scored.traces
    return (
        replace(predicted, trials=tuple(m for m in predicted.trials if m.number in numbers)),
        replace(events, trial={n: e for n, e in events.trial.items() if n in numbers}),
        replace(scored, traces=replace(traces, encoder={n: f for n, f in traces.encoder.items() if n in numbers})),
    )


def _explained(found: Sequence[SessionFinding]) -> set[tuple[int, str]]:
    """Trials and channels of which something is said that spoils them, or that is said of one trial alone."""
    return {(n, f.channel) for f in found if KINDS[f.kind].spoils or len(f.numbers) == 1 for n in f.numbers}


def _unlike_others(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    tested: ModelUnderTest,
    found: Sequence[SessionFinding],
) -> tuple[list[SessionFinding], list[tuple[int, ...]]]:
    """Trials that stand out from those of their condition, the trials from which another one holds; all conditions.

    A change is looked for before single trials are, which would else be those of the shorter part, and again without
    the trials that stand out.
    """
    numbers = tuple(m.number for m in predicted.trials)
    change, odd = _change(predicted, events, tested, found), []
    if not change:
        odd = _outlying(predicted, events, scored, tested, found)
        change = _change(predicted, events, tested, [*found, *odd]) if odd else []
    if not change:
        return odd, [numbers]
    first, out, parts = int(change[0].trial), list(change), []
    for part in (tuple(n for n in numbers if n < first), tuple(n for n in numbers if n >= first)):
        unlike, own = _unlike_others(*_only(part, predicted, events, scored), tested, found)
        out += unlike
        parts += own
    return out, parts


def _outlying(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    tested: ModelUnderTest,
    found: Sequence[SessionFinding],
) -> list[SessionFinding]:
    """Trials that stand out from the others in channels nothing else explains, or that only the model finds odd."""
    by_number = {m.number: m for m in predicted.trials}
    release = [e["key_release"].value for e in events.trial.values() if e["key_release"].status != "absent"]
    until = min(release, default=events.window.end_s)

    def reach(number: int) -> float:
        return force_reach(tested, by_number[number], events.window.start_s, until)

    traces = scored.traces
    odd = find_outlying_trials(
        traces.base_s, traces.encoder, predicted.trials, events.trial, _explained(found), reach, until
    )
    sound: list[MeasuredTrial] = sound_trials(predicted.trials, [*found, *odd])
    by_model = outlying_residuals(tested, {m.number: m for m in sound}, residuals_of(predicted, events, sound))
    lifted = {f.trial for f in found if f.kind == "capstan gap"}  # which explains it
    return odd + [f for f in by_model if f.trial not in lifted]


def _change(
    predicted: PredictedSession, events: SessionEvents, tested: ModelUnderTest, found: Sequence[SessionFinding]
) -> list[SessionFinding]:
    """The trial from which the difference from the model is another one, if there is one."""
    sound = sound_trials(predicted.trials, found)
    by_number = {m.number: m for m in sound}
    return changed_condition(tested, by_number, residuals_of(predicted, events, sound))


def _capstan_gaps(events: SessionEvents, found: Sequence[SessionFinding]) -> list[SessionFinding]:
    """Disagreements of key and whippen, where nothing else is said of what they or the force read."""
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
    return capstan_gaps({number: x for number, x in events.lifts.items() if number not in broken}, release)


def _keep_other_channels(found: Sequence[SessionFinding], before: Sequence[SessionFinding]) -> list[SessionFinding]:
    """Findings of channels of which nothing is said before; a gap is said of all of them."""
    said = {f.channel for f in before}
    return [] if "" in said else [f for f in found if f.channel not in said]
