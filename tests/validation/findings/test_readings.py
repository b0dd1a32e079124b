"""Standstills of encoders and spikes of the force, told by two readings of the same event; what cannot be seen."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import model
from rig.session import Session
from tests.validation.bench_strokes import stroke_of
from validation.events.session_events import find_session_events
from validation.findings.encoders import Travel, find_travel_differences
from validation.findings.find_faults import find_faults
from validation.findings.force import find_force_saturation
from validation.findings.force_spikes import align_like_trials, find_candidate_spikes, find_unanswered_spikes
from validation.findings.readings import find_encoder_faults, find_force_standstill
from validation.measurement.measure_session import measure_session
from validation.options import ComparisonOptions
from validation.pipeline.compare_session import model_under_test
from validation.prediction.predict_session import predict_session, predict_trial
from validation.scores.score_session import score_session
from validation.verdict.error_draws import errors_of_trials
from validation.verdict.quantities import relevance_limits

CHANNELS = ("key", "whippen", "hammer")


def frozen(m, column, start_s, length_s):
    """The trial with an encoder that holds its count."""
    inside = (m.time_s >= start_s) & (m.time_s < start_s + length_s)
    change = m.change_rad.copy()
    change[inside, column] = change[np.flatnonzero(inside)[0], column]
    return replace(m, change_rad=change)


def spiked(stage, number, at_s, newton, length_s=1e-3):
    """The trial with a force that rises for a short time, and its prediction under that force."""
    m = next(m for m in stage.trials if m.number == number)
    inside = (m.time_s >= at_s) & (m.time_s < at_s + length_s)
    m = replace(m, force=replace(m.force, force_n=m.force.force_n + newton * inside))
    return m, predict_trial(m, stage.tested)


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("after_onset_s", [0.03, 0.05, 0.065])
def test_an_encoder_frozen_in_motion_stands_still(stage, column, after_onset_s):
    m = frozen(stage.trials[0], column, stage.trials[0].quiet.onset_s + after_onset_s, 15e-3)
    (found,) = find_encoder_faults(m, stage.predictions(1))
    assert (found.kind, found.channel) == ("reading stands still", CHANNELS[column])
    assert found.value == pytest.approx(15e-3, abs=1e-3)


def find_all(stage, broken):
    """All that is said of the session with one trial replaced."""
    others = {m.number: m for m in stage.trials} | {broken.number: broken}
    found = replace(stage.predicted.predictions[broken.number], model=predict_trial(broken, stage.tested))
    predictions = stage.predicted.predictions | {broken.number: found}
    predicted = replace(stage.predicted, trials=tuple(others.values()), predictions=predictions)
    events = find_session_events(predicted, stage.tested)
    scored = score_session(predicted, events, stage.tested.store)
    errors = errors_of_trials(predicted, scored.traces, events, stage.tested)
    return find_faults(predicted, events, scored, stage.tested, errors, relevance_limits({}))


def test_of_a_key_frozen_in_a_forte_nothing_else_is_said(stage):
    (found,) = find_all(stage, frozen(stage.trials[2], 0, 0.29, 0.03)).faults
    assert (found.kind, found.trial, found.channel) == ("reading stands still", 3, "key")
    assert "its count does not change for 29.8 ms from 0.2900 s" in found.text


def test_of_a_force_that_slips_it_is_not_said_that_the_stroke_is_another(stage):
    m = stage.trials[5]
    slipped = m.force.force_n + 2.2 * (m.force.time_s > stage.events.trial[6]["key_release"].value - 0.05)
    found = find_all(stage, replace(m, force=replace(m.force, force_n=slipped)))
    assert [(f.kind, f.trial) for f in found.faults] == [("force return", 6)]
    assert [(row.trial, row.channel) for row in found.unusable] == [(6, "force")] and found.kinds == ()


def test_an_encoder_frozen_from_rest_on_is_seen_when_it_leaps(stage):
    m = stage.trials[0]
    changed = frozen(m, 1, m.quiet.onset_s - 0.05, 0.1)
    (found,) = find_encoder_faults(changed, stage.predictions(1))
    assert found.kind == "reading stands still" and "then leaps by" in found.text


def test_a_slip_at_rest_is_a_leap_and_no_standstill(stage):
    m = stage.trials[0]
    held = stage.events.trial[1]["key_release"].value - 0.02
    change = m.change_rad + 1e-3 * (m.time_s > held)[:, None] * (np.arange(3) == 0)
    (found,) = find_encoder_faults(replace(m, change_rad=change), stage.predictions(1))
    assert found.kind == "reading leaps" and "no other encoder leaps there" in found.text


def test_an_encoder_frozen_at_rest_reads_right_and_is_not_seen(stage):
    m = stage.trials[0]
    changed = frozen(m, 0, m.time_s[-1] - 0.05, 0.04)
    assert np.abs(changed.change_rad - m.change_rad).max() <= 2 * m.resolution_rad[0]
    assert find_encoder_faults(changed, stage.predictions(1)) == []


@pytest.mark.parametrize("newton, length_s", [(6.0, 1e-3), (-4.0, 1e-3), (3.0, 2e-3)])
def test_a_spike_of_the_force_that_nothing_answers_is_found(stage, newton, length_s):
    at_s = stage.events.trial[3]["key_release"].value - 0.06
    m, p = spiked(stage, 3, at_s, newton, length_s)
    (found,) = find_unanswered_spikes(stage.tested, m, p, stage.events.trial[3]["key_release"].value)
    assert found.value == pytest.approx(newton, abs=0.2)
    assert float(re.search(r"at ([\d.]+) s", found.text)[1]) == pytest.approx(at_s, abs=3e-4)


def test_a_spike_that_key_and_whippen_answer_is_a_true_one(stage):
    at_s = stage.events.trial[3]["key_release"].value - 0.06
    m, p = spiked(stage, 3, at_s, 6.0)
    moved = stage.trials[2].change_rad + np.column_stack(
        [p.change_rad(name) - stage.predictions(3).change_rad(name) for name in CHANNELS]
    )
    assert find_unanswered_spikes(stage.tested, replace(m, change_rad=moved), p, m.time_s[-1]) == []


def test_a_spike_while_the_key_rings_is_told_by_other_trials(stage):
    bottom_s = {number: events["key_bottom"].value for number, events in stage.events.trial.items()}
    until_s = stage.events.trial[3]["key_release"].value
    for after_s, newton, length_s in ((0.01, 4.0, 2e-3), (0.02, -3.0, 15e-3)):
        m, p = spiked(stage, 3, bottom_s[3] + after_s, newton, length_s)
        others = [(one, stage.predictions(one.number)) for one in stage.trials if one.number != 3]
        like = align_like_trials(m, others, bottom_s)
        (found,) = find_unanswered_spikes(stage.tested, m, p, until_s, like)
        assert found.value == pytest.approx(newton, abs=1.0) and "differ from other trials by" in found.text
        turned = [p.change_rad(name) - stage.predictions(3).change_rad(name) for name in CHANNELS]
        answered = replace(m, change_rad=stage.trials[2].change_rad + np.column_stack(turned))
        assert find_unanswered_spikes(stage.tested, answered, p, until_s, like) == []
    assert align_like_trials(m, others[:2], bottom_s) is None


def test_a_bounce_that_the_model_misses_is_no_unanswered_spike(tmp_path, make):
    """Of two quick strikes the model misses how the key lands the second time, and so what each spike does there."""
    session = Session.create(tmp_path / "double", make.info())
    session.add_trial(replace(stroke_of("double", 7, 4).data, number=1))
    options = ComparisonOptions.from_keywords({"keep_predictions": False, "rivals": (), "budget": False})
    tested = model_under_test(session, model.load_action(), options)
    predicted = predict_session(measure_session(session, tested.geometry_at, 6e-5), tested)
    (m,), p = predicted.trials, predicted.predictions[1].model
    assert len(find_candidate_spikes(m)) > 20
    assert find_unanswered_spikes(tested, m, p, m.time_s[-1]) == []


def held(m, at, length):
    """The trial with a force that repeats one reading."""
    force = m.raw_force_n.copy()
    force[at : at + length] = force[at]
    return replace(m, raw_force_n=force)


def test_a_force_held_at_its_largest_value_stands_still_and_does_not_saturate(stage):
    m = stage.trials[0]
    top = int(np.argmax(m.raw_force_n))
    changed = held(m, top, 100)
    assert changed.raw_force_n.max() == changed.raw_force_n[top]
    (found,) = find_force_standstill(changed)
    assert found.kind == "reading stands still" and find_force_saturation(changed) == []
    clipped = replace(m, raw_force_n=np.minimum(m.raw_force_n, 0.8 * m.raw_force_n.max()))
    (found,) = find_force_saturation(clipped)
    assert "saturates" not in found.text and find_force_standstill(clipped) == []


def test_a_hammer_that_stays_where_the_key_leaves_it_is_no_gross_difference():
    stopped = Travel(np.array([0.036, 0.036, 0.006]), float("nan"), True)
    assert {f.channel for f in find_travel_differences(dict.fromkeys((1, 2, 3), stopped))} == {"key"}
