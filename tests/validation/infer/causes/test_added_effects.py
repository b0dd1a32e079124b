"""Effects that the model lacks, as causes: what is run is the model in the scene that has so much of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from tests.validation.infer import toy
from validation.events.key_lift import SCALE_RADIUS_M
from validation.infer import hypotheses
from validation.infer.causes import explain
from validation.infer.causes.responses import Point, Responses, knot_noise_n
from validation.infer.channels import FORCE_GAIN
from validation.infer.hypotheses import ADDED, ALL, JOINTS, STEP, list_addable_effects, sources
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import Posterior

ACTION = model.load_action()
BY_NAME = {source.name: source for source in list_addable_effects(ACTION)}
SHANK, RAIL = BY_NAME[f"{ADDED}shank.frequency_hz"], BY_NAME[f"{ADDED}balance_rail.normal.c"]
PRELOAD_N = 0.05


@pytest.fixture(scope="module")
def responses() -> Responses:
    return Responses(ModelUnderTest(ACTION), [toy.short_forte(PRELOAD_N)], (SHANK, RAIL, BY_NAME[JOINTS]))


def test_half_the_stiffness_is_twice_the_effect() -> None:
    sized = {"added hammer_pin.stiffness": 5e4, "added string.tension": 335.0, "added contact12.stulov.tau": 1e-4}
    for name, value in sized.items():
        assert BY_NAME[name].size(2.0, 0.02) == pytest.approx((value, 0.01 * value))
        scene = BY_NAME[name].scene(ACTION, 2.0)
        assert scene is not None and dict(scene.values)[name.removeprefix(ADDED)] == pytest.approx(value)
    assert BY_NAME[JOINTS].size(2.0, 0.02) == pytest.approx((0.5, 0.01))


def test_what_the_action_has_is_not_added() -> None:
    strung = model.scene_of({"effects": ["string"], "contact12": {"law": "stulov"}}, "mine").on(ACTION)
    names = {source.name for source in list_addable_effects(strung)}
    assert not any("string" in name or "contact12" in name for name in names) and SHANK.name in names
    assert RAIL.scene(model.load_scene("giving-joints").on(ACTION), 1.0) is None


def test_an_identified_damping_keeps_no_law_from_being_added() -> None:
    damped = ACTION.with_values({f"contact{i:02d}.normal.D": 0.1 + 0.02 * i for i in range(1, 14)})
    memories = [source for source in list_addable_effects(damped) if source.laws]
    assert len(memories) > 4
    for source in memories:
        scene = source.scene(damped, 1.0)
        assert scene is not None
        ((contact, law),) = source.laws
        assert model.build_scene(scene.on(damped)).contacts and scene.on(damped).law(contact) == law


def test_an_amount_runs_its_scene_and_the_key_is_read_with_its_lift(responses: Responses) -> None:
    (trial,), base = responses.trials, responses.base
    none, some = responses.differences([Point(((0, 0.01),)), Point(((1, 2.0),))])
    assert base is not None and none is not None and some is not None
    assert np.array_equal(none, base)
    scene = RAIL.scene(ACTION, 2.0)
    assert scene is not None
    lifting = scene.on(ACTION)
    rest = model.rest_state(lifting, force_n=PRELOAD_N)
    solution = model.simulate(
        lifting, trial.force_time_s, trial.force_n, initial=rest, output_time_s=trial.time_s, tolerance=1e-6
    )
    turn = np.asarray(solution.angle_rad) - rest.angle_rad
    key = turn[:, 0] + turn[:, 5] / SCALE_RADIUS_M
    assert np.abs(turn[:, 5]).max() / SCALE_RADIUS_M > 1e-3
    expected = -np.concatenate([key, turn[:, 1], turn[:, 4]])
    assert some[0] == pytest.approx(expected, abs=3e-4)


def test_effects_that_exclude_each_other_cannot_be_run(responses: Responses) -> None:
    assert responses.differences([Point(((1, 1.0), (2, 1.0)))]) == [None]


@pytest.mark.parametrize(("effects", "added"), [(True, True), (False, False)])
def test_effects_are_candidates_only_where_they_are_asked_for(responses, monkeypatch, effects, added) -> None:
    listed = []
    monkeypatch.setattr(explain, "Responses", lambda tested, trials, these: listed.extend(these) or Silent())
    found = explain.explain_observed(ModelUnderTest(ACTION), responses.trials, effects)
    assert not found.changes and any(source.added for source in listed) == added and len(listed) > len(BY_NAME)


class Silent:
    """Responses of a model that cannot follow."""

    base = None


def test_what_some_trials_have_does_not_reach_a_point_where_all_are_alike(responses: Responses) -> None:
    (trial,) = responses.trials
    gain = next(s for s in sources(ACTION, trial) if s.name == FORCE_GAIN)
    alike = Responses(ModelUnderTest(ACTION), [replace(trial, number=n) for n in range(1, 5)], [gain])
    shared, step = (
        next(i for i, c in enumerate(alike.candidates) if (c.profile, c.first) == kind)
        for kind in ((ALL, 1), (STEP, 3))
    )
    assert alike.exact_differences([Point(((shared, 0.5), (step, 1.0)))])[0] is not None
    (found,) = alike.differences([Point(((shared, 0.5),))])
    assert found is not None and found == pytest.approx(np.tile(found[0], (4, 1)), abs=1e-12)


def test_central_differences_of_one_gap_moved_by_two_lengths_are_equal() -> None:
    trial = toy.short_forte(PRELOAD_N)
    listed = [s for s in sources(ACTION, trial) if s.name in ("contact08.first.radius", "contact08.second.y")]
    moved = Responses(ModelUnderTest(ACTION), [trial], listed)
    assert moved.base is not None
    radius, gap = moved.columns([(Point(), 0, 0), (Point(), 0, 1)], 2 * [moved.base], central=True)
    assert np.abs(radius).max() > 1e-3 and radius == pytest.approx(-gap, rel=1e-3, abs=1e-6)


def test_force_that_bends_between_samples_is_as_uncertain_as_a_twelfth_of_its_second_difference() -> None:
    trial = replace(toy.short_forte(PRELOAD_N), noise_n=0.02)
    time_s = trial.force_time_s
    straight = knot_noise_n(replace(trial, force_n=3.0 * (time_s - time_s[0])))
    step_s = float(np.median(np.diff(time_s)))
    bent = knot_noise_n(replace(trial, force_n=0.6 * ((time_s - time_s[0]) / step_s) ** 2))
    assert bent[1:-1] / straight[1:-1] == pytest.approx(np.hypot(1.0, 1.2 / 12.0 / 0.02), rel=0.02)


def test_what_an_identification_knows_of_a_mass_is_relative_where_the_cause_is_a_factor(monkeypatch) -> None:
    """Its u is in SI there: taken as a logarithm, an identified mass was known some 60,000 times too well."""
    value, names = ACTION["whippen.inertia"], ("whippen.inertia", "contact08.second.y")
    known = Posterior(
        names, tuple((name,) for name in names), (0.05 * value, 2e-4), (False, False), np.zeros((0, 2)), np.zeros(0), {}
    )
    monkeypatch.setattr(hypotheses, "posterior_of", lambda action: known)
    listed = [s for s in sources(ACTION, toy.short_forte(PRELOAD_N)) if s.name in names]
    assert sorted(s.name for s in listed) == sorted(names)
    root = hypotheses.known_root(ACTION, listed)
    u = {s.name: float(np.sqrt((root @ root.T)[i, i])) * s.wrong for i, s in enumerate(listed)}
    assert u == pytest.approx({"whippen.inertia": 0.05, "contact08.second.y": 2e-4})
