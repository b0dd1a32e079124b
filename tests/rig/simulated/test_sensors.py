"""Sensors: scatter of the cell and errors of the scales are those stated; settings outside their range are refused."""

from __future__ import annotations

import numpy as np
import pytest

from rig import InputError
from rig.simulated.bench.sensors import (
    EncoderSensor,
    EncoderSignals,
    ForceSensor,
    ForceSignal,
    load_sensors,
)

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
    return signal.millivolts_per_volt(force_n, np.arange(force_n.size) / 5000.0) * 50.0


def test_offset_and_hum_phase_scatter_from_trial_to_trial_by_the_stated_amount() -> None:
    sensor = ForceSensor(**CELL, hum_n=(0.3,), offset_n=1.0, offset_scatter_n=0.2)
    signals = [ForceSignal(sensor, 5, trial) for trial in range(1, 2001)]
    offsets = np.array([s.offset_n for s in signals])
    assert offsets.mean() == pytest.approx(1.0, abs=0.02) and offsets.std() == pytest.approx(0.2, rel=0.06)
    phases = np.array([s.hum_phase_rad[0] for s in signals])
    assert np.abs(np.exp(1j * phases).mean()) < 0.06
    assert ForceSignal(sensor, 5, 7).offset_n == offsets[6]
    assert ForceSignal(sensor, 6, 7).offset_n != offsets[6]


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
