"""Events of all trials and predictions of a session, and what follows from them: the third stage of a comparison."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from validation.cache.result_store import ResultStore
from validation.conventions import ENCODER_CHANNELS
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.events.evaluation_window import Window, common_window
from validation.events.excluded_samples import find_key_lifts, with_doubtful_events
from validation.events.key_lift import KeyLift
from validation.measurement.geometry import ActionGeometry
from validation.measurement.stroke import Motion, motion_of
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.session import PredictedSession
from validation.prediction.trial_prediction import PredictedAngles


@dataclass(frozen=True)
class SessionEvents:
    """Events of trials and predictions by trial number and name, lifts of the key by trial, the evaluation window."""

    trial: dict[int, dict[str, Event]]
    model: dict[int, dict[str, Event]]
    lifts: dict[int, list[KeyLift]]
    window: Window

    @property
    def impact_s(self) -> dict[int, float]:
        """Time of the string impact of each trial that has one."""
        impacts = {number: events["string_impact"] for number, events in self.trial.items()}
        return {number: event.value for number, event in impacts.items() if event.status != "absent"}


def find_session_events(predicted: PredictedSession, tested: ModelUnderTest) -> SessionEvents:
    """Find events in every trial and its prediction, lifts of the key, and the evaluation window."""
    model, trial = {}, {}
    for m in predicted.trials:
        geometry = tested.geometry_at(m.force.preload_n)
        motion = predicted_motion(predicted.predictions[m.number].model, geometry, tested.tolerance)
        model[m.number] = _events(tested.store, motion, m.quiet.stop)
        trial[m.number] = _events(tested.store, m.motion, m.quiet.stop)
    lifts = find_key_lifts(predicted, tested, trial)
    return SessionEvents(with_doubtful_events(trial, lifts), model, lifts, common_window(predicted.trials, trial))


def _events(store: ResultStore, motion: Motion, quiet_stop: int) -> dict[str, Event]:
    found = store.value(
        "events", (motion, quiet_stop), lambda: [asdict(event) for event in find_events(motion, quiet_stop).values()]
    )
    return {event["name"]: Event(**event) for event in found}


def predicted_motion(p: PredictedAngles, geometry: ActionGeometry, tolerance: float) -> Motion:
    """Motion of a prediction for the same event finders; a sample is as uncertain as the requested tolerance."""
    change = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    return motion_of(geometry, p.time_s, change, np.full(3, tolerance), u_zero_rad=np.full(3, tolerance))
