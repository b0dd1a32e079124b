"""Chains draw from the density they are given: against quadrature, for a curved one."""

from __future__ import annotations

import numpy as np
import pytest

from validation.conventions import Array
from validation.identification.sampling import r_hat, sample


def bent(at: Array) -> Array:
    """Log density of a bent ridge, none where the first component is below -2."""
    x, y = at[:, 0], at[:, 1]
    found = -0.5 * x**2 - 0.5 * ((y - 0.4 * (x**2 - 1.0)) / 0.5) ** 2
    return np.where(x < -2.0, -np.inf, found)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_mean_and_spread_are_those_of_quadrature(seed: int) -> None:
    axis = np.linspace(-8, 8, 801)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = np.exp(bent(grid))
    weight /= weight.sum()
    mean = weight @ grid
    spread = np.sqrt(weight @ (grid - mean) ** 2)
    found = sample(bent, 2, 4, 2000, np.random.default_rng(seed))
    drawn = found.draws.reshape(-1, 2)
    assert found.mixed and found.accepted > 0.3
    assert drawn.mean(axis=0) == pytest.approx(mean, abs=0.1)
    assert drawn.std(axis=0) == pytest.approx(spread, rel=0.1)
    assert drawn[:, 0].min() >= -2.0
    for level in (0.025, 0.975):
        order = np.argsort(grid[:, 0], kind="stable")
        exact = float(grid[order, 0][np.searchsorted(np.cumsum(weight[order]), level)])
        assert np.quantile(drawn[:, 0], level) == pytest.approx(exact, abs=0.2)


def test_a_narrow_shifted_density_is_found_and_another_seed_gives_other_draws() -> None:
    def far(at: Array) -> Array:
        return np.asarray(-0.5 * (((at - 1.5) / 0.4) ** 2).sum(axis=1))

    one, other = (sample(far, 3, 4, 500, np.random.default_rng(seed)) for seed in (1, 2))
    assert one.mixed and one.draws.mean(axis=(0, 1)) == pytest.approx(1.5, abs=0.1)
    assert not np.array_equal(one.draws, other.draws)


def test_chains_that_stick_are_told() -> None:
    def two_hills(at: Array) -> Array:
        away = np.minimum(((at - 30.0) ** 2).sum(axis=1), ((at + 30.0) ** 2).sum(axis=1))
        return np.asarray(-50.0 * away)

    assert not sample(two_hills, 2, 4, 200, np.random.default_rng(0)).mixed
    apart = np.random.default_rng(0).standard_normal((2, 100, 1)) + np.array([0.0, 3.0])[:, None, None]
    assert r_hat(apart)[0] > 1.5 and r_hat(apart - apart.mean(axis=1, keepdims=True))[0] < 1.05
