"""All findings of a session: the fifth stage of a comparison.

One sound trial of median peak force stands for all where many runs of the model are needed.
"""

from __future__ import annotations

from dataclasses import dataclass

from validation.events.session import SessionEvents
from validation.findings.camera_clock import camera_clock
from validation.findings.finding import SessionFinding
from validation.findings.outlier_trials import outlying
from validation.findings.pooling import left_out, sound_trials, with_and_without
from validation.findings.session_checks import dead, hum, lifts, rates, short_records, wiring
from validation.findings.single_changes import SingleChange, in_words, single_changes
from validation.measurement.session import representative
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.session import PredictedSession
from validation.scores.session import ScoredSession


@dataclass(frozen=True)
class SessionFindings:
    """Faults, trials and channels that no pooled figure counts, notes, and single changes that may explain the model's
    difference, which are no faults."""

    faults: tuple[SessionFinding, ...]
    left_out: frozenset[tuple[int, str]]
    notes: tuple[str, ...]
    changes: tuple[SingleChange, ...] = ()


def find_faults(
    predicted: PredictedSession,
    events: SessionEvents,
    scored: ScoredSession,
    tested: ModelUnderTest,
    *,
    search_changes: bool,
) -> SessionFindings:
    """Faults of the session, wiring first; single changes of the model are tried on a trial without any."""
    trials, traces = predicted.trials, scored.traces
    found = rates(trials) + short_records(trials) + lifts(events.lifts)
    for m in trials:
        p = predicted.predictions[m.number].model
        found += wiring(m, p) + dead(m, p) + hum(m) + camera_clock(m)
    explained = {(int(f.trial), f.channel) for f in found}
    found += outlying(traces.base_s, traces.encoder, trials, events.trial, explained)
    sound = sound_trials(trials, found)
    changes: list[SingleChange] = []
    if sound and search_changes:
        m = representative(sound)
        release = events.trial[m.number]["key_release"]
        until = release.value if release.status == "found" else float(m.time_s[-1])
        changes = single_changes(tested, m, until)
    without = left_out(found)
    notes = [*with_and_without(traces.base_s, traces.encoder, found, without), *in_words(changes)]
    return SessionFindings(tuple(found), without, tuple(notes), tuple(changes))
