"""Sobol' indices against Ishigami's function, whose indices are known in closed form."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.stats import sobol_indices

import model
from model.screening import Spread, sobol
from model.screening.sobol import members
from model.sensitivity import Parameter

A, B = 7.0, 0.1
ONE, TWO, BOTH = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
FIRST, TOTAL = np.array([[ONE, TWO, 0.0], [ONE + BOTH, TWO, BOTH]]) / (ONE + TWO + BOTH)


class Uniform(Spread):
    """A quantity spread evenly between its ends."""

    def at(self, share: np.ndarray) -> np.ndarray:
        return self.low + share * (self.high - self.low)


def evenly(count: int, low: float, high: float) -> list[Spread]:
    return [Uniform(Parameter(f"x{i}", 0.0, "1", {}, 1e-6, 1.0), 1.0, low, high) for i in range(count)]


def ishigami(x: np.ndarray) -> np.ndarray:
    y = np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])
    return np.column_stack([y, 1e3 + 2.0 * x[:, 0], np.ones(len(x))])


@pytest.fixture(scope="module")
def found() -> model.screening.Sobol:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return sobol(evenly(3, -np.pi, np.pi), ishigami, ("ishigami", "linear", "constant"), n=2048, seed=3)


def test_ishigami_has_its_known_indices(found: model.screening.Sobol) -> None:
    np.testing.assert_allclose(found.first[0], FIRST, atol=0.02)
    np.testing.assert_allclose(found.total[0], TOTAL, atol=0.02)
    assert found.deviation[0] == pytest.approx(np.sqrt(ONE + TWO + BOTH), rel=0.02)
    assert np.all(found.first_low[0] <= found.first[0]) and np.all(found.first[0] <= found.first_high[0])
    assert np.all(found.total_high[0] - found.total_low[0] < 0.2)


@pytest.mark.slow
def test_intervals_cover_the_truth_about_as_often_as_they_say() -> None:
    truth = np.concatenate([FIRST, TOTAL])
    inside = []
    for seed in range(30):
        study = sobol(evenly(3, -np.pi, np.pi), lambda x: ishigami(x)[:, :1], ("y",), n=128, seed=seed)
        low = np.concatenate([study.first_low[0], study.total_low[0]])
        high = np.concatenate([study.first_high[0], study.total_high[0]])
        inside.append((low <= truth) & (truth <= high))
    # a Sobol' sequence scatters less than the independent points that resampling imitates
    assert np.mean(inside) > 0.9


def test_a_large_mean_and_no_variance(found: model.screening.Sobol) -> None:
    np.testing.assert_allclose(found.first[1], [1.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(found.total[1], [1.0, 0.0, 0.0], atol=0.01)
    assert found.mean[1] == pytest.approx(1e3, abs=0.1)
    assert np.all(np.isnan(found.first[2])) and np.all(np.isnan(found.total[2]))


def test_estimates_are_those_of_scipy() -> None:
    spreads = evenly(2, 0.0, 1.0)
    seen: list[np.ndarray] = []

    def compute(x: np.ndarray) -> np.ndarray:
        seen.append(x)
        return (x[:, :1] + 2.0 * x[:, 1:]) ** 2

    found = sobol(spreads, compute, ("y",), n=64)
    (x,) = seen
    assert len(x) == members(2, 64) == 256
    y = compute(x)[:, 0]
    y = y - np.mean(y[:128])
    parts = {"f_A": y[None, :64], "f_B": y[None, 64:128], "f_AB": y[128:].reshape(2, 1, 64)}
    expected = sobol_indices(func=parts, n=64)
    np.testing.assert_allclose(found.first[0], expected.first_order, rtol=1e-9)
    np.testing.assert_allclose(found.total[0], expected.total_order, rtol=1e-9)


def test_quantities_that_are_missing() -> None:
    def compute(x: np.ndarray, share: float) -> np.ndarray:
        y = x[:, :1].copy()
        y[: round(share * len(y))] = np.nan
        return y

    few = sobol(evenly(2, 0.0, 1.0), lambda x: compute(x, 0.01), ("y",), n=64)
    assert few.absent[0] == pytest.approx(0.01, abs=0.003) and few.first[0, 0] > 0.8
    many = sobol(evenly(2, 0.0, 1.0), lambda x: compute(x, 0.1), ("y",), n=64)
    assert many.absent[0] > 0.09 and np.all(np.isnan(many.first))
    none = sobol(evenly(2, 0.0, 1.0), lambda x: compute(x, 1.0), ("y",), n=64)
    assert np.isnan(none.mean[0]) and np.all(np.isnan(none.total))


@pytest.mark.parametrize("n", [0, 4, 100, -8])
def test_base_members_are_a_power_of_two(n: int) -> None:
    with pytest.raises(model.InputError, match=f"found {n}, allowed a power of 2"):
        sobol(evenly(2, 0.0, 1.0), lambda x: x[:, :1], ("y",), n=n)
