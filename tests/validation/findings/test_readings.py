"""Standstills of encoders and spikes of the force, told by two readings of the same event; what cannot be seen."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from validation.findings.encoders import Travel, encoder_travel
from validation.findings.force import force_saturation
from validation.findings.force_spikes import unanswered_spikes
from validation.findings.readings import encoder_readings, force_stands_still
from validation.prediction.predict_session import predict_trial

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


def test_sound_trials_have_neither(stage):
    for m in stage.trials:
        p = stage.predictions(m.number)
        assert encoder_readings(m, p) == []
        assert unanswered_spikes(stage.tested, m, p, stage.events.trial[m.number]["key_release"].value) == []


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("after_onset_s", [0.03, 0.05, 0.065])
def test_an_encoder_frozen_in_motion_stands_still(stage, column, after_onset_s):
    m = frozen(stage.trials[0], column, stage.trials[0].quiet.onset_s + after_onset_s, 15e-3)
    (found,) = encoder_readings(m, stage.predictions(1))
    assert (found.kind, found.channel) == ("reading stands still", CHANNELS[column])
    assert found.value == pytest.approx(15e-3, abs=1e-3)


def test_an_encoder_frozen_from_rest_on_is_seen_when_it_leaps(stage):
    m = stage.trials[0]
    changed = frozen(m, 1, m.quiet.onset_s - 0.05, 0.1)
    (found,) = encoder_readings(changed, stage.predictions(1))
    assert found.kind == "reading stands still" and "then leaps by" in found.text


def test_a_slip_at_rest_is_a_leap_and_no_standstill(stage):
    m = stage.trials[0]
    held = stage.events.trial[1]["key_release"].value - 0.02
    change = m.change_rad + 1e-3 * (m.time_s > held)[:, None] * (np.arange(3) == 0)
    (found,) = encoder_readings(replace(m, change_rad=change), stage.predictions(1))
    assert found.kind == "reading leaps" and "no other encoder leaps there" in found.text


def test_an_encoder_frozen_at_rest_reads_right_and_is_not_seen(stage):
    m = stage.trials[0]
    changed = frozen(m, 0, m.time_s[-1] - 0.05, 0.04)
    assert np.abs(changed.change_rad - m.change_rad).max() <= 2 * m.resolution_rad[0]
    assert encoder_readings(changed, stage.predictions(1)) == []


@pytest.mark.parametrize("newton, length_s", [(6.0, 1e-3), (-4.0, 1e-3), (3.0, 2e-3)])
def test_a_spike_of_the_force_that_nothing_answers_is_found(stage, newton, length_s):
    at_s = stage.events.trial[3]["key_release"].value - 0.06
    m, p = spiked(stage, 3, at_s, newton, length_s)
    (found,) = unanswered_spikes(stage.tested, m, p, stage.events.trial[3]["key_release"].value)
    assert found.value == pytest.approx(newton, abs=0.2)
    assert float(re.search(r"at ([\d.]+) s", found.text)[1]) == pytest.approx(at_s, abs=3e-4)


def test_a_spike_that_key_and_whippen_answer_is_a_true_one(stage):
    at_s = stage.events.trial[3]["key_release"].value - 0.06
    m, p = spiked(stage, 3, at_s, 6.0)
    moved = stage.trials[2].change_rad + np.column_stack(
        [p.change_rad(name) - stage.predictions(3).change_rad(name) for name in CHANNELS]
    )
    assert unanswered_spikes(stage.tested, replace(m, change_rad=moved), p, m.time_s[-1]) == []


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
    (found,) = force_stands_still(changed)
    assert found.kind == "reading stands still" and force_saturation(changed) == []
    clipped = replace(m, raw_force_n=np.minimum(m.raw_force_n, 0.8 * m.raw_force_n.max()))
    (found,) = force_saturation(clipped)
    assert "saturates" not in found.text and force_stands_still(clipped) == []


def test_a_hammer_that_stays_where_the_key_leaves_it_is_no_gross_difference():
    stopped = Travel(np.array([0.036, 0.036, 0.006]), float("nan"), True)
    assert {f.channel for f in encoder_travel(dict.fromkeys((1, 2, 3), stopped))} == {"key"}
