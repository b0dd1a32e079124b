"""Events of all trials and predictions of a session, and what follows from them: the third stage of a comparison.

What follows: lifts of the key, and the evaluation window, one interval for all trials and channels, fixed from measured
events before any scoring. Padding a window with quiet samples improves any average; hence one printed rule, not a
choice after the fact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from validation.cache.result_store import ResultStore
from validation.conventions import ENCODER_CHANNELS, Array
from validation.errors import ValidationInputError
from validation.events.definitions import Event
from validation.events.detect import LONG_S, find_events
from validation.events.key_lift import KeyLift, find_key_lifts
from validation.measurement.geometry import ActionGeometry, Motion, motion_of
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles, PredictedSession

KEY_EVENTS = ("key_bottom", "key_release")
LEAD_S, TAIL_S = 0.02, LONG_S  # of the window before the first onset and after the last rest: choice, to see both


@dataclass(frozen=True)
class Window:
    """Start and end in s, and the rule each came from."""

    start_s: float
    end_s: float
    start_rule: str
    end_rule: str

    def mask(self, time_s: Array) -> NDArray[np.bool_]:
        """Samples inside the window."""
        time = np.asarray(time_s, dtype=float)
        return (time >= self.start_s) & (time <= self.end_s)


def choose_window(measurements: Sequence[MeasuredTrial], events: dict[int, dict[str, Event]]) -> Window:
    """Evaluation window of a session: from 20 ms before the earliest onset to 50 ms after the last trial comes to rest,
    or to the end of the shortest record where that is sooner or a trial does not rest. Raises an input error where
    nothing is left.

    Parameters
    ----------
    events : Trial number → measured events
    """
    start = max(min(m.quiet.onset_s for m in measurements) - LEAD_S, max(float(m.time_s[0]) for m in measurements))
    # the model knows no force for the last group delay of a record
    record = min(float(m.force.time_s[-1]) for m in measurements)
    rests = [events[m.number]["rest"] for m in measurements]
    if all(rest.status != "absent" for rest in rests):
        end, rule = max(rest.value for rest in rests) + TAIL_S, "50 ms after the last trial came to rest"
    else:
        end, rule = record, "end of the shortest record, because a trial does not come to rest"
    if end > record:
        end, rule = record, "end of the shortest record"
    if not end > start:
        raise ValidationInputError(
            f"evaluation window: start {start:.4f} s, end {end:.4f} s; the trials do not overlap in time"
        )
    onset = "onset of the force" if all(m.has_force for m in measurements) else "motion"
    return Window(start, end, f"20 ms before the earliest {onset}", rule)


@dataclass(frozen=True)
class SessionEvents:
    """Events of trials and predictions by trial number and name, lifts of the key by trial, the evaluation window."""

    trial: dict[int, dict[str, Event]]
    model: dict[int, dict[str, Event]]
    lifts: dict[int, list[KeyLift]]
    window: Window

    @property
    def impact_s(self) -> dict[int, float]:
        impacts = {number: events["string_impact"] for number, events in self.trial.items()}
        return {number: event.value for number, event in impacts.items() if event.status != "absent"}


def find_session_events(predicted: PredictedSession, tested: ModelUnderTest) -> SessionEvents:
    """Events of every trial and of its prediction, lifts of the key and the evaluation window; a trial's key events
    inside a lift are marked ambiguous. Events found are kept in the model's store and read from it."""
    model, trial = {}, {}
    for m in predicted.trials:
        geometry = tested.geometry_of_trial(m)
        motion = make_predicted_motion(predicted.predictions[m.number].model, geometry, tested.tolerance)
        model[m.number] = _find_stored_events(tested.store, motion, m.quiet.stop)
        trial[m.number] = _find_stored_events(tested.store, m.motion, m.quiet.stop)
    by_force = replace(predicted, trials=tuple(m for m in predicted.trials if not m.driven_by_key))
    lifts: dict[int, list[KeyLift]] = {m.number: [] for m in predicted.trials}
    if by_force.trials:  # the rail's pull is that under the force
        lifts |= find_key_lifts(by_force, tested, trial)
    return SessionEvents(mark_doubtful_events(trial, lifts), model, lifts, choose_window(predicted.trials, trial))


def _find_stored_events(store: ResultStore, motion: Motion, quiet_stop: int) -> dict[str, Event]:
    found = store.value(
        "events", (motion, quiet_stop), lambda: [asdict(event) for event in find_events(motion, quiet_stop).values()]
    )
    return {event["name"]: Event(**event) for event in found}


def make_predicted_motion(p: PredictedAngles, geometry: ActionGeometry, tolerance: float) -> Motion:
    """Motion of a prediction for the same event finders; a sample is as uncertain as the requested tolerance."""
    change = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    return motion_of(geometry, p.time_s, change, np.full(3, tolerance), u_zero_rad=np.full(3, tolerance))


def mark_doubtful_events(
    events: dict[int, dict[str, Event]], lifts: dict[int, list[KeyLift]]
) -> dict[int, dict[str, Event]]:
    """Copy of the trials' events (trial number → name → event) in which key bottom and key release are ambiguous where
    they lie inside a lift of the key of that trial."""
    out = {}
    for number, found in events.items():
        out[number] = dict(found)
        for name in KEY_EVENTS:
            event = found[name]
            if any(x.start_s <= event.value <= x.end_s for x in lifts.get(number, [])):
                out[number][name] = replace(event, status="ambiguous", note="inside a marked lift of the key")
    return out
