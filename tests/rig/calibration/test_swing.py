"""Free swings give the friction of a joint within its uncertainty, whatever the level, the start, or where it hangs."""

from __future__ import annotations

import numpy as np
import pytest

import rig
from rig.calibration import friction_of_swing, read_swing
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.single_body import SwingPlant

RATE_HZ = 5000.0


def swung(share: float, lifted: float, hanging: float, counts: int, viscous: float = 0.0) -> np.ndarray:
    """A pendulum of 1.5 Hz with dry friction, by small explicit steps, as an encoder reads it."""
    omega2, h, angle, speed = (2 * np.pi * 1.5) ** 2, 2e-5, lifted, 0.0
    seen = [angle] * 500
    for k in range(int(20 / h)):
        pull = -omega2 * np.sin(angle)
        if abs(speed) < 1e-5 and abs(pull) <= share * omega2:
            break
        sense = np.sign(speed) if speed else np.sign(pull)
        after = speed + h * (pull - sense * share * omega2 - viscous * speed)
        speed = 0.0 if speed and np.sign(after) != np.sign(speed) else after
        angle += h * speed
        if k % 10 == 0:
            seen.append(angle)
    read = np.asarray(seen + [angle] * 3000) + hanging
    return np.floor(read * counts / (2 * np.pi)) * 2 * np.pi / counts


@pytest.mark.parametrize(
    ("share", "lifted", "hanging", "counts"),
    [(0.02, 0.6, 0.0, 327680), (0.07, 1.0, 2.3, 163840), (0.12, -1.2, -0.7, 327680), (0.05, 0.9, 1.0, 20000)],
)
def test_the_friction_is_found_within_its_uncertainty(share: float, lifted: float, hanging: float, counts: int) -> None:
    found = friction_of_swing(swung(share, lifted, hanging, counts), RATE_HZ, "hammer")
    assert abs(found.share - share) < 3 * found.u_share < 0.03 * share
    assert found.frequency_hz == pytest.approx(1.5, rel=2e-3)


def test_a_loss_that_grows_with_the_speed_widens_the_uncertainty() -> None:
    """The law is dry friction; what is not shows as half swings that disagree."""
    plain = friction_of_swing(swung(0.05, 1.0, 0.0, 327680), RATE_HZ, "hammer")
    oiled = friction_of_swing(swung(0.05, 1.0, 0.0, 327680, viscous=0.3), RATE_HZ, "hammer")
    assert oiled.share > plain.share and oiled.u_share > 10 * plain.u_share


def test_too_much_friction_is_said() -> None:
    with pytest.raises(rig.RigInputError, match="half swings of 0.1 rad or more, allowed from 3"):
        friction_of_swing(swung(0.3, 0.8, 0.0, 327680), RATE_HZ, "key")


@pytest.mark.parametrize(("body", "seed"), [("hammer", 3), ("whippen", 4)])
def test_the_specimens_joint_is_found_on_the_bench(body: str, seed: int) -> None:
    config = rig.load_rig("virtual").config
    bench = rig.open_backend(f"sim://?swing={body}&seed={seed}", config)
    angle, rate_hz = read_swing(bench, config, body)
    found = friction_of_swing(angle, rate_hz, body)
    plant = bench.plant  # type: ignore[attr-defined]
    assert isinstance(plant, SwingPlant)
    friction, weight = plant.truth()
    assert abs(found.share - friction / weight) < 3 * found.u_share < 0.005 * friction / weight
    bench.close()


def test_a_body_that_is_not_let_go_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.calibration.LONGEST_SWING_S", 6.0)
    config = rig.load_rig("virtual").config
    bench = rig.open_backend(f"sim://?bench={DEFAULT_BENCH.as_posix()}", config)
    with pytest.raises(rig.RigInputError, match="the hammer did not swing within 6 s"):
        read_swing(bench, config, "hammer")
    bench.close()
