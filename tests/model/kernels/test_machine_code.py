"""Machine code is made of what Python calls; what compiled code calls has none."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from model.kernels.compile import inlined


def library_of(function):
    """Code of the only compiled form of a function."""
    (compiled,) = function.overloads.values()
    return compiled.library


def test_only_the_outermost_of_three_functions_has_machine_code() -> None:
    @inlined
    def less(x):
        return x - 1.0

    @inlined
    def halved(x):
        return 0.5 * less(x)

    @numba.njit
    def squared(x):
        return halved(x) ** 2

    assert squared(5.0) == 4.0
    assert library_of(squared)._made
    assert not library_of(halved)._made and not library_of(less)._made


def test_functions_of_others_raise_with_their_arguments_and_recurse() -> None:
    @numba.njit
    def root(x):
        if x < 0.0:
            raise ValueError("no root of", x)
        return math.sqrt(x)

    @numba.njit
    def mean_root(values):
        return sum([root(value) for value in values]) / len(values)

    @numba.njit
    def factorial(n):
        return 1 if n == 0 else n * factorial(n - 1)

    assert mean_root(np.array([4.0, 16.0])) == 3.0
    with pytest.raises(ValueError, match="no root of") as raised:
        mean_root(np.array([4.0, -1.0]))
    assert raised.value.args == ("no root of", -1.0)
    assert root(9.0) == 3.0  # compiled before as a callee
    assert factorial(5) == 120
