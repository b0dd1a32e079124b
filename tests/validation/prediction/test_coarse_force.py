"""A force table with fewer points: what it keeps, where it leaves a table alone."""

from __future__ import annotations

import numpy as np
import pytest

from validation.prediction.many_runs import SPACING_S, coarse_force


def test_straight_lines_between_its_points_are_kept_exactly() -> None:
    knots = np.arange(0, 400, 3) * 2e-4
    newton = np.random.default_rng(1).standard_normal(knots.size)
    t = np.arange(400) * 2e-4
    force = np.interp(t, knots, newton)
    found_t, found = coarse_force(t, force)
    assert found_t == pytest.approx(knots) and found == pytest.approx(newton)
    assert found_t[0] == t[0] and found_t[-1] == t[-1]


@pytest.mark.parametrize("rate_hz", [1000.0, 4800.0, 5000.0, 25_000.0, 51_200.0])
def test_impulse_is_kept_and_points_are_not_too_far_apart(rate_hz: float) -> None:
    t = 0.3 + np.arange(int(0.21 * rate_hz)) / rate_hz
    force = 20 * np.exp(-(((t - 0.4) / 0.01) ** 2)) + np.random.default_rng(2).normal(0, 0.1, t.size)
    found_t, found = coarse_force(t, force)
    assert np.diff(found_t).max() <= max(SPACING_S, 1 / rate_hz) * (1 + 1e-6)
    assert found_t.size == pytest.approx(t.size / max(int(SPACING_S * rate_hz * (1 + 1e-9)), 1), abs=2)
    back = np.interp(t, found_t, found)
    assert back.sum() == pytest.approx(force.sum(), rel=1e-9)  # least squares: what is left has no mean
    assert (t @ back) == pytest.approx(t @ force, rel=1e-9)


def test_a_table_that_is_coarse_already_stays_as_it_is() -> None:
    t, force = np.array([0.0, 0.1, 0.15, 0.4]), np.array([0.0, 5.0, 3.0, 0.0])
    found = coarse_force(t, force)
    assert found[0] is t and found[1] is force
    even = np.arange(40) * 2e-4
    assert coarse_force(even, np.sin(even), 2e-4)[0] is even and coarse_force(even, np.sin(even))[0].size == 14
    one = np.array([0.5])
    assert coarse_force(one, one)[0] is one
