"""Numbers of one run side by side: in their places, zeros after them, and the same from function to function."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from model.kernels.lanes.bundle import bundled, number
from model.kernels.lanes.maths import cosine_sine


def test_numbers_keep_their_places() -> None:
    @numba.njit
    def through(a, b, c):  # type: ignore[no-untyped-def]
        lanes = bundled(8, a, b, c) + 1.0
        return number(lanes, 0), number(lanes, 1), number(lanes, 2), number(lanes, 7)

    assert through(2.0, -3.0, 0.5) == (3.0, -2.0, 1.5, 1.0)


@pytest.mark.parametrize("scale", [1e-6, 0.1, 0.7, 3.0])
def test_cosine_and_sine_of_three_angles_are_those_of_each(scale: float) -> None:
    @numba.njit
    def turned(a, b, c):  # type: ignore[no-untyped-def]
        cosines, sines = cosine_sine(bundled(8, a, b, c))
        return number(cosines, 0), number(sines, 0), number(cosines, 1), number(sines, 1), number(sines, 2)

    random = np.random.default_rng(3)
    for angles in scale * random.normal(size=(200, 3)):
        a, b, c = (float(x) for x in angles)
        want = np.cos(a), np.sin(a), np.cos(b), np.sin(b), np.sin(c)
        np.testing.assert_allclose(turned(a, b, c), want, rtol=3e-16, atol=1e-16)
