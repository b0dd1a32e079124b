"""Operators of lanes mean what they mean for one number, lane by lane; a product in a sum is rounded once."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numba
import numpy as np
import pytest

from model.kernels.lanes import broadcast_like, rows

X = np.array([1.5, -2.25, 0.1, -0.0, 3.0, 1e-300, -7.0, 0.3])
Y = np.array([0.5, 2.25, -0.3, 0.0, 3.0, 1e300, 2.0, np.nan])


def in_lanes(function: Callable[..., float], width: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """``function`` of two numbers as one of arrays (k,), k a multiple of ``width``."""
    made = numba.njit(error_model="numpy")(function)

    @numba.njit(error_model="numpy")
    def call(x, y, out):  # type: ignore[no-untyped-def]
        a, b, c = rows(x, width), rows(y, width), rows(out, width)
        for i in range(x.shape[0] // width):
            c[i] = made(a[i], b[i])

    def of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = np.empty_like(x)
        call(x, y, out)
        return out

    return of


@pytest.mark.parametrize("width", [2, 4, 8])
def test_operators(width: int) -> None:
    def mixed(x, y):  # type: ignore[no-untyped-def]
        z = broadcast_like(1.0, x)
        for _ in range(2):
            z += max(x, 1.0)
        return (z / 2.0) - (1.0 - abs(y))

    expected = (1.0 + 2.0 * np.maximum(X, 1.0)) / 2.0 - (1.0 - np.abs(Y))
    np.testing.assert_array_equal(in_lanes(mixed, width)(X, Y), expected)


def test_products_in_sums_are_rounded_once_and_others_twice() -> None:
    def within(x, y):  # type: ignore[no-untyped-def]
        return x * y - 1.0 / 3.0

    def before(x, y):  # type: ignore[no-untyped-def]
        return abs(x * y) - 1.0 / 3.0

    rng = np.random.default_rng(0)
    x, y = rng.uniform(0.5, 1.0, 64), rng.uniform(0.3, 0.7, 64)
    exact = [float(Fraction(a) * Fraction(b) - Fraction(1.0 / 3.0)) for a, b in zip(x, y, strict=True)]
    np.testing.assert_array_equal(in_lanes(within, 8)(x, y), exact)
    np.testing.assert_array_equal(in_lanes(before, 8)(x, y), x * y - 1.0 / 3.0)
    assert not np.array_equal(x * y - 1.0 / 3.0, exact)


def test_lanes_of_two_widths_do_not_mix() -> None:
    @numba.njit(error_model="numpy")
    def wrong(x):  # type: ignore[no-untyped-def]
        rows(x, 4)[0] = rows(x, 8)[0]

    with pytest.raises(numba.TypingError):
        wrong(X)
