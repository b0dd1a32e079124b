"""The compiled step loop shows the order of its method on the real equations."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.integrators.methods import METHODS, get_method
from tests.model.integrators.observed_order import free_orders, free_scene, prescribed_order


@pytest.fixture(scope="module")
def free() -> model.Scene:
    return free_scene()


@pytest.mark.parametrize("method", METHODS)
def test_order_at_the_end_and_inside_the_steps(free: model.Scene, method: str) -> None:
    end, inside = free_orders(free, method)
    assert METHODS[method].order - 0.3 < end < METHODS[method].order + 1.2
    assert inside > METHODS[method].dense_order - 0.2


@pytest.mark.parametrize("method", METHODS)
def test_methods_keep_their_order_under_a_prescribed_motion(action: model.Action, method: str) -> None:
    order = prescribed_order(action, method)
    assert METHODS[method].order - 0.4 < order < METHODS[method].order + 1.2


def test_an_unknown_method_is_refused_with_the_names_of_the_known_ones() -> None:
    with pytest.raises(model.InputError, match="method: found 'radau5', allowed rodas4p, rodas5p"):
        get_method("radau5")


@pytest.mark.parametrize("method", METHODS)
def test_order_under_a_force_that_rises_from_the_first_instant_on(method: str) -> None:
    """The slope of a table holds at its first point too: without it the first step is of order 2."""
    off = {f"contact{i:02d}": 0 for i in range(1, 14)} | {"key.joint_friction": 0}
    scene = model.build_scene(model.load_action(overrides=off), model.load_scene("key"))

    def end(step: float) -> np.ndarray:
        start = model.State(0.0, np.array([0.02]), np.array([-0.1]), step)
        run = model.Simulation(scene, start, tolerance=1e-2, method=method, largest_step_s=step)
        run.advance(0.03, np.array([0.0, 1.0]), np.array([0.0, 50.0]))
        assert run.work()["n_steps"] == round(0.03 / step)
        return np.concatenate([run.state.angle_rad, run.state.speed_rad_per_s])

    truth, steps = end(1e-4), np.array([3e-3, 1.5e-3, 7.5e-4])
    errors = [float(np.abs(end(step) - truth).max()) for step in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > get_method(method).order - 0.5
