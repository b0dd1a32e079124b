"""The scene of an action is built once, while the action is among the latest asked for."""

from __future__ import annotations

import model
from model.scene import build


def test_an_action_has_one_scene_per_choice_and_another_action_another(action: model.Action) -> None:
    whole, key = model.SceneChoice(), model.load_scene("key")
    assert model.build_scene(action) is model.build_scene(action, whole) is model.build_scene(whole.on(action))
    assert model.build_scene(action, key) is not model.build_scene(action)
    heavier = action.with_values({"gravity.g": 9.0})
    assert model.build_scene(heavier).vector[0] == 9.0 != model.build_scene(action).vector[0]


def test_no_more_than_some_are_kept_and_no_action_is_taken_for_one_that_is_gone(action: model.Action) -> None:
    for k in range(build.MOST + 20):
        assert model.build_scene(action.with_values({"gravity.g": 1.0 + k / 100})).vector[0] == 1.0 + k / 100
    assert build._cached_scene.cache_info().currsize == build.MOST
