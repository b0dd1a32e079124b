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
# pi/2 in pieces of 32 bits, so that products with whole numbers are exact in 64-bit mantissas
HALF_PI_HEX = "1921FB54442D18469898CC51701B839A252049C1114CF98E"


def half_pi() -> list[Any]:
    digits = int(HALF_PI_HEX, 16)  # pi/2 times 2^188
    out = []
    for start in range(0, 192, 32):
        piece = digits >> (160 - start) & 0xFFFFFFFF
        out.append(np.ldexp(Long(piece), 160 - start - 188))
    return out


@cache
def of(name: str, width: int = 8) -> Any:
    return in_lanes(getattr(maths, name), width, 2 if name == "cosine_sine" else 1)


def ulps(got: np.ndarray, true: Any) -> float:
    return float(np.max(np.abs(got.astype(Long) - true) / np.spacing(np.abs(true.astype(float)))))


def cosine_sine(x: np.ndarray) -> tuple[Any, Any]:
    k = np.rint(x.astype(Long) / half_pi()[0])
    r = x.astype(Long)
    for piece in half_pi():
        r = r - k * piece
    quarter = k.astype(np.int64) % 4
    c, s = np.cos(r), np.sin(r)
    return np.choose(quarter, [c, -s, -c, s]), np.choose(quarter, [s, c, -s, -c])


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

    x = np.concatenate([between(-25.0, 25.0), between(-0.01, 0.01)])
    assert np.max(np.abs(of("tanh")(x).astype(Long) - np.tanh(x.astype(Long)))) <= 2.3e-16

    for limit in (np.pi / 4, 10.0, 1e3, 2.0**20):
        near_quarters = np.rint(between(-limit, limit) / (np.pi / 2)) * (np.pi / 2)
        x = np.concatenate([between(-limit, limit), near_quarters[np.abs(near_quarters) <= limit]])
        x = x[: len(x) // 8 * 8]
        for got, true in zip(of("cosine_sine")(x), cosine_sine(x), strict=True):
            nowhere_zero = true != 0
            assert ulps(got[nowhere_zero], true[nowhere_zero]) <= 1.25
            assert not np.any(got[~nowhere_zero])


def test_errors_stay_within_the_stated_bounds() -> None:
    check(40_000, 1)


@pytest.mark.slow
def test_errors_stay_within_the_stated_bounds_on_millions_of_numbers() -> None:
    check(4_000_000, 2)


def test_special_values() -> None:
    x = np.array([np.inf, -np.inf, np.nan, 0.0, -0.0, 1e300, -1e300, 1.0])
    np.testing.assert_array_equal(of("exponential")(x), [np.inf, 0.0, np.nan, 1.0, 1.0, np.inf, 0.0, np.e])
    np.testing.assert_array_equal(of("tanh")(x)[[0, 1, 2, 3, 5, 6]], [1.0, -1.0, np.nan, 0.0, 1.0, -1.0])
    cosine, sine = of("cosine_sine")(np.array([np.inf, np.nan, 2.0**21, -(2.0**21), 0.0, -0.0, 1.0, 4.0]))
    assert np.all(np.isnan(cosine[:4])) and np.all(np.isnan(sine[:4]))
    np.testing.assert_array_equal(cosine[4:6], [1.0, 1.0])
    np.testing.assert_array_equal(sine[4:6], [0.0, 0.0])


def test_bits_depend_neither_on_width_nor_on_neighbours() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(-3.0, 3.0, 8_000)
    small = np.where(np.abs(x) < 0.7, x, 0.1)
    for width in (4, 8):
        for mine, other in zip(of("cosine_sine", width)(x), of("cosine_sine")(small), strict=True):
            inside = np.abs(x) < 0.7  # beside angles beyond 45 degrees, and beside small ones only
            assert mine[inside].tobytes() == other[inside].tobytes()
        assert of("cosine_sine", width)(x)[1].tobytes() == of("cosine_sine")(x)[1].tobytes()
    assert of("exponential", 4)(x).tobytes() == of("exponential")(x).tobytes()
