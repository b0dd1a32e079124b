"""Operators of lanes mean what they mean for one number, lane by lane; a product in a sum is rounded once."""

from __future__ import annotations

from fractions import Fraction

import numba
import numpy as np
import pytest

from model.kernels.lanes.operations import any_of, bits_of, exponent_of, mantissa_of, mask_of, rows, where
from tests.model.kernels.lanes.in_lanes import in_lanes

X = np.array([1.5, -2.25, 0.1, -0.0, 3.0, 1e-300, -7.0, 0.3])
Y = np.array([0.5, 2.25, -0.3, 0.0, 3.0, 1e300, 2.0, np.nan])


def test_operators_and_choices() -> None:
    @numba.njit(error_model="numpy")
    def mixed(x, y):  # type: ignore[no-untyped-def]
        larger = (x > y) | ~(x <= 2.0)
        z = 0.0
        for _ in range(2):
            z += where(larger, max(x, 1.0), min(abs(y), 4.0))
        z -= -x
        return (z / 2.0) - (1.0 - y)

    def plain(x: float, y: float) -> float:
        larger = x > y or not x <= 2.0
        z = 2.0 * (max(x, 1.0) if larger else (4.0 if abs(y) > 4.0 else abs(y)))
        z += x
        return z / 2.0 - (1.0 - y)

    for width in (2, 4, 8):
        np.testing.assert_array_equal(in_lanes(mixed, width)(X, Y), [plain(x, y) for x, y in zip(X, Y, strict=True)])


def test_products_in_sums_are_rounded_once_and_others_twice() -> None:
    @numba.njit(error_model="numpy")
    def within(x, y):  # type: ignore[no-untyped-def]
        return x * y - 1.0 / 3.0

    @numba.njit(error_model="numpy")
    def before(x, y):  # type: ignore[no-untyped-def]
        return abs(x * y) - 1.0 / 3.0

    rng = np.random.default_rng(0)
    x, y = rng.uniform(0.5, 1.0, 64), rng.uniform(0.3, 0.7, 64)
    exact = [float(Fraction(a) * Fraction(b) - Fraction(1.0 / 3.0)) for a, b in zip(x, y, strict=True)]
    np.testing.assert_array_equal(in_lanes(within, 8)(x, y), exact)
    np.testing.assert_array_equal(in_lanes(before, 8)(x, y), x * y - 1.0 / 3.0)
    assert not np.array_equal(x * y - 1.0 / 3.0, exact)


def test_masks_as_integers_and_numbers_taken_apart() -> None:
    @numba.njit(error_model="numpy")
    def ask(x, out):  # type: ignore[no-untyped-def]
        row = rows(x, 8)[0]
        positive = row > 0.0
        back = bits_of(mask_of(bits_of(positive) ^ 255, 8))
        out[0] = 1.0 if any_of(row > 100.0) else 0.0
        return bits_of(positive), back

    out = np.empty(1)
    assert ask(X, out) == (0b10110101, 0b01001010) and out[0] == 0.0
    size = np.abs(np.where(X == 0.0, 5e10, X))
    fraction, power = np.frexp(size)
    np.testing.assert_array_equal(in_lanes(exponent_of, 8)(size), power - 1.0)
    np.testing.assert_array_equal(in_lanes(mantissa_of, 8)(size), 2.0 * fraction)


def test_lanes_of_two_widths_do_not_mix() -> None:
    @numba.njit(error_model="numpy")
    def wrong(x):  # type: ignore[no-untyped-def]
        return any_of(rows(x, 4)[0] > rows(x, 8)[0])

    with pytest.raises(numba.TypingError):
        wrong(X)
