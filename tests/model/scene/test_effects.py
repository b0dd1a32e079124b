"""Physics of the effects: frequencies, limits of infinite stiffness, energy, and what the thesis saw of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eig

import model
from model.inside import Observer
from model.scene.effect_terms import bending, parts_of_hammer, rail_compression_m
from tests.model.conftest import read_table
from tests.model.kernels.linearised import Evaluation

BOTH = model.SceneChoice(effects=("balance_rail", "shank"))
LIFT, SHANK = 5, 6


@pytest.fixture(scope="module")
def forte() -> np.ndarray:
    return read_table("forte_force.csv")


@pytest.mark.parametrize(("frequency", "ratio"), [(250.0, 0.03), (60.0, 0.1)])
def test_a_flying_hammer_swings_at_the_given_frequency_and_damping(
    action: model.Action, frequency: float, ratio: float
) -> None:
    """Weightless and without friction at the pivot, in the air: a mode without stiffness and the bending mode."""
    smooth = {"gravity.g": 0.0, "hammer.joint_friction.A": 0.0}
    given = action.with_values(smooth | {"shank.frequency_hz": frequency, "shank.damping_ratio": ratio})
    scene = model.build_scene(given, BOTH)
    q = scene.start.copy()
    q[4] -= 0.1  # off jack, repetition lever and rest rail, under the string
    at = Evaluation(scene, q, np.zeros(scene.size), 0.0)
    mass, stiff, damp = (x[np.ix_([4, SHANK], [4, SHANK])] for x in (at.mass, at.stiff, at.damp))
    companion = np.block([[np.zeros((2, 2)), np.eye(2)], [stiff, damp]])
    values = eig(companion, np.block([[np.eye(2), np.zeros((2, 2))], [np.zeros((2, 2)), mass]]), right=False)
    swing = values[np.argmax(values.imag)]
    assert abs(swing) / (2.0 * np.pi) == pytest.approx(frequency, rel=1e-9)
    assert -swing.real / abs(swing) == pytest.approx(ratio, rel=1e-6)
    # the butt held: the head alone on the same spring
    assert bending(given)[2] == pytest.approx(np.sqrt(-stiff[1, 1] / mass[1, 1]) / (2.0 * np.pi), rel=1e-9)
    assert 50.0 < bending(action)[2] < 100.0


def test_butt_and_head_together_are_the_hammer(action: model.Action) -> None:
    (m, x, y, i), (far, fx, fy, about) = parts_of_hammer(action)
    fx, fy = fx + action["shank.hinge.x"], fy + action["shank.hinge.y"]
    assert m + far == pytest.approx(action["hammer.mass"], rel=1e-14)
    for part, whole in (((x, fx), "x"), ((y, fy), "y")):
        assert (m * part[0] + far * part[1]) / (m + far) == pytest.approx(action[f"hammer.center_of_mass.{whole}"])
    apart = m * far / (m + far) * ((x - fx) ** 2 + (y - fy) ** 2)
    assert i + about + apart == pytest.approx(action["hammer.inertia"], rel=1e-12)


def test_stiff_effects_are_the_rigid_action(action: model.Action, forte: np.ndarray) -> None:
    """The difference falls as 1 / stiffness: 100 times stiffer, some 100 times nearer."""
    table = forte[: np.searchsorted(forte[:, 0], 0.1)]  # before key bottom, where it is smooth
    at = np.linspace(0.06, table[-1, 0], 40)
    rigid = model.simulate(action, table[:, 0], table[:, 1], output_time_s=at, tolerance=1e-8).angle_rad
    apart = []
    for factor in (1.0, 100.0):
        stiff = action.with_values(
            {
                "balance_rail.normal.c": factor * 4e6,
                "balance_rail.normal.D": 0.0,
                "shank.frequency_hz": np.sqrt(factor) * 2000.0,
            }
        )
        out = model.simulate(stiff, table[:, 0], table[:, 1], output_time_s=at, tolerance=1e-8, scene=BOTH)
        apart.append(np.abs(out.angle_rad[:, :5] - rigid).max())
        assert np.abs(out.angle_rad[:, LIFT]).max() < 20.0 / (factor * 4e6)
    assert apart[1] < 3e-6
    assert 50.0 < apart[0] / apart[1] < 200.0, apart


def test_the_rail_carries_what_the_rigid_joint_would(action: model.Action) -> None:
    stiff = action.with_values({"balance_rail.normal.c": 1e8, "shank.frequency_hz": 1e4})
    for force in (0.0, 2.0, 9.0):
        rest = model.rest_state(stiff, force, model.build_scene(stiff, BOTH))
        rigid = model.rest_state(action, force)
        state = Observer(model.build_scene(action)).evaluate(rigid.angle_rad[None], np.zeros((1, 5)), np.array([force]))
        rail = rest.contact_normal_n[rest.contacts.index("balance_rail")]
        assert rail == pytest.approx(state.joint_forces()[0, 0, 1], rel=1e-3)
        assert rest.angle_rad[LIFT] == pytest.approx(rail_compression_m(stiff) - rail / 1e8, rel=1e-6)
    printed = model.rest_state(action, 0.0, model.build_scene(action, BOTH))
    assert abs(printed.angle_rad[LIFT]) < 1e-7  # `load_at_rest` is what the rail carries then


def test_tolerance_holds_and_energy_closes_with_both(action: model.Action, forte: np.ndarray) -> None:
    fine, usual = (
        model.simulate(action, forte[:, 0], forte[:, 1], scene=BOTH, tolerance=tolerance, energy=True)
        for tolerance in (1e-9, 1e-5)
    )
    error = np.abs(usual.angle_rad - fine.angle_rad).max(axis=0)
    assert error.max() < 1e-5
    assert error[LIFT] < 1e-6  # m, of 0.3 mm
    assert fine.energy is not None and abs(fine.energy.residual) < 1e-7 * fine.energy.work_in
    assert min(fine.energy.lost_in_rail, fine.energy.lost_in_shank) > 1e-5  # J, of 0.06 J put in


def test_a_forte_lifts_the_key_where_the_thesis_saw_it(action: model.Action, forte: np.ndarray) -> None:
    """Section 3.2.2: a significant lift at key bottom, smaller ones when the back is down again, solid otherwise."""
    at = np.arange(0.0, forte[-1, 0], 1e-4)
    out = model.simulate(action, forte[:, 0], forte[:, 1], output_time_s=at, scene=BOTH, contact_forces=True)
    columns = out.columns()
    lift, rail = columns["key_lift_m"], columns["balance_rail_normal_n"]
    np.testing.assert_array_equal(rail == 0.0, lift >= rail_compression_m(action))
    bottom = at[np.argmax(columns["contact02_normal_n"] > 0.0)]
    first = at[np.argmax(rail == 0.0)]
    assert 0.0 < first - bottom < 2e-3
    early, late = at < 0.2, at > 0.45
    assert 1e-4 < lift[early].max() < 1e-3
    assert 2e-5 < lift[late].max() < lift[early].max()
    assert np.mean(rail > 0.0) > 0.9
    # the encoder of the key sees the front rise, by as much as the thesis' spike (half of the 45 mrad at most)
    error = model.observables.encoder_rad(out.angle_rad[:, 0], lift, 0.02608) - out.angle_rad[:, 0]
    assert 4e-3 < error.max() < 23e-3


def test_the_head_vibrates_after_the_string_and_shakes_the_key_in_check(
    action: model.Action, forte: np.ndarray
) -> None:
    at = np.arange(0.1, 0.3, 1e-4)
    out = model.simulate(action, forte[:, 0], forte[:, 1], output_time_s=at, scene=BOTH, contact_forces=True)
    bend = out.angle_rad[:, SHANK]
    height = model.observables.hammer_height_m(action, out.angle_rad, bend)
    touching = out.columns()["contact12_normal_n"] > 0.0
    np.testing.assert_array_equal(touching, height < 0.0)  # the head's place, not the shank's, decides
    assert np.abs(model.observables.hammer_height_m(action, out.angle_rad) - height)[touching].max() > 2e-4
    free = slice(np.flatnonzero(touching)[-1] + 5, np.flatnonzero(touching)[-1] + 65)
    assert np.ptp(bend[free]) > 5e-3


def test_scene_files_switch_effects_on_and_give_values(action: model.Action, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text('effects = ["balance_rail"]\n[shank]\nfrequency_hz = 80\nhinge.x = -0.06\n')
    choice = model.load_scene(path)
    assert choice.effects == ("balance_rail", "shank")
    assert choice.on(action)["shank.frequency_hz"] == 80.0 and choice.on(action)["shank.hinge.x"] == -0.06
    asked = action.with_values({"shank.frequency_hz": 120.0})
    assert choice.on(asked)["shank.frequency_hz"] == 120.0  # what the user sets wins
    assert model.build_scene(choice.on(action), choice).bodies[5:] == ("key_lift", "shank")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('effects = ["rail"]', "effects: found 'rail', allowed balance_rail, shank, motor_arm"),
        ('bodies = ["key"]\neffects = ["shank"]', "shank needs the hammer"),
        ("[shank]\nfrequenzy_hz = 80", "shank.frequenzy_hz: unknown key; allowed shank.frequency_hz"),
        ("[shank]\nfrequency_hz = -80", "shank.frequency_hz: found -80, allowed from 1 to 1e"),
        ("[shank]\nhinge.x = true", "shank.hinge.x: found True, allowed a number"),
        ("shank = 3", "shank: unknown key"),
    ],
)
def test_bad_effects_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(model.InputError, match=words):
        model.load_scene(path)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"shank.near.mass": 0.02}, "shank.near.mass: found 0.02 kg, allowed below the hammer's 0.01174 kg"),
        ({"shank.near.center_of_mass.x": 0.3}, "leaves the head an inertia of"),
        ({"balance_rail.normal.c": 0.0}, "allowed c above 0"),
    ],
)
def test_effects_no_action_can_have_are_refused(action: model.Action, values: dict, words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        model.build_scene(action.with_values(values), BOTH)


def test_a_value_without_its_effect_is_refused(action: model.Action) -> None:
    with pytest.raises(model.InputError, match="shank.frequency_hz is set but the scene has no shank"):
        model.simulate(action.with_values({"shank.frequency_hz": 80.0}), [0.0, 0.01], [0.0, 0.0])


def test_an_action_file_may_carry_an_effect(action: model.Action, tmp_path: Path) -> None:
    from model.parameters.action import action_text

    path = tmp_path / "own.toml"
    row = 'frequency_hz = { value = 90.0, unit = "Hz", u = 5.0, basis = "measured", source = "film 7" }'
    path.write_text(f"{action_text(action)}\n[shank]\n{row}\n", encoding="utf-8")
    own = model.load_action(path)
    assert own["shank.frequency_hz"] == 90.0 and own["shank.damping_ratio"] == action["shank.damping_ratio"]
    assert own.content() != action.content()
    again = tmp_path / "again.toml"
    again.write_text(action_text(own), encoding="utf-8")
    assert model.load_action(again).effects == own.effects
    path.write_text(path.read_text().replace('"Hz"', '"rad/s"'), encoding="utf-8")
    with pytest.raises(model.InputError, match='shank.frequency_hz.unit: found "rad/s", allowed "Hz"'):
        model.load_action(path)


def test_force_of_a_prescribed_key_with_a_bending_shank(action: model.Action, forte: np.ndarray) -> None:
    """Round trip: the motion that a force gave, prescribed, takes that force again, and bends the shank the same."""
    at = np.arange(0.0, 0.6, 1.0 / 5000.0)
    forward = model.simulate(action, forte[:, 0], forte[:, 1], output_time_s=at, scene="flexible-shank", tolerance=1e-7)
    driven = model.simulate_motion(action, at, forward.angle_rad[:, 0], members=0, scene="flexible-shank")
    force = np.interp(at, forte[:, 0], forte[:, 1])
    assert np.sqrt(np.mean((driven.force_n - force) ** 2)) < 0.003 * force.max()  # measured 0.0009
    bend = driven.angle_rad[:, driven.bodies.index("shank")] - forward.columns()["shank_rad"]
    assert np.abs(bend).max() < 2e-5
