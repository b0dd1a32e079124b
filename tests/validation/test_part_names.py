"""Parameters by the names of parts: screws, bodies, contacts of one and of two parts, effects; and what is no path."""

from __future__ import annotations

import re

import pytest

import model
from model.regulation.screws import REST_RAIL, SCREWS
from validation.part_names import PATH, name_parts, part_name
from validation.part_names import SCREWS as NAMED


@pytest.fixture(scope="module")
def action() -> model.Action:
    return model.load_action()


def test_a_screw_has_its_own_name() -> None:
    assert set(NAMED) == {screw.path for screw in (*SCREWS, REST_RAIL)}


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("contact04.second.x", "back-check wire"),
        ("contact04.second.y", "place of the back check"),
        ("contact07.friction.A", "friction between jack and knuckle"),
        ("contact08.first.radius", "radius between jack and let-off button"),
        ("contact13.first.x", "place where hammer and rest rail touch"),
        ("contact12.normal.D", "damping of the felt between hammer and string"),
        ("contact03.normal.a", "stiffness of the felt of the back of the key"),
        ("contact01.stulov.tau", "hysteresis of the felt of the capstan"),
        ("repetition.joint_friction.B1", "joint friction of the repetition lever"),
        ("jack_spring.torque", "torque of the jack spring"),
        ("shank.frequency_hz", "frequency of the shank"),
        ("hammer_pin.stiffness", "stiffness of the hammer's pin"),
    ],
)
def test_a_parameter_is_called_by_its_part(action: model.Action, path: str, name: str) -> None:
    assert part_name(path, action) == name


def test_every_parameter_of_the_action_has_words_for_a_name(action: model.Action) -> None:
    paths = [path for path in (*action.quantities, *action.effects) if PATH.fullmatch(path)]
    assert len(paths) > 300
    for path in paths:
        assert re.fullmatch(r"[a-z][a-z' -]+", name_parts(path, action).removesuffix(f" ({path})")), path


def test_the_path_stands_in_brackets_once(action: model.Action) -> None:
    text = "mostly contact01.second.y. Turn contact01.second.y, not (contact02.first.y); trial.read stays."
    assert name_parts(text, action) == (
        "mostly place of the capstan (contact01.second.y). Turn place of the capstan, not (contact02.first.y); "
        "trial.read stays."
    )
    assert name_parts(name_parts("key.mass", action), action) == "mass of the key (key.mass)"
