"""Many runs at once: the same numbers whatever else is run, failures in their places, stand-ins one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from model import ModelError
from validation.prediction.many_runs import Run, run_many
from validation.prediction.model_under_test import ModelUnderTest, StandIns


@pytest.fixture(scope="module")
def run():
    action = model.load_action()
    time_s, force_n = model.force_table("forte")
    return Run(action, model.rest_state(action), time_s, force_n, time_s[::20], 3e-5)


def angles(tested, runs):
    return run_many(tested, runs, lambda _, solution: np.array(solution.angle_rad))


def test_what_cannot_be_run_is_none_in_its_place(run):
    bad = replace(run, force_n=np.full_like(run.force_n, 1e7))
    found = angles(ModelUnderTest(run.action), [None, run, bad, run])
    assert found[0] is None and found[2] is None
    np.testing.assert_array_equal(found[1], found[3])
    assert angles(ModelUnderTest(run.action), []) == []


def test_a_stand_in_is_called_for_each_run(run):
    calls = []

    def predict(action, time_s, force_n, **options):
        calls.append(options)
        if len(calls) == 2:
            raise ModelError("refused")
        return model.simulate(action, time_s, force_n, **options)

    tested = ModelUnderTest(run.action, stand_ins=StandIns(predict=predict))
    assert not tested.own_model and ModelUnderTest(run.action).own_model
    found = angles(tested, [run] * 3)
    assert len(calls) == 3 and sum(one is None for one in found) == 1
    assert calls[0].keys() == {"tolerance", "output_time_s", "initial"}
