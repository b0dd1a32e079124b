"""Kernels as values: called by their address, arrays by the address of their first number, one loop for all."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from numba import types

from model.kernels.kernel_value import Kernel, KernelType, numba_kernel, pointer

ADDS = types.int64(pointer, pointer, types.float64, types.int64)


def adding(sign: float) -> Kernel:
    def add(a: Any, b: Any, x: float, k: int) -> int:
        a[k] += sign * (b[0] + x)
        return k + 1

    return numba_kernel(numba.njit(ADDS)(add), ADDS)


@pytest.fixture(scope="module")
def twice() -> Any:
    @numba.njit(types.int64(KernelType(ADDS, of_numba=True), types.float64[::1], types.float64[::1]))
    def run(kernel, a, b):  # type: ignore[no-untyped-def]
        k = kernel(a, b, 0.5, 0)
        return kernel(a, b, 1, k)  # whole numbers are converted

    return run


def test_a_loop_is_compiled_once_for_all_kernels_of_a_signature(twice: Any) -> None:
    for sign in (1.0, -1.0):
        a, b = np.zeros(3), np.array([2.0])
        assert twice(adding(sign), a, b) == 2
        np.testing.assert_array_equal(a, [sign * 2.5, sign * 3.0, 0.0])
    assert len(twice.signatures) == 1


@pytest.mark.parametrize(
    "wrong",
    [
        (np.zeros(2), np.zeros(2), 0.5),
        (np.zeros(4)[::2], np.zeros(2), 0.5, 0),
        (np.zeros(2, dtype=np.float32), np.zeros(2), 0.5, 0),
        (np.zeros(2, dtype=np.int64), np.zeros(2), 0.5, 0),
    ],
    ids=["too few", "not in one piece", "rounded", "whole numbers"],
)
def test_what_an_address_would_misread_is_refused(wrong: tuple[Any, ...]) -> None:
    with pytest.raises(numba.TypingError):
        adding(1.0)(*wrong)
