"""Regulation and touch in scenes: targets are measured on the loaded geometry, and met."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.regulation.measures import contact_penetration, pivot_displacements


def test_all_targets_are_met_in_the_scene(action: model.Action) -> None:
    bending = model.load_scene("flexible-shank").on(action)
    done = model.regulation.regulate(bending)
    assert done.action.scene == bending.scene
    found = model.regulation.measure(done.action)
    for target in model.regulation.TARGETS:
        assert found.value_m[target.name] == pytest.approx(target.wanted_m, abs=2.1e-5), target.name
    weights = model.touch.weigh(done.action)
    assert 0.3 < weights.down_n < 0.6 and 0.05 < weights.up_n < weights.down_n


def test_gaps_at_rest_are_those_of_the_loaded_joint(action: model.Action) -> None:
    """The geometry by hand against the kernels' own, where joints have given."""
    own = model.load_scene("giving-hammer").on(action.with_values({"hammer_pin.load.y": 3.0}))
    rest, at_rest = model.hand_set_rest(own), model.rest_state(own)
    moved = pivot_displacements(own, rest)
    assert abs(moved["hammer"]) > 1e-5
    np.testing.assert_allclose(rest, at_rest.angle_rad, atol=1e-9)
    for contact, depth in zip(at_rest.contacts, at_rest.penetration_m, strict=True):
        if contact in own.structure or contact == "balance_rail":
            continue
        assert contact_penetration(own, contact, rest, moved).penetration_m == pytest.approx(depth, abs=1e-9), contact


@pytest.mark.parametrize("name", ["key-whippen", "motor-arm"])
def test_what_needs_a_played_key_says_so(action: model.Action, name: str) -> None:
    chosen, blow = model.load_scene(name).on(action), model.force_table("forte")
    for ask in (
        lambda: model.regulation.regulate(chosen),
        lambda: model.measure_touch(chosen),
        lambda: model.touch.hammer_speeds(chosen, [5.0]),
        lambda: model.study.compare(chosen, *blow, []),
    ):
        with pytest.raises(model.InputError, match="allowed one with all bodies driven by force_n"):
            ask()
