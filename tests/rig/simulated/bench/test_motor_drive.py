"""The virtual bench behind a drive: volts as input, planted drives identified from its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.drive_identification import MOTOR, draw, errors
from rig.errors import RigInputError
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.plant import load_plant


def test_a_drive_beside_a_torque_per_volt_is_refused(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(DEFAULT_BENCH.read_text("utf-8") + "\n[motor_drive]\nresistance = 1.3\n", "utf-8")
    with pytest.raises(RigInputError, match=r"\[motor\] beside \[motor_drive\]"):
        load_plant(bench, seed=1, sample_rate_hz=5000.0)


@pytest.mark.slow
def test_volts_become_force_through_the_drive(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(DEFAULT_BENCH.read_text("utf-8").replace(MOTOR, "") + "\n[motor_drive]\n", "utf-8")
    plant = load_plant(bench, seed=1, sample_rate_hz=5000.0)
    assert plant.torque_per_volt_nm == pytest.approx(1.2)
    plant.scatter.clear()
    plant.start_trial(1)
    whole = [plant.advance(np.full(200, volts)) for volts in (0.0, 0.5, 0.5, 0.5, 0.5)]
    assert whole[-1].force_n[-1] == pytest.approx(0.5 * 12.0, rel=0.05)
    assert plant.truth().coordinates[-1] == "winding"


@pytest.mark.slow  # twelve blows, each fitted from seven starts
def test_twelve_planted_drives_are_found_within_their_uncertainty() -> None:
    """Other seeds than those of the benchmark's table."""
    found: dict[str, list[float]] = {}
    for seed in range(300, 312):
        for name, (error, _) in errors(draw(seed)).items():
            found.setdefault(name, []).append(error)
    assert len(found["torque_per_volt"]) == len(found["inertia"]) == 12
    assert len(found["torque_constant"]) == len(found["resistance_and_loop_gain"]) * 2
    for name, values in found.items():
        assert np.abs(values).max() < 4.0, (name, values)
        assert np.sqrt(np.mean(np.square(values))) < (1.5 if len(values) > 3 else 2.5), (name, values)
