"""Scenes whose key is prescribed: the motion itself, equations against the twin, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import KeyMotion, Simulation, State, build_scene
from model.kernels import workspace as W
from model.motion_driven.prescribed_key import key_load
from model.simulation.statics import solve_rest
from tests.model.conftest import random_states
from tests.model.kernels.linearised import Evaluation
from tests.model.verification.reference_equations import Twin

ORDER = [1, 2, 3, 4, 0]  # key last


def taylor(q: float, v: float, a: float, jerk: float = 0.0) -> KeyMotion:
    """One piece from -1 s to 1 s that has these values at 0; and a second one, so that pieces are searched."""
    c = np.array([0.0, 0.0, jerk / 6.0, a / 2.0, v, q])
    moved = np.poly1d(c)(np.poly1d([1.0, -1.0])).coef
    moved = np.concatenate([np.zeros(6 - len(moved)), moved])
    return KeyMotion(np.array([-1.0, 0.0, 1.0]), np.array([moved, c]))


def test_motion_is_the_polynomial_and_its_derivatives() -> None:
    c = np.random.default_rng(1).normal(size=6)
    split = np.poly1d(c)(np.poly1d([1.0, 0.3])).coef
    motion = KeyMotion(np.array([0.1, 0.4, 0.9]), np.array([c, split]))
    t = np.array([0.1, 0.25, 0.4, 0.8, 0.9, 0.2])  # backwards too
    for k, column in enumerate(motion.at(t).T):
        np.testing.assert_allclose(column, np.polyval(np.polyder(c, k), t - 0.1), rtol=1e-12)


def test_motion_with_a_jump_is_refused() -> None:
    rows = np.zeros((2, 6))
    rows[1, 3] = 0.5  # the acceleration jumps by 1 rad/s^2
    with pytest.raises(model.InputError, match=r"acceleration jumps by 1 at 0.5 s"):
        KeyMotion(np.array([0.0, 0.5, 1.0]), rows)
    with pytest.raises(model.InputError, match="do not increase"):
        KeyMotion(np.array([0.0, 0.0, 1.0]), np.zeros((2, 6)))
    with pytest.raises(model.InputError, match="found 1 rad, allowed angles that keep the front within"):
        build_scene(model.load_action(), model.SCENES["lifting-key"], key_motion=taylor(1.0, 0.0, 0.0))


def test_accelerations_force_and_rail_equal_the_twin(action: model.Action, twin: Twin) -> None:
    key_mass, g = action["key.mass"], action["gravity.g"]
    for count, (q, v, u) in enumerate(random_states(200, seed=5)):
        a = 20.0 * (u - 30.0)
        scene = build_scene(action, key_motion=taylor(q[0], v[0], a))
        w = Evaluation(scene, q[1:], v[1:], 0.0).w
        others, force = twin.held_key(q, v, a)
        np.testing.assert_allclose(w[W.ACC : W.ACC + 4], others, rtol=1e-10, atol=1e-12 * np.max(np.abs(others)))
        np.testing.assert_array_equal(w[[W.Q + 4, W.V + 4, W.ACC + 4]], [q[0], v[0], a])
        # put back, that force on a free key gives the acceleration that was prescribed
        assert twin.acceleration(q, v, force)[0] == pytest.approx(a, rel=1e-9, abs=1e-7)
        ours, rail = key_load(scene, q[None, ORDER], v[None, ORDER], np.array([a]))
        assert ours[0] == pytest.approx(force, rel=1e-10, abs=1e-9)
        # Newton's law of the key's centre of mass, upwards
        up = -force - key_mass * g
        size = abs(force)
        for name in twin.contacts:
            _, n, _, first, second = twin.gap(name)
            normal, tangential, _ = twin.contact(name, v)
            side = (first == "key") - (second == "key")
            up += side * (normal * n[1] + tangential * n[0])
            size += abs(side) * (normal + abs(tangential))
        arm = twin._point("key", "key.center_of_mass") - twin.pivot["key"]
        reaction = key_mass * (a * arm[0] - v[0] ** 2 * arm[1]) - up
        assert rail[0] == pytest.approx(reaction, rel=1e-9, abs=1e-12 * size), count


def test_states_without_the_key_are_not_taken_for_whole_ones(action: model.Action) -> None:
    scene = build_scene(action, key_motion=taylor(0.0286, 0.0, 0.0))
    rest = solve_rest(scene, 0.0)
    run = Simulation(scene, State(0.0, rest, np.zeros(4)))
    for ask in (
        lambda: run.contact_forces(rest[None], np.zeros((1, 4))),
        lambda: run.probe_forces(rest[None], np.zeros((1, 4))),
        lambda: model.rest_state(action, scene=scene),
    ):
        with pytest.raises(
            model.InputError,
            match=r"found states of 4 .* allowed all 5|found \(1, 4\) angles .* allowed \(m, 5\) twice",
        ):
            ask()
    normal, _ = run.contact_forces(np.append(rest, 0.0286)[None], np.zeros((1, 5)))
    assert normal[0, scene.contacts.index("contact01")] > 0.5
    failing = Simulation(scene, State(0.0, rest, np.zeros(4)), max_steps=1)
    with pytest.raises(model.IntegrationError, match="too many steps"):
        failing.advance(1.0, np.array([0.0, 1.0]), np.array([0.0, 1.0]))
