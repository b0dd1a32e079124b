"""Parameter files: every number has unit, source and uncertainty; a bad file is refused by key, value and range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
from model.parameters.action import ACTIONS, TEMPLATE


def edited(tmp_path: Path, old: str, new: str) -> Path:
    text = (ACTIONS / f"{TEMPLATE}.toml").read_text(encoding="utf-8")
    assert text.count(old) >= 1
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


def test_every_quantity_is_documented(action: model.Action) -> None:
    assert len(action.quantities) > 200
    for path, q in action.quantities.items():
        assert q.source and q.unit and q.u >= 0, path
        assert q.basis in ("measured", "printed digits", "assumed")


def test_printed_digits_of_a_few_rows(action: model.Action) -> None:
    """Values read again from thesis Tables A.1, A.3, A.6, A.8, A.9."""
    for path, value in {
        "key.mass": 0.12008, "hammer.center_of_mass.x": -0.1022, "drive.point.x": 0.2278,
        "contact10.second.radius": 0.0552, "contact04.first.radius": 0.0549, "contact12.normal.D": 0.175,
        "contact07.normal.a": 3.92e11, "contact09.normal.b": -1.68e7, "contact10.friction.B1": 0.73,
        "repetition.joint_friction.A": 0.00247, "repetition_spring.angle": 0.832, "jack_spring.torque": 0.0042,
    }.items():  # fmt: skip
        assert action[path] == value, path
    # half a digit, rectangular
    assert action.quantities["key.mass"].u == pytest.approx(0.5e-5 / np.sqrt(3), rel=0.02)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass = { value = 0.12008", "mass = { value = -0.12008", "key.mass: found -0.12008, allowed above 0"),
        ("mass = { value = 0.12008", "mass = { value = nan", "key.mass: found nan"),
        ("mass = { value = 0.12008", 'mass = { value = "heavy"', "key.mass: found 'heavy', allowed a number"),
        ('mass = { value = 0.12008, unit = "kg"', 'mass = { value = 120.08, unit = "g"', 'key.mass.unit: found "g"'),
        ("mass = { value = 0.12008", "weight = { value = 0.12008", "unknown key"),
        ("first.radius = { value = 0.0097", "first.radius = { value = 9.7", "radius: found 9.7, allowed above 0 to 1"),
        ('second.shape = "hybrid"', 'second.shape = "square"', "contact07.second.shape: found 'square'"),
        ('basis = "assumed"', 'basis = "guessed"', "basis: found 'guessed'"),
        ("u = 2.9e-06", "u = -1", ".u: found -1"),
        ("name = ", "name == ", "not valid TOML"),
        ("second.normal.x = { value = 0.904", "second.normal.x = { value = 0.1", "length found"),
        ("second.arc_start = { value = 1.300", "second.arc_start = { value = 2.0", "allowed below arc_end"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = edited(tmp_path, old, new)
    with pytest.raises(model.InputError) as caught:
        model.load_action(path)
    message = str(caught.value)
    assert words in message and "mine.toml" in message and "\n" not in message


def test_a_missing_parameter_is_named(tmp_path: Path) -> None:
    text = (ACTIONS / f"{TEMPLATE}.toml").read_text(encoding="utf-8")
    lines = text.splitlines()
    start = lines.index("[hammer]")
    inertia = next(i for i in range(start, len(lines)) if lines[i].startswith("inertia"))
    path = tmp_path / "mine.toml"
    path.write_text("\n".join(lines[:inertia] + lines[inertia + 1 :]), encoding="utf-8")
    with pytest.raises(model.InputError, match="hammer.inertia: missing"):
        model.load_action(path)


def test_unknown_action_lists_the_built_in_ones() -> None:
    with pytest.raises(model.InputError, match="built in: hirschkorn2004"):
        model.load_action("steinway")
    with pytest.raises(model.InputError, match="cannot be read"):
        model.load_action("nowhere/steinway.toml")


def test_overrides_and_off_switches(action: model.Action) -> None:
    changed = action.with_values({"contact04.friction.A": 0.3, "contact07.friction": 0, "key.joint_friction": 0})
    assert changed["contact04.friction.A"] == 0.3
    assert changed["contact07.friction.A"] == 0 and changed["key.joint_friction.A"] == 0
    assert action["contact04.friction.A"] == 0.434
    assert set(changed.changed) == {"contact04.friction.A", "contact07.friction.A", "key.joint_friction.A"}
    assert changed.content() != action.content()


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("contact04.frction.A", 0.1, "did you mean contact04.friction.A"),
        ("contact04.friction", 0.1, "allowed 0"),
        ("hammer.mass", -1, "hammer.mass: found -1, allowed above 0"),
        ("contact14.friction", 0, "unknown path"),
        ("hammer.mass", float("inf"), "found inf"),
        ("motor_arm.spring_stiffness", 2e3, r"allowed from 0 to 1000;"),
        ("motor_drive.limit_softness", 0.6, r"allowed from 0\.001 to 0\.5;"),
    ],
)
def test_bad_overrides_are_refused(action: model.Action, path: str, value: float, words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        action.with_values({path: value})


def test_a_normal_may_be_as_long_along_an_axis_as_across() -> None:
    for x, y in ((0.0, -1.0999), (0.0, 1.05), (-1.09, 0.0), (0.77, 0.77)):
        changed = model.load_action(overrides={"contact13.second.normal.x": x, "contact13.second.normal.y": y})
        assert changed["contact13.second.normal.y"] == y
    with pytest.raises(model.InputError, match=r"length found 1\.5"):
        model.load_action(overrides={"contact13.second.normal.x": 1.09, "contact13.second.normal.y": 1.09})
    with pytest.raises(model.InputError, match=r"allowed from -1\.1 to 1\.1"):
        model.load_action(overrides={"contact13.second.normal.x": 1.2})


def test_what_is_done_to_an_action_is_not_in_the_next_of_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = (ACTIONS / f"{TEMPLATE}.toml").read_text(encoding="utf-8")
    path.write_text(text + '\n[identification]\nnames = ["hammer.mass"]\n', encoding="utf-8")
    first = model.load_action(path)
    mass = first["hammer.mass"]
    first.quantities.clear()  # type: ignore[attr-defined]
    first.identification["names"].append("key.mass")
    again = model.load_action(path)
    assert again["hammer.mass"] == mass and again.identification["names"] == ["hammer.mass"]
