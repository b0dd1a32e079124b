"""Scenes: built-in names, files, and that what is left out leaves the physics of the rest alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
from tests.model.conftest import read_table


def test_without_string_the_hammer_flies_on(action: model.Action) -> None:
    force = read_table("forte_force.csv")[:700]
    at = np.linspace(0.05, 0.13, 161)
    whole = model.simulate(action, force[:, 0], force[:, 1], output_time_s=at)
    without = model.simulate(action, force[:, 0], force[:, 1], output_time_s=at, scene="without-string")
    height = model.observables.hammer_height_m(action, whole.angle_rad)
    before = at < at[np.argmax(height < 0)]
    assert 0.3 < np.mean(before) < 0.95
    assert np.abs(whole.angle_rad - without.angle_rad)[before].max() < 2e-5
    assert model.observables.hammer_height_m(action, without.angle_rad).min() < -0.02 < height.min()


def test_key_alone_moves_as_its_equation_says(action: model.Action, tmp_path: Path) -> None:
    """A scene from a file; the free key's angular acceleration by hand."""
    path = tmp_path / "key.toml"
    path.write_text('bodies = ["key"]\nwithout = ["contact02", "contact03"]\noutputs = ["contact_forces", "energy"]\n')
    free = action.with_values({"key.joint_friction": 0.0})
    start = model.State(0.0, np.array([0.01]), np.zeros(1))
    out = model.simulate(free, [0.0, 1e-3], [5.0, 5.0], scene=path, initial=start, tolerance=1e-9)
    assert out.bodies == ("key",) and out.contacts == () and out.energy is not None
    m, x, y = free["key.mass"], free["key.center_of_mass.x"], free["key.center_of_mass.y"]
    arm = np.cos(0.01) * free["drive.point.x"] - np.sin(0.01) * free["drive.point.y"]
    weight = m * free["gravity.g"] * (np.cos(0.01) * x - np.sin(0.01) * y)
    a = (-5.0 * arm - weight) / (free["key.inertia"] + m * (x * x + y * y))
    assert out.speed_rad_per_s[-1, 0] == pytest.approx(a * 1e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('bodies = ["jack", "key"]', "add whippen or leave out jack"),
        ('bodies = ["hammer"]', "found no key"),
        ('bodies = ["kye"]', "found 'kye', allowed key, whippen"),
        ('without = ["contact14"]', "found 'contact14', allowed contact01"),
        ('outputs = ["force"]', "allowed contact_forces, energy, inside"),
        ('contacts = ["contact01"]', "contacts: unknown key; allowed bodies, without, outputs, effects"),
        ("bodies = 3", "found 3, allowed a list of names"),
        ("bodies =", "is not valid TOML"),
    ],
)
def test_bad_scene_files_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(model.InputError, match=words) as caught:
        model.load_scene(path)
    assert "\n" not in str(caught.value).split("TOML")[0]


def test_unknown_scene_names_the_known_ones() -> None:
    with pytest.raises(model.InputError, match="built in: whole, without-string"):
        model.load_scene("half")


def test_the_order_in_which_a_file_names_bodies_says_nothing(action: model.Action, tmp_path: Path) -> None:
    """Columns are read by the order of `model.BODIES` all over: here by the hammer's height, -48 mm off before."""
    path = tmp_path / "scene.toml"
    path.write_text('bodies = ["hammer", "repetition", "key", "jack", "whippen"]\n')
    force = read_table("forte_force.csv")[:100]
    whole, found = (model.simulate(action, force[:, 0], force[:, 1], scene=s) for s in (None, path))
    assert found.bodies == model.BODIES
    np.testing.assert_array_equal(found.angle_rad, whole.angle_rad)
    assert model.SceneChoice(bodies=("whippen", "key")).bodies == ("key", "whippen")
