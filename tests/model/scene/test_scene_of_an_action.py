"""An action that carries its scene takes it wherever it goes, into files and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model

SCENES = ("lifting-key", "string", "giving-hammer", "without-string", "key-whippen", "motor-drive", "compliant-tip")


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_put_on_an_action_is_the_scene_it_is_built_in(name: str) -> None:
    choice = model.load_scene(name)
    carried = choice.on(model.load_action())
    named = model.build_scene(carried, choice)
    own = model.build_scene(carried)
    assert own.bodies == named.bodies and own.contacts == named.contacts
    assert own.vector.tobytes() == named.vector.tobytes()
    assert all(a.tobytes() == b.tobytes() for a, b in zip(own.tables, named.tables, strict=True))


@pytest.mark.parametrize("name", SCENES)
def test_a_file_keeps_scene_laws_and_values(name: str, tmp_path: Path) -> None:
    laws = {} if name == "key-whippen" else {"contact02": "stulov"}
    action = model.load_scene(name).on(model.load_action().with_laws(laws))
    if name == "string":
        action = action.with_values({"string.modes": 12.0})
    model.write_action(action, tmp_path / "mine.toml")
    read = model.load_action(tmp_path / "mine.toml")
    assert read.scene == action.scene and read.content() == action.content()
    assert model.build_scene(read).vector.tobytes() == model.build_scene(action).vector.tobytes()


def test_jobs_take_the_scene_of_the_action() -> None:
    lifting = model.load_scene("lifting-key").on(model.load_action())
    time_s, force_n = (column[:300] for column in model.force_table("forte"))
    own = model.simulate(lifting, time_s, force_n)
    assert own.bodies[-1] == "key_lift"
    np.testing.assert_array_equal(
        own.angle_rad, model.simulate(lifting, time_s, force_n, scene="lifting-key").angle_rad
    )
    assert model.simulate(lifting, time_s, force_n, scene="whole").bodies == model.BODIES
    found = model.sensitivities(lifting, (time_s, force_n), ["balance_rail.normal.c"])
    assert found.angle_names[-1] == "key_lift" and np.any(found.d_angles)
    assert "balance_rail.normal.c" in model.sensitivity.effective_paths(lifting)
    (member,) = model.simulate_many(lifting, {"forte": (time_s, force_n)}, {"own": {}})
    assert member.solution is not None
    np.testing.assert_array_equal(member.solution.angle_rad, own.angle_rad)


def test_content_tells_scenes_apart() -> None:
    plain = model.load_action()
    assert model.load_scene("whole").on(plain).content() == plain.content()
    assert len({model.load_scene(name).on(plain).content() for name in SCENES}) == len(SCENES)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[scene]\neffects = ["sting"]', r"mine\.toml: scene: effects: found 'sting', allowed"),
        ('[scene]\neffects = "string"', r"mine\.toml: scene\.effects: found 'string', allowed a list of names"),
        ("[scene]\nefects = []", r"mine\.toml: scene\.efects: unknown key; allowed bodies, without, effects"),
        ('[scene]\nbodies = ["key", "jack"]', r"mine\.toml: scene: bodies: jack hangs from the whippen"),
    ],
)
def test_a_scene_that_cannot_be_is_refused_in_one_line(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    model.write_action(model.load_action(), file)
    file.write_text(f"{file.read_text(encoding='utf-8')}\n{text}\n", encoding="utf-8")
    with pytest.raises(model.InputError, match=words) as caught:
        model.build_scene(model.load_action(file))
    assert "\n" not in str(caught.value)
