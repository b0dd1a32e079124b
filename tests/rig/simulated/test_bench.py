"""The paced clock takes its time in every acquisition, however long nothing ran before.

The virtual bench behind a drive: volts as input.

The plant of the virtual bench: spike, double strike, scatter, reproducibility, bad bench files.

Sensors: stated noise, offset, gain, hum and delay are what is read; settings outside their range are refused.

The specimen with a key that lifts and a shank that bends: what sensors see, and that it is off unless asked for.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import model
from rig import InputError, RigInputError, load_profile, load_rig, open_backend
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.bench_time import PacedClock, VirtualClock
from rig.simulated.bench.parts_alone import swing_plant
from rig.simulated.bench.plant import ActionPlant, PlantTruth, load_plant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, Plant, read_bench
from rig.simulated.bench.sensors import (
    DelayLine,
    EncoderSensor,
    EncoderSignals,
    ForceSensor,
    ForceSignal,
    load_sensors,
    quantise,
)


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_idle_time_is_not_made_up_for(speed) -> None:
    wall, waited = [100.0], []

    def wait(duration_s: float) -> None:
        waited.append(duration_s)
        wall[0] += duration_s

    clock = PacedClock(speed, wall_s=lambda: wall[0], wait=wait)
    wall[0] += 30.0  # a server that idles
    clock.begin()
    for _ in range(10):
        clock.advance(0.02)
    assert sum(waited) == pytest.approx(0.2 / speed)
    wall[0] += 0.01  # somebody is a little late within the acquisition: that is made up for
    clock.advance(0.02)
    clock.advance(0.08)
    assert sum(waited) == pytest.approx(0.3 / speed - 0.01)
    assert clock.elapsed_s == pytest.approx((wall[0] - 100.0) * min(speed, 1.0))


def test_virtual_time_only_counts() -> None:
    clock = VirtualClock()
    clock.begin()
    clock.advance(0.5)
    assert clock.now_s == clock.elapsed_s == 0.5


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


BENCH = Path(__file__).parents[3] / "rig" / "simulated" / "bench.toml"
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
    return load_plant(BENCH, None, RATE)


@pytest.fixture(scope="module")
def forte(plant: ActionPlant) -> PlantTruth:
    return play(plant, "forte")


def strikes(truth: PlantTruth) -> np.ndarray:
    height = model.observables.hammer_height_m(truth.action, truth.angle_rad[:, :5])
    return truth.time_s[1:][(height[1:] <= 0) & (height[:-1] > 0)]


def test_fulfils_the_contract(plant: ActionPlant) -> None:
    assert isinstance(plant, Plant)


def test_forte_spikes_as_in_the_thesis(forte: PlantTruth) -> None:
    """10 N held, 32 to 34 N at key bottom (thesis 3.2.1, 4.1); the spike is the arm's momentum, not the profile."""
    assert 32.0 <= forte.force_n.max() <= 34.5
    held = forte.force_n[(forte.time_s > 0.2) & (forte.time_s < 0.3)]
    assert np.median(held) == pytest.approx(10.0, abs=0.15)
    assert len(strikes(forte)) == 1


def test_piano_spikes_near_3_n(plant: ActionPlant) -> None:
    truth = play(plant, "piano")
    before_release = truth.time_s < 0.5
    assert 2.7 <= truth.force_n[before_release].max() <= 3.3
    assert len(strikes(truth)) == 1


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
        body = swing_plant(plant, "hammer")
        parts = [body.advance(np.zeros(block)).angle_rad for _ in range(4000 // block)]
        return np.concatenate(parts)[:, ENCODED_BODIES.index("hammer")]

    whole = swung(4000)
    assert np.ptp(whole[:3001]) == 0.0 and np.all(np.diff(whole[3000:3100]) < 0.0)  # sample 3000 is at 0.6 s
    np.testing.assert_array_equal(swung(100), whole)


def test_a_joint_with_more_than_dry_friction_does_not_swing_on_dry_friction(plant: ActionPlant, monkeypatch) -> None:
    monkeypatch.setattr(plant, "action", plant.action.with_values({"hammer.joint_friction.B1": 0.4}))
    with pytest.raises(RigInputError, match="joint_friction.B1 = 0.4, allowed 0"):
        swing_plant(plant, "hammer")
    assert swing_plant(plant, "whippen").truth()[0] == plant.action["whippen.joint_friction.A"]


def test_same_seed_same_trial_other_trial_differs_as_declared(plant: ActionPlant, forte: PlantTruth) -> None:
    np.testing.assert_array_equal(play(plant, "forte").angle_rad, forte.angle_rad)
    draws = [plant.draw(k) for k in range(1, 401)]
    gain = np.array([g for _, g in draws]) / plant.torque_per_volt_nm
    friction = np.array([a["key.joint_friction.A"] for a, _ in draws]) / plant.action["key.joint_friction.A"]
    # standard deviation of 400 draws is known to 3.5 %
    assert gain.std(ddof=1) == pytest.approx(plant.scatter["motor_gain"], rel=0.12)
    assert friction.std(ddof=1) == pytest.approx(plant.scatter["key.joint_friction.A"], rel=0.12)
    assert abs(np.corrcoef(gain, friction)[0, 1]) < 0.2


def test_interpolated_truth_follows_the_motion(forte: PlantTruth) -> None:
    np.testing.assert_allclose(forte.angles_at(forte.time_s[::37]), forte.angle_rad[::37], atol=1e-15)
    every_other = PlantTruth(
        forte.time_s[::2], forte.angle_rad[::2], forte.speed_rad_per_s[::2], forte.force_n[::2], forte.action, 1.2
    )
    error = np.abs(every_other.angles_at(forte.time_s[1:-1:2]) - forte.angle_rad[1:-1:2])
    # twice the interval makes a fourth-order error 16 times larger, and it still is far below a film's resolution
    assert error[:, 1:4].max() < 5e-4


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
    text = BENCH.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "bench.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises((InputError, model.InputError)) as caught:
        load_plant(path, None, RATE)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_bench_file_without_a_seed_has_one_for_plant_and_sensors(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(BENCH.read_text(encoding="utf-8").replace("seed = 52\n", ""), encoding="utf-8")
    assert load_plant(path, None, RATE).seed == load_sensors(path).seed


def test_the_specimen_is_declared_to_differ(plant: ActionPlant) -> None:
    declared = read_bench(BENCH)["specimen"]["set"]
    printed = model.load_action()
    different = {p for p in printed.quantities if printed[p] != plant.action[p]}
    assert different == set(declared) and len(different) >= 5


CELL = {"sensitivity_mv_per_v": 2.0, "full_scale_n": 100.0, "noise_n": 0.0}
TABLES = {
    "seed": 3,
    "force_sensor": CELL,
    "encoders": {
        "key": {"counts_per_revolution": 4096},
        "whippen": {"counts_per_revolution": 8192, "sign": -1},
        "hammer": {"counts_per_revolution": 163840},
    },
    "specimen": {"anything": 1},
}


def newtons(signal: ForceSignal, force_n: np.ndarray) -> np.ndarray:
    return signal.millivolts_per_volt(force_n, np.arange(force_n.size) / RATE) * 50.0


def test_the_cell_gives_its_sensitivity_gain_error_and_offset() -> None:
    sensor = ForceSensor(**CELL, gain_error=0.01, offset_n=0.5)
    np.testing.assert_allclose(newtons(ForceSignal(sensor, 1, 1), np.array([0.0, 10.0, -4.0])), [0.5, 10.6, -3.54])


def test_noise_has_the_stated_deviation_and_is_white() -> None:
    sensor = ForceSensor(**{**CELL, "noise_n": 0.03})
    noise = newtons(ForceSignal(sensor, 1, 1), np.zeros(200_000))
    assert noise.std() == pytest.approx(0.03, rel=0.01)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.01


def test_noise_does_not_depend_on_the_length_of_the_blocks() -> None:
    sensor = ForceSensor(**{**CELL, "noise_n": 0.03})
    whole = newtons(ForceSignal(sensor, 1, 1), np.zeros(1000))
    parts = ForceSignal(sensor, 1, 1)
    split = np.concatenate([newtons(parts, np.zeros(n)) for n in (1, 99, 400, 500)])
    np.testing.assert_array_equal(whole, split)


def test_hum_has_the_stated_amplitudes_frequency_and_phase() -> None:
    sensor = ForceSensor(**CELL, hum_n=(0.3, 0.0, 0.1), hum_hz=50.0, hum_phase_rad=(0.4,), hum_phase_scatter=False)
    time_s = np.arange(500) / RATE
    expected = 0.3 * np.sin(2 * np.pi * 50 * time_s + 0.4) + 0.1 * np.sin(2 * np.pi * 150 * time_s)
    np.testing.assert_allclose(newtons(ForceSignal(sensor, 1, 1), np.zeros(500)), expected, atol=1e-12)


def test_offset_and_hum_phase_scatter_from_trial_to_trial_by_the_stated_amount() -> None:
    sensor = ForceSensor(**CELL, hum_n=(0.3,), offset_n=1.0, offset_scatter_n=0.2)
    signals = [ForceSignal(sensor, 5, trial) for trial in range(1, 2001)]
    offsets = np.array([s.offset_n for s in signals])
    assert offsets.mean() == pytest.approx(1.0, abs=0.02) and offsets.std() == pytest.approx(0.2, rel=0.06)
    phases = np.array([s.hum_phase_rad[0] for s in signals])
    assert np.abs(np.exp(1j * phases).mean()) < 0.06
    assert ForceSignal(sensor, 5, 7).offset_n == offsets[6]
    assert ForceSignal(sensor, 6, 7).offset_n != offsets[6]


def test_the_cell_saturates() -> None:
    sensor = ForceSensor(**CELL, saturation_mv_per_v=3.0)
    assert newtons(ForceSignal(sensor, 1, 1), np.array([1e6, -1e6])) == pytest.approx([150.0, -150.0])


def test_counts_are_whole_start_at_zero_and_err_by_less_than_one() -> None:
    scales = (
        EncoderSensor(counts_per_revolution=4096),
        EncoderSensor(counts_per_revolution=8192, sign=-1),
        EncoderSensor(counts_per_revolution=163840),
    )
    angle = 0.3 + np.linspace(0, 1, 4001)[:, None] * np.array([0.5, -0.25, 2.0])
    signals = EncoderSignals(scales, 1, 1)
    counts = np.concatenate([signals.quarter_counts(part) for part in np.array_split(angle, 7)])
    exact = (angle - angle[0]) * np.array([4096, -8192, 163840]) / (2 * np.pi)
    error = counts - exact
    assert counts.dtype == np.int64 and not counts[0].any()
    assert np.abs(error).max() < 1.0
    # uniform within one count about a constant that depends on where in a count the trial began
    np.testing.assert_allclose(error[100:].std(axis=0), 1 / np.sqrt(12), rtol=0.1)


def test_a_delay_line_delays_by_whole_and_broken_samples_whatever_the_blocks() -> None:
    signal = 3.0 + 0.01 * np.arange(300.0)
    for delay in (0.0, 1.0, 40.03226):
        line = DelayLine(delay)
        out = np.concatenate([line.push(part) for part in np.array_split(signal, [1, 2, 50, 51, 200])])
        expected = np.maximum(3.0 + 0.01 * (np.arange(300.0) - delay), 3.0)
        np.testing.assert_allclose(out[2:], expected[2:], atol=1e-12)
    assert DelayLine(2.5).push(np.empty(0)).size == 0


def test_quantisation_rounds_to_steps_and_clips_at_the_range() -> None:
    step = 20 / 2**16
    got = quantise(np.array([0.0, 0.6 * step, -0.4 * step, 11.0, -11.0]), 10.0, 16)
    np.testing.assert_allclose(got, [0.0, step, 0.0, 10.0 - step, -10.0], atol=1e-15)


def test_sensors_are_read_from_the_bench_tables_and_a_seed_overrides_the_files() -> None:
    sensors = load_sensors(TABLES)
    assert [s.sign for s in sensors.encoders] == [1, -1, 1] and sensors.seed == 3
    assert load_sensors(TABLES, seed=9).seed == 9


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("force_sensor", "noise_n", -0.1),
        ("force_sensor", "noise_n", float("nan")),
        ("force_sensor", "sensitivity", 2.0),
        ("force_sensor", "full_scale_n", "100 N"),
        ("encoders", "hammer", {"counts_per_revolution": 163841}),
        ("encoders", "hammer", {"counts_per_revolution": 163840, "sign": 0}),
        ("encoders", "jack", {"counts_per_revolution": 4096}),
    ],
)
def test_bad_sensor_settings_are_refused_with_their_key(table, key, value) -> None:
    with pytest.raises(InputError, match=rf"bench: .*{table}\.{key}"):
        load_sensors({**TABLES, table: {**TABLES[table], key: value}})
    incomplete = {k: v for k, v in TABLES.items() if k != table}
    with pytest.raises(InputError, match=f"{table} is missing"):
        load_sensors(incomplete)


def test_a_scale_off_its_centre_divides_badly_and_a_pivot_shifts_by_what_is_planted() -> None:
    made = EncoderSensor(
        counts_per_revolution=40_000_000, sign=1, lines_per_revolution=100, interpolation_rad=2e-5,
        eccentricity_rad=1e-3, pivot_shift_rad=3e-5,
    )  # fmt: skip
    plain = EncoderSensor(counts_per_revolution=40_000_000)
    angle = np.linspace(0, 2 * np.pi, 20_001)[:, None] * np.ones(3) + 0.1
    per_rad = 40_000_000 / (2 * np.pi)
    errors, shifts = [], []
    for trial in range(40):
        signals = EncoderSignals((made, plain, made), 5, trial)
        error = signals.quarter_counts(angle) / per_rad - (angle - angle[0])
        assert np.abs(error[:, 1]).max() < 1.01 / per_rad
        t = angle[:, 0]
        columns = [f(k * t) for k in (1, 100) for f in (np.sin, np.cos)]
        basis = np.column_stack([*columns, np.ones_like(t), np.clip((t - t[0]) / 0.005, 0, 1)])
        fit, *_ = np.linalg.lstsq(basis, error[:, 0], rcond=None)
        errors.append(fit[:4])
        shifts.append(fit[5])
        assert np.hypot(*fit[:2]) == pytest.approx(1e-3, rel=1e-3) and np.hypot(*fit[2:4]) == pytest.approx(
            2e-5, rel=0.02
        )
    np.testing.assert_allclose(errors, np.tile(errors[0], (40, 1)), atol=2e-7)  # mounted once
    assert np.std(shifts) == pytest.approx(3e-5, rel=0.35)


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


def test_a_specimen_in_a_scene_has_what_the_bench_adds(monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    plant = open_backend("sim://?scene=compliant-tip&effects=shank", load_rig("virtual").config).plant
    assert isinstance(plant, ActionPlant) and plant.choice.effects == ("motor_arm", "shank")
    assert plant.action["motor_arm.contact_c"] == 4.0e3  # of the scene; the bench has a stiffer one
    assert plant.action.scene == {"effects": ("motor_arm", "shank")}


def test_bench_tables_switch_effects_on_with_their_values(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    path = tmp_path / "bench.toml"
    table = "[shank]\nfrequency_hz = 110.0\n\n[motor]\n"
    path.write_text(BENCH.read_text(encoding="utf-8").replace("[motor]\n", table, 1), encoding="utf-8")
    plant = load_plant(path, None, RATE, ("balance_rail",))
    assert set(plant.choice.effects) == {"motor_arm", "balance_rail", "shank"}
    assert plant.action["shank.frequency_hz"] == 110.0 and plant.action["motor_arm.inertia"] == 2.2e-4
