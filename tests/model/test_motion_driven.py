"""Motion-driven runs: force back from the motion it made, uncertainty against actual errors, lift, bad input."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import model
from model.motion_driven import drive
from tests.model.conftest import read_table

COUNT = 2.0 * np.pi / 327680
DOUBLE = Path(__file__).parents[2] / "rig" / "profiles" / "double.toml"
PROFILES = ("forte", "piano", "double")


@cache
def truth(name: str) -> tuple[np.ndarray, np.ndarray, model.Solution]:
    """Times, force and motion of a blow."""
    if name == "double":
        points = tomllib.loads(DOUBLE.read_text())["points"]
        time = np.arange(3201) / 5000.0
        force = np.interp(time, [p["time_s"] for p in points], [p["force_n"] for p in points])
    else:
        time, force = read_table(f"{name}_force.csv").T.copy()
    return time, force, model.simulate(model.load_action(), time, force, tolerance=1e-9)


def counts(angle: np.ndarray, seed: int, jitter: float = 0.5) -> np.ndarray:
    """What an encoder gives for angles: whole counts from a random zero; the zero itself is known."""
    random = np.random.default_rng(seed)
    phase = random.uniform()
    return (np.floor(angle / COUNT + random.normal(0.0, jitter, len(angle)) + phase) - phase + 0.5) * COUNT


@pytest.mark.parametrize("name", PROFILES)
def test_noiseless_round_trip(action: model.Action, name: str) -> None:
    time, force, forward = truth(name)
    driven = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0)
    error = driven.force_n - force
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.max(force)  # measured: 0.0003, 0.0022, 0.0027
    assert np.max(np.abs(driven.angle_rad - forward.angle_rad)) < 1e-3
    assert np.all(np.isnan(driven.u_force_n))


def test_force_has_the_accuracy_of_the_integrator(action: model.Action) -> None:
    time, _, forward = truth("forte")
    motion = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0).fit.motion()
    best = drive(action, motion, time, tolerance=1e-10).force_n
    errors = [np.max(np.abs(drive(action, motion, time, tolerance=tol).force_n - best)) for tol in (1e-5, 1e-6, 1e-8)]
    assert errors[0] < 0.1 and errors[1] < 0.02 and errors[2] < 3e-4, errors  # of 26 N; falls with the tolerance


def test_a_run_that_stops_early_or_is_looked_at_elsewhere_is_the_same(action: model.Action) -> None:
    time, _, forward = truth("forte")
    fit = model.simulate_motion(action, time[:700], forward.angle_rad[:700, 0], members=0).fit
    every = drive(action, fit.motion(), time[:700])
    some = drive(action, fit.motion(), time[100:600:7])
    np.testing.assert_allclose(some.force_n, every.force_n[100:600:7], atol=1e-9)
    assert every.bodies == model.BODIES


def test_lift_is_where_the_inside_view_of_the_force_driven_run_sees_it(action: model.Action) -> None:
    time, force, forward = truth("forte")
    driven = model.simulate_motion(action, time, forward.angle_rad[:, 0], members=0)
    seen = model.simulate(action, time, force, inside=True).inside
    assert seen is not None
    ours, theirs = driven.key_tensions(), seen.key_tensions()
    assert len(ours) == len(theirs) == 2
    for a, b in zip(ours, theirs, strict=True):
        assert abs(a.start_s - b.start_s) < 2e-4 and abs(a.end_s - b.end_s) < 2e-4
    np.testing.assert_array_equal(driven.lifted, driven.columns()["key_lifted"] == 1.0)
    assert 0 < driven.lifted.sum() < 60


def test_scenes_without_some_bodies(action: model.Action) -> None:
    time, _, forward = truth("forte")
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
        ({"output_time_s": []}, "output times: allowed"),
        ({"tolerance": 0.0}, "tolerance: found 0"),
    ):
        with pytest.raises(model.InputError, match=words):
            model.simulate_motion(action, time, angle, **change)
    with pytest.raises(model.InputError, match=r"shapes \(50,\) and \(49,\)"):
        model.simulate_motion(action, time, angle[1:])
