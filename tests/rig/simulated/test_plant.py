"""The plant of the virtual bench: volts as input, spike, double strike, scatter, reproducibility, bad bench files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import model
from rig import InputError, RigInputError, load_profile, open_backend
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.plant import ActionPlant, PlantTruth, load_plant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, read_bench
from rig.simulated.bench.sensors import (
    load_sensors,
)
from rig.simulated.bench.swing_plant import make_swing_plant


def test_a_drive_beside_a_torque_per_volt_is_refused(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(DEFAULT_BENCH.read_text("utf-8") + "\n[motor_drive]\nresistance = 1.3\n", "utf-8")
    with pytest.raises(RigInputError, match=r"\[motor\] beside \[motor_drive\]"):
        load_plant(bench, seed=1, sample_rate_hz=5000.0)


def test_a_hand_presses_the_same_on_every_motor(tmp_path: Path, config, begin) -> None:
    pressed = []
    for per_volt in (1.2, 0.48):
        text = DEFAULT_BENCH.read_text("utf-8").replace("_volt_nm = 1.2 ", f"_volt_nm = {per_volt} ")
        (tmp_path / "bench.toml").write_text(text.replace("noise_n = 0.02", "noise_n = 0.0"), "utf-8")
        backend = open_backend(f"sim://?hand=yes&bench={(tmp_path / 'bench.toml').as_posix()}", config)
        begin(backend, command=np.zeros(15_000))
        pressed.append(np.concatenate([backend.read_block(1000, 1.0).force_n for _ in range(15)]))
        backend.close()
    assert np.median(pressed[0][13_600:]) == pytest.approx(2.5 + 0.05 + 0.15, abs=0.05)
    np.testing.assert_allclose(pressed[1][13_600:], pressed[0][13_600:], atol=1e-3)


def test_a_drive_of_the_bench_file_takes_the_place_of_a_torque_per_volt(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    bench = tmp_path / "bench.toml"
    text = "".join(re.split(r"(?m)^\[motor\]\n.*\n", DEFAULT_BENCH.read_text("utf-8")))
    bench.write_text(text + "\n[motor_drive]\n", "utf-8")
    plant = load_plant(bench, seed=1, sample_rate_hz=5000.0)
    assert plant.torque_per_volt_nm == pytest.approx(1.2) and "motor_drive" in plant.choice.effects


RATE = 5000.0
QUIET = 250


def play(plant: ActionPlant, profile: str, trial: int = 1, block: int = 1000, after_s: float = 0.3) -> PlantTruth:
    """Run one trial of a built-in profile in blocks; 12 N per volt."""
    volts = load_profile(profile).sample(RATE) / 12.0
    volts = np.concatenate([np.zeros(QUIET), volts, np.zeros(int(after_s * RATE))])
    plant.start_trial(trial)
    for k in range(0, len(volts), block):
        plant.advance(volts[k : k + block])
    return plant.truth()


@pytest.fixture(scope="module")
def plant() -> ActionPlant:
    return load_plant(DEFAULT_BENCH, None, RATE)


@pytest.fixture(scope="module")
def forte(plant: ActionPlant) -> PlantTruth:
    return play(plant, "forte")


def strikes(truth: PlantTruth) -> np.ndarray:
    height = model.observables.hammer_height_m(truth.action, truth.angle_rad[:, :5])
    return truth.time_s[1:][(height[1:] <= 0) & (height[:-1] > 0)]


def test_forte_spikes_as_in_the_thesis(forte: PlantTruth) -> None:
    """10 N held, 32 to 34 N at key bottom (thesis 3.2.1, 4.1); the spike is the arm's momentum, not the profile."""
    assert 32.0 <= forte.force_n.max() <= 34.5
    held = forte.force_n[(forte.time_s > 0.2) & (forte.time_s < 0.3)]
    assert np.median(held) == pytest.approx(10.0, abs=0.15)
    assert len(strikes(forte)) == 1


def test_double_strikes_twice_an_onset_apart(plant: ActionPlant) -> None:
    times = strikes(play(plant, "double"))
    assert len(times) == 2
    assert times[1] - times[0] == pytest.approx(0.20, abs=0.01)


def test_rest_shows_the_preload_and_nothing_moves(plant: ActionPlant) -> None:
    plant.start_trial(1)
    block = plant.advance(np.zeros(500))
    np.testing.assert_allclose(block.force_n, 0.05, atol=0.005)
    assert np.abs(block.angle_rad - block.angle_rad[0]).max() < 1e-8
    rest = model.rest_state(model.load_action(), 0.05).angle_rad
    # the specimen differs in friction only at rest: same angles as the model under the same preload
    np.testing.assert_allclose(block.angle_rad[0], rest[[0, 1, 4]], atol=1e-5)


def test_blocks_do_not_change_the_truth(plant: ActionPlant, forte: PlantTruth) -> None:
    again = play(plant, "forte", block=100)
    assert np.abs(again.angle_rad - forte.angle_rad).max() < 5e-6


def test_a_lifted_body_is_let_go_after_600_ms_and_swings_whatever_the_blocks(plant: ActionPlant) -> None:
    def swung(block: int) -> np.ndarray:
        body = make_swing_plant(plant, "hammer")
        parts = [body.advance(np.zeros(block)).angle_rad for _ in range(4000 // block)]
        return np.concatenate(parts)[:, ENCODED_BODIES.index("hammer")]

    whole = swung(4000)
    assert np.ptp(whole[:3001]) == 0.0 and np.all(np.diff(whole[3000:3100]) < 0.0)  # sample 3000 is at 0.6 s
    np.testing.assert_array_equal(swung(100), whole)


def test_a_joint_with_more_than_dry_friction_does_not_swing_on_dry_friction(plant: ActionPlant, monkeypatch) -> None:
    monkeypatch.setattr(plant, "action", plant.action.with_values({"hammer.joint_friction.B1": 0.4}))
    with pytest.raises(RigInputError, match="joint_friction.B1 = 0.4, allowed 0"):
        make_swing_plant(plant, "hammer")
    assert make_swing_plant(plant, "whippen").truth()[0] == plant.action["whippen.joint_friction.A"]


def test_same_seed_same_trial_other_trial_differs_as_declared(plant: ActionPlant, forte: PlantTruth) -> None:
    np.testing.assert_array_equal(play(plant, "forte").angle_rad, forte.angle_rad)
    draws = [plant.draw_specimen(k) for k in range(1, 401)]
    gain = np.array([g for _, g in draws]) / plant.torque_per_volt_nm
    friction = np.array([a["key.joint_friction.A"] for a, _ in draws]) / plant.action["key.joint_friction.A"]
    # standard deviation of 400 draws is known to 3.5 %
    assert gain.std(ddof=1) == pytest.approx(plant.scatter["motor_gain"], rel=0.12)
    assert friction.std(ddof=1) == pytest.approx(plant.scatter["key.joint_friction.A"], rel=0.12)
    assert abs(np.corrcoef(gain, friction)[0, 1]) < 0.2


def test_command_can_change_while_under_way(plant: ActionPlant) -> None:
    """An interlock's zero volts act from the next edge on."""
    plant.start_trial(1)
    plant.advance(np.full(200, 0.5))
    pressed = plant.advance(np.full(300, 0.5)).force_n[-1]
    released = plant.advance(np.zeros(5000))
    assert pressed > 3.0
    assert released.force_n[-1] == pytest.approx(0.05, abs=0.02)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("inertia = 2.2e-4", "inertia = -1.0", "motor_arm.inertia: found -1"),
        ("inertia = 2.2e-4", "inertial = 2.2e-4", "motor_arm.inertial: unknown key"),
        ("motor_gain = 0.003", "motor_gain = 3", "scatter.motor_gain: found 3, allowed 0 to 0.3"),
        ("torque_per_volt_nm = 1.2", "torque_per_volt_nm = 0", "motor.torque_per_volt_nm: found 0"),
        ('"contact04.friction.A" = 0.36', '"contact44.friction.A" = 0.36', "contact44.friction.A"),
        ("\n[scatter]", "\n[scattered]", "[scatter]: missing"),
        ("# [balance_rail]", "[balance_rial]", "unknown key balance_rial"),
        ('action = "hirschkorn2004"', 'actoin = "hirschkorn2004"', "unknown key specimen.actoin"),
        ("seed = 52", "seed = = 52", "not a TOML file"),
    ],
)
def test_bad_bench_files_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = DEFAULT_BENCH.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "bench.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises((InputError, model.InputError)) as caught:
        load_plant(path, None, RATE)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_bench_file_without_a_seed_has_one_for_plant_and_sensors(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(DEFAULT_BENCH.read_text(encoding="utf-8").replace("seed = 52\n", ""), encoding="utf-8")
    assert load_plant(path, None, RATE).seed == load_sensors(path).seed


def test_the_specimen_is_declared_to_differ(plant: ActionPlant) -> None:
    declared = read_bench(DEFAULT_BENCH)["specimen"]["set"]
    printed = model.load_action()
    different = {p for p in printed.quantities if printed[p] != plant.action[p]}
    assert different == set(declared) and len(different) >= 5
