"""Uncertainty budget of events: closed forms, planted differences, coverage; area metric and its floor."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from validation.events.detect import find_events
from validation.events.session_events import predicted_motion
from validation.measurement.geometry import motion_of
from validation.measurement.measure_session import measure_session, representative
from validation.prediction.input_sampling import cases, uncertain_parameters
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import predict_trial
from validation.result_tables.events import area_floor, area_metric, event_summary
from validation.statistics.event_budget import _row, event_budget

pytest.importorskip("model")


def test_parts_add_up_as_squares_and_decide():
    row = SimpleNamespace(event="hammer_speed", unit="m/s", n_both=4, difference=0.30, difference_s=0.08, u_trial=0.03)
    groups = {
        "base": [2.0],
        "numerics": [2.002, 1.999],
        "force gain": [2.03],
        "force level": [1.96],
        "stated parameters": [2.1, 1.9, float("nan")],
        "assumed parameters": [2.05, 1.95],
    }
    b = _row(row, groups)
    assert b["u_num"] == pytest.approx(0.002)
    assert b["u_force"] == pytest.approx(0.05)
    assert b["u_parameters"] == pytest.approx(0.1)
    assert b["u_assumed"] == pytest.approx(0.05)
    assert b["u_input"] == pytest.approx(np.sqrt(0.05**2 + 0.1**2 + 0.05**2))
    assert b["assumed_share"] == pytest.approx(0.05**2 / 0.015)
    assert b["u_repeat"] == pytest.approx(0.04)
    u_val = np.sqrt(0.002**2 + 0.015 + 0.03**2 + 0.04**2)
    assert b["u_val"] == pytest.approx(u_val)
    assert b["resolved"]
    assert (b["low"], b["high"]) == pytest.approx((0.3 - 2 * u_val, 0.3 + 2 * u_val))
    small = _row(SimpleNamespace(**{**vars(row), "difference": -0.2}), groups)
    assert not small["resolved"]
    assert small["reading"] == "cannot resolve a model error"


@pytest.mark.parametrize(
    "changes",
    [
        {"base": [float("nan")]},  # the event is missing in the trial that is run
        {"numerics": [float("nan")] * 2},
        {"force gain": [float("nan")]},  # the only case of the group could not be run
    ],
)
def test_a_part_of_which_nothing_is_known_is_not_nothing(changes):
    row = SimpleNamespace(event="check_time", unit="s", n_both=4, difference=2e-3, difference_s=1e-3, u_trial=3e-4)
    b = _row(row, {"base": [0.0], "numerics": [1e-9, 2e-9], "force gain": [1e-4], **changes})
    assert np.isnan([b["u_val"], b["ratio"], b["low"]]).all()
    assert not b["resolved"] and b["reading"].startswith("not judged")
    assert np.isnan(b["u_input"]) == ("numerics" not in changes)


def budget_of(session, action):
    tested = ModelUnderTest(action, rivals=())
    measured = measure_session(session, tested.geometry_at, 5e-5).trials
    trial = {m.number: find_events(m.motion, m.quiet.stop) for m in measured}
    model = {}
    for m in measured:
        motion = predicted_motion(predict_trial(m, tested), tested.geometry_at(m.force.preload_n), tested.tolerance)
        model[m.number] = find_events(motion, m.quiet.stop)
    summary = event_summary(trial, model)
    return event_budget(tested, representative(measured), summary).set_index("event"), measured


@pytest.fixture(scope="module")
def same(recorded):
    """The model is the specimen itself."""
    session, truth = recorded
    return budget_of(session, truth.specimen)


def test_the_representative_trial_has_the_median_peak(same):
    # strengths 1, 1.012, 0.991, 1.006, 0.996 with the third largest in trial 1
    assert representative(same[1]).number == 1
    assert representative(same[1][:4]).number == 1


def test_a_model_without_error_shows_none_and_a_wrong_string_is_resolved(recorded, same):
    session, truth = recorded
    assert not same[0]["resolved"].any()
    assert (same[0]["u_val"] > 0).all()
    assert (same[0]["failed"] == 0).all()
    deader = truth.specimen.with_values({"contact12.normal.D": 3 * truth.specimen["contact12.normal.D"]})
    b, _ = budget_of(session, deader)
    resolved = set(b.index[b["resolved"]])
    assert "rebound_speed" in resolved
    assert not resolved & {"key_bottom", "string_impact", "hammer_speed", "key_release"}  # before or apart from it
    assert b.loc["rebound_speed", "high"] < 0
    assert b.loc["hammer_speed", "reading"] == "cannot resolve a model error"


def test_stated_uncertainty_is_the_error_of_models_whose_parameters_are_off_by_their_u(recorded, same):
    import model

    _, truth = recorded
    b, measured = same
    m = representative(measured)
    tested = ModelUnderTest(truth.specimen, rivals=())
    z = {name: [] for name in ("key_bottom", "string_impact", "hammer_speed", "rebound_speed", "check_height")}
    rng = np.random.default_rng(77)
    drawn = [c for c in cases(m, truth.specimen, 1e-5) if "parameters" in c.group]
    known = uncertain_parameters(truth.specimen, assumed=False)
    assert set(drawn[0].changed) == set(known)
    for _ in range(16):
        # an independent draw, not one of the budget's own
        changed = {
            path: value + u * rng.standard_normal() for path, (value, u) in known.items() if ".normal." not in path
        }
        off = truth.specimen.with_values(changed)
        load = tested.load_of(off, m.force.preload_n)
        run = model.simulate(off, m.force.time_s, m.force.force_n, initial=load.rest)
        change = (run.angle_rad - load.rest.angle_rad)[:, [0, 1, 4]]
        s = find_events(motion_of(load.geometry, run.time_s, change, np.full(3, 1e-5)), m.quiet.stop)
        d = find_events(motion_of(load.geometry, m.time_s, m.change_rad, m.u_rad), m.quiet.stop)
        for name, values in z.items():
            values.append((s[name].value - d[name].value) / b.loc[name, "u_val"])
    for name, values in z.items():
        # 16 draws against a u from 24: the ratio is known to about a quarter
        assert 0.4 < np.sqrt(np.mean(np.square(values))) < 1.7, name


def test_area_metric_of_known_shifts_and_its_published_floor():
    trial = np.array([1.0, 2.0, 4.0])
    assert area_metric(trial + 0.3, trial) == pytest.approx(0.3)
    assert area_metric([1.0, 3.0], [2.0, 2.0]) == pytest.approx(1.0)
    assert np.isnan(area_metric([1.0], trial))
    rng = np.random.default_rng(3)
    for n in (3, 5, 10):
        drawn = [area_metric(rng.normal(7, 2, n), rng.normal(7, 2, n)) / 2 for _ in range(1500)]
        assert area_floor(n, n)[0] == pytest.approx(np.mean(drawn), rel=0.05)
        assert area_floor(n, n)[1] == pytest.approx(np.quantile(drawn, 0.95), rel=0.08)
    # trials against the exact distribution, as published simulations have it: 0.55 and 0.95 at five
    assert area_floor(500, 5) == pytest.approx((0.55, 0.95), abs=0.06)
    assert area_floor(5, 4)[0] > area_floor(5, 5)[0]
    assert np.isnan(area_floor(1, 5)[0])
