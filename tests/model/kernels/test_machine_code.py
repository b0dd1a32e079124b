"""Machine code is made of what Python calls; what compiled code calls has none, and Python can still call it."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from model.kernels.compile import FOLDER, inlined, uncounted
from model.kernels.machine_code import make_machine_code_when_called


@inlined
def doubled(x):
    """Twice a number."""
    return 2.0 * x


@uncounted
def shifted(x):
    """Three more than twice a number."""
    return doubled(x) + 3.0


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


def test_what_is_kept_on_disk_without_machine_code_serves_callers_again() -> None:
    for _ in range(2):
        shifted.overloads.clear()  # as in a new process

        @numba.njit
        def squared(x):
            return shifted(x) ** 2

        assert squared(2.0) == 49.0
        assert not library_of(shifted)._made
    assert FOLDER is None or sum(shifted.stats.cache_hits.values()) >= 1


@pytest.mark.parametrize("function, expected", [(doubled, 4.0), (shifted, 7.0)])
def test_python_may_call_what_has_no_wrapper(function, expected: float) -> None:
    assert [function(2.0) for _ in range(3)] == [expected] * 3


def test_it_is_on_and_is_put_on_once() -> None:
    assert make_machine_code_when_called()
    inside = numba.core.codegen.JITCPUCodegen._library_class  # type: ignore[attr-defined]
    assert make_machine_code_when_called()
    assert numba.core.codegen.JITCPUCodegen._library_class is inside  # type: ignore[attr-defined]


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
