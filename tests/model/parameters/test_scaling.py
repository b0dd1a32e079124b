"""Scaling by path, law, pattern and group."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.parameters.action import CONTACTS


def factors(action: model.Action, changed: model.Action) -> dict[str, float]:
    """Factor of every parameter that differs."""
    return {p: changed[p] / action[p] for p in action.quantities if changed[p] != action[p]}


def test_damping_is_every_contacts_but_the_strings(action: model.Action) -> None:
    found = factors(action, model.scale_parameters(action, {"damping": 0.1}))
    assert found == {f"contact{i:02d}.normal.D": pytest.approx(0.1) for i in range(1, 14) if i != 12}


@pytest.mark.parametrize(
    ("name", "paths"),
    [
        ("hammer.mass", {"hammer.mass"}),
        ("*.mass", {f"{b}.mass" for b in model.BODIES}),
        ("contact0[12].normal.D", {"contact01.normal.D", "contact02.normal.D"}),
        ("joint_friction", {f"{b}.joint_friction.A" for b in model.BODIES}),
        ("friction", {f"contact{i:02d}.friction.A" for i in (1, 4, 7, 10)}),
        ("contact04.friction", {"contact04.friction.A"}),
        ("key.joint_friction", {"key.joint_friction.A"}),
        ("contact04", {f"contact04.normal.{k}" for k in "abc"}),
        ("contact04.normal", {f"contact04.normal.{k}" for k in "abc"}),
        ("jack_spring", {"jack_spring.torque"}),
    ],
)
def test_what_a_name_stands_for(action: model.Action, name: str, paths: set[str]) -> None:
    assert factors(action, model.scale_parameters(action, {name: 0.5})) == dict.fromkeys(paths, 0.5)


def test_factors_multiply_in_turn(action: model.Action) -> None:
    changed = model.scale_parameters(action, {"friction": 2.0, "contact04.friction.A": 0.25})
    assert changed["contact04.friction.A"] == pytest.approx(0.5 * action["contact04.friction.A"])
    assert changed["contact01.friction.A"] == pytest.approx(2.0 * action["contact01.friction.A"])
    assert changed.changed["contact07.friction.A"] == changed["contact07.friction.A"]


def test_a_felt_without_damping_is_left_out_of_a_group(action: model.Action) -> None:
    """A law of felt that has no D: a group that scales it says what it leaves out."""
    some, every = (action.with_laws(dict.fromkeys(names, "stulov")) for names in (["contact02"], CONTACTS))
    with pytest.warns(UserWarning, match=r"`factors` damping: leaves out .* contact02.normal.D \(law stulov\)$"):
        changed = model.scale_parameters(some, {"damping": 0.1})
    assert factors(action, changed) == {
        f"contact{i:02d}.normal.D": pytest.approx(0.1) for i in range(1, 14) if i not in (2, 12)
    }
    model.build_scene(changed)
    with pytest.raises(model.InputError, match="`factors` damping: would change nothing"):
        model.scale_parameters(every, {"damping": 0.1})
    # an identified D of a felt that follows another law in this scene stays in the action, without effect
    kept = some.with_values({"contact02.normal.D": 5.0})
    assert np.array_equal(model.build_scene(kept).vector, model.build_scene(some).vector)
    assert model.quantities_of(action).keys() - model.quantities_of(some).keys() == {"contact02.normal.D"}


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [
        ("dampng", 0.1, "did you mean damping"),
        ("contact4.friction", 0.1, "did you mean contact04.friction"),
        ("hammer.mas", 2.0, "did you mean hammer.mass"),
        ("zzz", 2.0, "groups: damping"),
        ("hammer.mass", -1.0, "`factors` hammer.mass=-1: hammer.mass: found -0.01174, allowed above 0"),
        ("damping", float("nan"), "factor found nan"),
    ],
)
def test_bad_scales_are_refused(action: model.Action, name: str, factor: float, words: str) -> None:
    with pytest.raises(model.InputError) as caught:
        model.scale_parameters(action, {name: factor})
    assert words in str(caught.value) and "\n" not in str(caught.value)
