"""Runs under a prescribed motion side by side in lanes: single runs but for rounding, bits without neighbours."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import KeyMotion
from model.motion_driven.prescribed_key import PrescribedMotion, run_prescribed, run_prescribed_lanes
from model.scene.selection import load_scene
from tests.model.key_blows import blow

Run = tuple[model.Action, KeyMotion, np.ndarray]


def runs(action: model.Action, count: int, scene: str = "whole") -> list[Run]:
    """A blow's key, as strong and as late as drawn, of actions that differ; the fourth has pieces of its own."""
    time, _, forward = blow("forte")
    rng = np.random.default_rng(4)
    fit = model.simulate_motion(action, time[:700:2], forward.angle_rad[:700:2, 0], members=0).fit
    out = []
    for i in range(count):
        drawn = action.with_values({"hammer.mass": action["hammer.mass"] * (1.0 + 0.05 * rng.standard_normal())})
        motion = fit.motion(fit.coefficients * (1.0 + 0.02 * rng.standard_normal()))
        if i == 3:
            motion = KeyMotion(motion.break_s[:-40] + 0.003, motion.coefficient[:-40])
        at = np.linspace(motion.break_s[0], motion.break_s[-1], 301)
        out.append((load_scene(scene).apply_to(drawn), motion, at))
    return out


def motions(some: list[Run]) -> list[PrescribedMotion]:
    found = run_prescribed_lanes(some, tolerance=1e-6)
    assert all(isinstance(one, PrescribedMotion) for one in found)
    return [one for one in found if isinstance(one, PrescribedMotion)]


@pytest.mark.parametrize("scene", ["whole", "lifting-key", "giving-joints", "string"])
def test_members_are_single_runs_to_the_tolerance(action: model.Action, scene: str) -> None:
    some = runs(action, 5 if scene == "whole" else 2, scene)
    for (drawn, motion, at), one in zip(some, motions(some), strict=True):
        alone = run_prescribed(drawn, motion, at, tolerance=1e-6)
        fine = run_prescribed(drawn, motion, at, tolerance=1e-9)
        error = float(np.max(np.abs(alone.angle_rad - fine.angle_rad)))
        assert one.bodies == alone.bodies
        assert np.max(np.abs(one.angle_rad - alone.angle_rad)) <= max(1e-7, error)
        if scene == "whole":  # of the others the front is prescribed
            np.testing.assert_allclose(one.angle_rad[:, 0], motion.evaluate(at)[:, 0], atol=1e-14)


def test_no_bit_depends_on_the_neighbours(action: model.Action) -> None:
    some = runs(action, 11)
    whole = motions(some)
    for chosen in ([3], [10, 0], [5, 3, 1, 7, 2, 2, 9, 0, 4]):
        for i, one in zip(chosen, motions([some[i] for i in chosen]), strict=True):
            np.testing.assert_array_equal(one.angle_rad, whole[i].angle_rad)
            np.testing.assert_array_equal(one.speed_rad_per_s, whole[i].speed_rad_per_s)
            assert one.counters == whole[i].counters


def test_a_run_that_fails_stays_alone(action: model.Action) -> None:
    some = runs(action, 3)
    wild = KeyMotion(some[1][1].break_s, 1e5 * some[1][1].coefficient)
    found = run_prescribed_lanes([some[0], (action, wild, some[1][2]), some[2]], tolerance=1e-6)
    assert isinstance(found[1], model.errors.IntegrationError)
    for i in (0, 2):
        one = found[i]
        assert isinstance(one, PrescribedMotion)
        np.testing.assert_array_equal(one.angle_rad, motions([some[i]])[0].angle_rad)
