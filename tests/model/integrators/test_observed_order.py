"""The compiled step loop shows the order of its method on the real equations."""

from __future__ import annotations

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
