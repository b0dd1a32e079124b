"""Call a function of lanes on arrays: compiled for a width, several numbers side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from model.kernels.lanes import vector_type  # noqa: F401  # gives operators a meaning for lanes
from model.kernels.lanes.operations import rows


def in_lanes(function: Any, width: int, results: int = 1) -> Callable[..., Any]:
    """``function`` of one or two numbers as one of arrays (k,), k a multiple of ``width``."""

    @numba.njit(error_model="numpy")
    def one(x, out):  # type: ignore[no-untyped-def]
        a, b = rows(x, width), rows(out, width)
        for i in range(x.shape[0] // width):
            b[i] = function(a[i])

    @numba.njit(error_model="numpy")
    def two(x, y, out):  # type: ignore[no-untyped-def]
        a, b, c = rows(x, width), rows(y, width), rows(out, width)
        for i in range(x.shape[0] // width):
            c[i] = function(a[i], b[i])

    @numba.njit(error_model="numpy")
    def pair(x, first, second):  # type: ignore[no-untyped-def]
        a, b, c = rows(x, width), rows(first, width), rows(second, width)
        for i in range(x.shape[0] // width):
            b[i], c[i] = function(a[i])

    def call(*arrays: np.ndarray) -> Any:
        out = np.empty_like(arrays[0])
        if results == 2:
            second = np.empty_like(out)
            pair(*arrays, out, second)
            return out, second
        (one if len(arrays) == 1 else two)(*arrays, out)
        return out

    return call
