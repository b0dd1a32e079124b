"""A smooth curve through points read with errors: its slope, its uncertainty, its ends."""

from __future__ import annotations

import numpy as np
import pytest

from rig.session.info import RulerInfo
from rig.session.ruler import fit_smooth, position_of

POINTS_M = np.linspace(0.0, 0.010, 11)
TRUE_M = np.linspace(0.0005, 0.0095, 50)
SENSORS = {
    "straight": lambda d: d / 0.010,
    "steep": lambda d: np.expm1(550.0 * d) / np.expm1(5.5),
    "square": lambda d: (d / 0.010) ** 2 + 5.0 * d,
    "root": lambda d: np.sqrt(100.0 * d + 0.01),
    "S": lambda d: 0.5 - 0.5 * np.cos(np.pi * (0.05 + 90.0 * d)),
}


def read(seed):
    return np.sort(POINTS_M + 1e-4 * np.random.default_rng(seed).standard_normal(POINTS_M.size))


def test_the_stated_uncertainty_holds_for_sensors_of_any_bend() -> None:
    inside = []
    for sensor in SENSORS.values():
        for seed in range(6):
            ruler = RulerInfo("key", "a", "b", tuple(sensor(POINTS_M)), tuple(read(seed)), 1e-4, 1e-6)
            found = position_of("key", ruler, TRUE_M, sensor(TRUE_M), 1e-9)
            inside.append(np.mean(np.abs(found.displacement_m - TRUE_M) < 2.0 * found.u_m))
    assert 0.93 < np.mean(inside) < 0.99


def test_it_rises_everywhere_and_keeps_its_ends() -> None:
    places = SENSORS["steep"](POINTS_M)
    for height in (read(3), -read(3)):
        curve = fit_smooth(places, height)
        grid = np.linspace(places[0] - 1.0, places[-1] + 1.0, 999)
        inside = (grid > places[0]) & (grid < places[-1])
        assert np.all(np.diff(curve.value(grid[inside])) * np.sign(height[-1]) > 0)
        assert curve.value(grid)[[0, -1]] == pytest.approx(height[[0, -1]], abs=1e-15)
        slope = np.diff(curve.value(grid)) / np.diff(grid)
        assert curve.slope(grid[500:501])[0] == pytest.approx(slope[499:501].mean(), rel=1e-3)


def test_where_no_smooth_curve_rises_it_passes_all_points() -> None:
    places, height = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]), np.array([0.0, 1e-6, 1.0, 1.0 + 1e-6, 2.0, 2.0 + 1e-6])
    curve = fit_smooth(places, height)
    assert np.all(np.diff(curve.value(np.linspace(0.0, 5.0, 200))) >= 0)
    assert curve.scatter > 0.2
