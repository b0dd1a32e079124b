"""Events of all trials and predictions of a session, and what follows from them: the third stage of a comparison.

What follows: lifts of the key, and the evaluation window, one interval for all trials and channels, fixed from measured
events before any scoring. Padding a window with quiet samples improves any average; hence one printed rule, not a
choice after the fact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from model.parameters.action import CONTACTS, USUAL
from validation.cache.result_store import ResultStore
from validation.conventions import ENCODER_CHANNELS, KEY, WHIPPEN, Array
from validation.errors import ValidationInputError
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.events.encoder_wiring import miswired_channels
from validation.events.key_lift import KeyLift, RailPull, capstan_of, find_lifts
from validation.measurement.geometry import ActionGeometry, Motion, motion_of
from validation.measurement.measure_session import representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles, PredictedSession

KEY_EVENTS = ("key_bottom", "key_release")
LEAD_S = 0.02
TAIL_S = 0.05


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


def common_window(measurements: Sequence[MeasuredTrial], events: dict[int, dict[str, Event]]) -> Window:
    """From 20 ms before the earliest force onset to 50 ms after the last trial is at rest, within every record.

    Parameters
    ----------
    measurements : sequence of MeasuredTrial
    events : dict
        Trial number → measured events.

    Raises
    ------
    ValidationInputError
        The records have no time in common.
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
    return Window(start, end, "20 ms before the earliest force onset", rule)


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


def find_key_lifts(
    predicted: PredictedSession, tested: ModelUnderTest, events: dict[int, dict[str, Event]]
) -> dict[int, list[KeyLift]]:
    """Lifts of the key in every trial; none in trials whose encoders are wired wrong.

    The rail's pull is computed for the trial of median peak force, and moved to each trial's own impact.
    """
    capstan = capstan_of(tested.action)
    middle = representative(predicted.trials)

    @cache
    def pulls() -> tuple[RailPull, ...]:
        return tuple(rail_pulls(tested, middle))

    def impact(number: int) -> float:
        return events[number]["string_impact"].value

    def moved(number: int) -> list[RailPull]:
        by = impact(number) - impact(middle.number)
        if math.isnan(by):  # no impact in one of them
            by = 0.0
        return [replace(t, start_s=t.start_s + by, end_s=t.end_s + by) for t in pulls()]

    found: dict[int, list[KeyLift]] = {}
    for m in predicted.trials:
        angles = predicted.predictions[m.number].model
        if miswired_channels(m, angles):
            found[m.number] = []
            continue
        geometry = tested.geometry_at(m.force.preload_n)
        found[m.number] = find_lifts(
            capstan,
            m.time_s,
            geometry.absolute({KEY: m.change_rad[:, 0], WHIPPEN: m.change_rad[:, 1]}),
            angles.angle_rad,
            impact_s=impact(m.number),
            release_s=events[m.number]["key_release"].value,
            rail=partial(moved, m.number),
        )
    return found


def rail_pulls(tested: ModelUnderTest, m: MeasuredTrial) -> list[RailPull]:
    """Intervals in which the model's balance rail would have to pull the key down, under this trial's force.

    A run that records the inner forces costs some eighty times a prediction: it is made for one trial, and only when
    there is a doubt. A stand-in for the model has no inner forces. Felt that remembers gives way to the thesis's law
    with the same slow curves, for which alone inner forces are known: the pull says when to doubt, it is no result.
    """
    if tested.stand_ins.predict is not None:
        return []
    force = m.force

    def run() -> list[tuple[float, float, float]]:
        rest = tested.load(force.preload_n).rest
        action = tested.action.with_laws(dict.fromkeys(CONTACTS, USUAL))
        found = tested.simulate(
            action, force.time_s, force.force_n, tolerance=tested.tolerance, initial=rest, inside=True
        )
        assert found.inside is not None
        return [(pull.start_s, pull.end_s, pull.largest_n) for pull in found.inside.key_tensions()]

    inputs = (tested.identity, force.time_s, force.force_n, force.preload_n)
    return [RailPull(*pull) for pull in tested.store.value("look inside", inputs, run)]


def with_doubtful_events(
    events: dict[int, dict[str, Event]], lifts: dict[int, list[KeyLift]]
) -> dict[int, dict[str, Event]]:
    """The same events; those of the key inside a lift become ambiguous."""
    out = {}
    for number, found in events.items():
        out[number] = dict(found)
        for name in KEY_EVENTS:
            event = found[name]
            if any(x.start_s <= event.value <= x.end_s for x in lifts.get(number, [])):
                out[number][name] = replace(event, status="ambiguous", note="inside a marked lift of the key")
    return out
