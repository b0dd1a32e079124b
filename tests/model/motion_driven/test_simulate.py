"""Motion-driven runs: force back from the motion it made, uncertainty against actual errors, lift, bad input."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.motion_driven.prescribed_key import run_prescribed
from tests.model.key_blows import blow, counted, key_truth


def test_noiseless_round_trip(action: model.Action) -> None:
    time, force, forward = blow("forte")
    driven = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0)
    error = driven.force_n - force
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.max(force)  # measured: 0.0003
    assert np.max(np.abs(driven.angle_rad - forward.angle_rad)) < 1e-3
    assert np.all(np.isnan(driven.u_force_n))


def test_force_has_the_accuracy_of_the_integrator(action: model.Action) -> None:
    time, _, forward = blow("forte")
    motion = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0).fit.motion()
    best = run_prescribed(action, motion, time, tolerance=1e-10).force_n
    errors = [
        np.max(np.abs(run_prescribed(action, motion, time, tolerance=tol).force_n - best)) for tol in (1e-5, 1e-6, 1e-8)
    ]
    assert errors[0] < 0.1 and errors[1] < 0.02 and errors[2] < 3e-4, errors  # of 26 N; falls with the tolerance


def test_a_run_that_stops_early_or_is_looked_at_elsewhere_is_the_same(action: model.Action) -> None:
    time, _, forward = blow("forte")
    fit = model.simulate_motion(action, time[:700], forward.angle_rad[:700, 0], members=0).fit
    every = run_prescribed(action, fit.motion(), time[:700])
    some = run_prescribed(action, fit.motion(), time[100:600:7])
    np.testing.assert_allclose(some.force_n, every.force_n[100:600:7], atol=1e-9)
    assert every.bodies == model.BODIES


def test_lift_is_where_the_inside_view_of_the_force_driven_run_sees_it(action: model.Action) -> None:
    time, force, forward = blow("forte")
    driven = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0)
    seen = model.simulate(action, time, force, inside=True).inside
    assert seen is not None
    ours, theirs = driven.key_tensions(), seen.key_tensions()
    assert len(ours) == len(theirs) == 2
    for a, b in zip(ours, theirs, strict=True):
        assert abs(a.start_s - b.start_s) < 2e-4 and abs(a.end_s - b.end_s) < 2e-4
    np.testing.assert_array_equal(driven.lifted, driven.columns()["key_lifted"] == 1.0)
    assert 0 < driven.lifted.sum() < 60


def test_any_clock_and_uneven_times(action: model.Action) -> None:
    time, force, forward = blow("forte")
    late = model.simulate_motion(action, time[:700] + 4e5, forward.angle_rad[:700, 0], members=0)
    soon = model.simulate_motion(action, time[:700], forward.angle_rad[:700, 0], members=0)
    assert late.time_s[0] == 4e5
    assert np.sqrt(np.mean((late.force_n - soon.force_n) ** 2)) < 0.05  # the late clock ticks in 6e-11 s
    kept = np.random.default_rng(8).random(len(time)) < 0.8
    uneven = model.simulate_motion(action, time[kept], forward.angle_rad[kept, 0], members=0)
    assert np.sqrt(np.mean((uneven.force_n - force[kept]) ** 2)) < 0.01 * force.max()


def test_scenes_without_some_bodies(action: model.Action) -> None:
    time, _, forward = blow("forte")
    angle = forward.angle_rad[:700, 0]
    driven = model.simulate_motion(action, time[:700], angle, members=0, scene="key-whippen")
    assert driven.bodies == ("key", "whippen") and driven.angle_rad.shape == (700, 2)
    with pytest.raises(model.InputError, match="nothing but the prescribed key"):
        model.simulate_motion(action, time[:700], angle, members=0, scene="key")


def test_bad_arguments(action: model.Action) -> None:
    time, angle = np.arange(50) / 1000.0, np.zeros(50)
    for change, words in (
        ({"members": 1}, "members of the ensemble: found 1"),
        ({"u_zero_rad": -1.0}, "uncertainty of the zero: found -1"),
        ({"resolution_rad": -1.0}, "resolution of the key's angle: found -1"),
        ({"jitter_rad": float("nan")}, "jitter of the key's angle: found nan"),
        ({"output_time_s": [0.0, 0.2]}, "output times: found 0 to 0.2 s, allowed within the table"),
        ({"output_time_s": []}, "output times: found none"),
        ({"tolerance": 0.0}, "tolerance: found 0"),
    ):
        with pytest.raises(model.InputError, match=words):
            model.simulate_motion(action, time, angle, **change)
    with pytest.raises(model.InputError, match=r"shapes \(50,\) and \(49,\)"):
        model.simulate_motion(action, time, angle[1:])


def test_force_from_counts_is_within_its_uncertainty(action: model.Action) -> None:
    """Half a forte, one seed: the ensemble's spread against the actual error; the wide trial is below."""
    time, truth = key_truth("forte")
    half = slice(0, 1000)
    driven = model.simulate_motion(action, time[half], counted(truth, 3)[half])
    error = driven.force_n - blow("forte")[1][half]
    inside = np.abs(error) < driven.coverage_factor * driven.u_force_n
    assert 0.9 < inside.mean() <= 1.0
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.max(driven.force_n)
    assert 0.5 < np.sqrt(np.mean(error**2) / np.mean(driven.u_force_n**2)) < 1.5
    # the zero's uncertainty shows where felt is pressed: at rest the key lies on its back rest
    loose = model.simulate_motion(action, time[half], counted(truth, 3)[half], u_zero_rad=2e-5)
    assert loose.u_force_n[100] > 1.1 * driven.u_force_n[100]


def test_a_key_at_rest_takes_no_force(action: model.Action) -> None:
    rest = model.rest_state(action).angle_rad[0]
    driven = model.simulate_motion(action, np.arange(200) / 1000.0, np.full(200, rest))
    assert np.max(np.abs(driven.force_n)) < 1e-6 and np.max(driven.u_force_n) < 1e-5
    assert not driven.lifted.any() and driven.key_tensions() == []
