"""Errors of the functions of lanes, against 64-bit mantissas; special values; the same bits at any width.

The bounds are those that `model.kernels.lanes.maths` states. The last test takes 4 million numbers a function:
``python -m pytest -m slow tests/model/kernels/lanes``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from model.kernels.lanes import maths
from tests.model.kernels.lanes.in_lanes import in_lanes

Long = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(Long).nmant < 63, reason="no wider numbers to compare with")


@cache
def of(name: str, width: int = 8) -> Any:
    return in_lanes(getattr(maths, name), width, 1)


def ulps(got: np.ndarray, true: Any) -> float:
    return float(np.max(np.abs(got.astype(Long) - true) / np.spacing(np.abs(true.astype(float)))))


def check(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> np.ndarray:
        return rng.uniform(low, high, count)

    x = np.concatenate([between(-700.0, 700.0), between(-1.0, 1.0), between(-40.0, 0.0)])
    true = np.exp(x.astype(Long))
    assert ulps(of("exponential")(x), true) <= 1.25
    assert ulps(of("exponential_near")(x), true) <= 1.25
    x = between(-745.0, -708.0)  # subnormal
    assert np.max(np.abs(of("exponential")(x).astype(Long) - np.exp(x.astype(Long)))) <= 1.25 * Long(5e-324)

    x = np.concatenate([np.exp(between(-700.0, 700.0)), between(0.5, 2.0), 1.0 + between(-1e-3, 1e-3)])
    assert ulps(of("logarithm")(x), np.log(x.astype(Long))) <= 1.0
    y = rng.uniform(-1.0, 1.0, len(x))
    log = np.log(x.astype(Long))
    error = np.abs(of("power")(x, y).astype(Long) / np.exp(y * log) - 1.0)
    assert np.max(error / (2.0 + np.abs(y * log))) <= 1.2e-16


def test_errors_stay_within_the_stated_bounds() -> None:
    check(40_000, 1)


@pytest.mark.slow
def test_errors_stay_within_the_stated_bounds_on_millions_of_numbers() -> None:
    check(4_000_000, 2)


def test_special_values() -> None:
    x = np.array([np.inf, -np.inf, np.nan, 0.0, -0.0, 1e300, -1e300, 1.0])
    np.testing.assert_array_equal(of("exponential")(x), [np.inf, 0.0, np.nan, 1.0, 1.0, np.inf, 0.0, np.e])


def test_bits_depend_neither_on_width_nor_on_neighbours() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(-3.0, 3.0, 8_000)
    assert of("exponential", 4)(x).tobytes() == of("exponential")(x).tobytes()
