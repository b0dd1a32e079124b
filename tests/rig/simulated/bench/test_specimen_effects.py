"""The specimen with a key that lifts and a shank that bends: what sensors see, and that it is off unless asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
from rig.backend import open_backend
from rig.configuration.profile import load_profile
from rig.configuration.rig_file import load_rig
from rig.errors import InputError
from rig.simulated.bench.plant import load_plant
from rig.simulated.bench.sensors import EncoderSensor, EncoderSignals, load_sensors

BENCH = Path(__file__).parents[4] / "rig" / "simulated" / "bench.toml"
RATE = 5000.0


def test_a_scale_whose_centre_rises_reads_lift_over_radius() -> None:
    radius, lines = 0.0261, 327680
    sensors = tuple(EncoderSensor(counts_per_revolution=lines, sign=s, scale_radius_m=radius) for s in (-1, 1, 1))
    signals = EncoderSignals(sensors, 1, 1)
    angle = np.zeros((3, 3))
    angle[:, 1] = [0.0, 0.01, 0.02]
    before = angle.copy()
    counts = signals.quarter_counts(angle, np.array([0.0, 1e-4, 3e-4]))
    np.testing.assert_array_equal(angle, before)
    expected = np.array([0.0, 1e-4, 3e-4]) / radius * lines / (2.0 * np.pi)
    assert np.abs(counts[:, 0] + expected).max() <= 1.0  # sign -1
    assert np.abs(counts[:, 1] - angle[:, 1] * lines / (2.0 * np.pi)).max() <= 1.0
    assert np.all(counts[:, 2] == 0)
    still = EncoderSignals((EncoderSensor(counts_per_revolution=lines), *sensors[1:]), 1, 1)
    assert np.all(still.quarter_counts(np.zeros((2, 3)), np.array([0.0, 1e-3])) == 0)  # no radius: no error


def test_radius_of_the_bench_follows_from_its_lines() -> None:
    key = load_sensors(BENCH).encoders[0]
    assert key.scale_radius_m == pytest.approx(8192 * 20e-6 / (2.0 * np.pi), rel=1e-3)
    assert key.counts_per_revolution == 8192 * 40


def test_the_default_specimen_has_no_effects() -> None:
    plant = load_plant(BENCH, None, RATE)
    assert plant.choice.effects == ("motor_arm",)
    assert plant.advance(np.zeros(3)).key_lift_m is None


@pytest.mark.slow  # compiles its own structure
def test_a_specimen_on_joints_that_give_shows_it_to_the_encoder() -> None:
    plant = load_plant(BENCH, 1, RATE, ("key_pin", "hammer_pin"))
    blocks = [plant.advance(np.full(50, volts)) for volts in (0.0, *[0.3] * 29)]
    rises = np.concatenate([block.key_lift_m for block in blocks if block.key_lift_m is not None])
    assert len(rises) == 1500 and 1e-5 < np.abs(rises).max() < 2e-4
    assert max(block.force_n.max() for block in blocks) > 5.0


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("sim://?effects=rail", "effects: found 'rail', allowed balance_rail, shank, motor_arm"),
        ("sim://?effect=shank", "with the options bench, seed, clock, fault, effects"),
    ],
)
def test_bad_addresses_are_refused(url: str, words: str) -> None:
    with pytest.raises((InputError, model.InputError), match=words.replace("?", r"\?")):
        open_backend(url, load_rig("virtual").config)


@pytest.mark.slow  # compiles scenes of its own
def test_bench_tables_switch_effects_on_with_their_values(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    table = "[shank]\nfrequency_hz = 110.0\n\n[motor]\n"
    path.write_text(BENCH.read_text(encoding="utf-8").replace("[motor]\n", table, 1), encoding="utf-8")
    plant = load_plant(path, None, RATE, ("balance_rail",))
    assert set(plant.choice.effects) == {"motor_arm", "balance_rail", "shank"}
    assert plant.action["shank.frequency_hz"] == 110.0 and plant.action["motor_arm.inertia"] == 2.2e-4


@pytest.mark.slow  # compiles its own structure
def test_the_lifting_key_makes_its_encoder_read_low_as_in_the_thesis() -> None:
    """Section 3.2.2: spikes at key bottom and after release, each where the key is off its rail, and nowhere else."""
    plant = load_plant(BENCH, None, RATE, ("balance_rail", "shank"))
    volts = np.concatenate([np.zeros(250), load_profile("forte").sample(RATE) / 12.0, np.zeros(2500)])
    plant.start_trial(1)
    blocks = [plant.advance(part) for part in np.array_split(volts, 9)]
    signals = EncoderSignals(load_sensors(BENCH).encoders, 1, 1)
    counts = np.concatenate([signals.quarter_counts(block.angle_rad, block.key_lift_m) for block in blocks])
    truth = plant.truth()
    assert truth.coordinates[5:] == ("motor", "key_lift", "shank")
    read = counts[:, 0] * 2.0 * np.pi / 327680
    lift = truth.column("key_lift")
    error = read - (truth.angle_rad[:, 0] - truth.angle_rad[0, 0])
    np.testing.assert_allclose(error, (lift - lift[0]) / 0.02608, atol=1.1 * 2.0 * np.pi / 327680)
    # pressed down the key has turned clockwise; the error is towards counter-clockwise: the rotation reads low
    worst = int(np.argmax(error))
    assert truth.angle_rad[worst, 0] - truth.angle_rad[0, 0] < -0.03 and 5e-3 < error[worst] < 23e-3
    assert np.abs(truth.angle_rad[:250, :] - truth.angle_rad[0, :]).max() < 1e-7  # at rest it stays at rest
    assert 30.0 < truth.force_n.max() < 34.5
    every = np.arange(0, len(truth.time_s), 37)
    np.testing.assert_allclose(truth.angles_at(truth.time_s[every]), truth.angle_rad[every], atol=1e-15)
