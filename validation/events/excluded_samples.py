"""Which samples of which trial are left out of the scores: false readings of the key encoder while the key lifts.

Conventions: s on the DAQ clock; such a sample stays in the traces and figures and is left out of every score. A trial
without an impact is judged with the widest allowance for timing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial

from model.parameters.action import CONTACTS, USUAL
from validation.conventions import KEY, WHIPPEN
from validation.events.definitions import Event
from validation.events.encoder_wiring import miswired_channels
from validation.events.key_lift import KeyLift, RailPull, capstan_of, find_lifts
from validation.measurement.session import representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.session import PredictedSession

KEY_EVENTS = ("key_bottom", "key_release")


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
