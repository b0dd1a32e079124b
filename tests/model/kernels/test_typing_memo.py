"""What numba remembers of plain numbers changes no type and no result."""

from __future__ import annotations

import operator

import numba
import pytest
from numba.core import types
from numba.core.registry import cpu_target

import model.kernels.compile  # the memo is on from here
from model.kernels.typing_memo import remember_plain_numbers

NUMBERS = (types.float64, types.float32, types.int64, types.int32, types.uint8, types.boolean)


def test_it_is_on_and_is_put_on_once() -> None:
    assert model.kernels.compile.FOLDER is None or model.kernels.compile.FOLDER.exists()
    assert remember_plain_numbers()
    inside = types.BaseFunction.get_call_type  # type: ignore[attr-defined]
    assert remember_plain_numbers() and types.BaseFunction.get_call_type is inside  # type: ignore[attr-defined]


@pytest.mark.parametrize("operation", [operator.add, operator.truediv, operator.lt, operator.pow, operator.floordiv])
def test_types_are_those_numba_finds_itself(operation: object) -> None:
    context = cpu_target.typing_context
    context.refresh()
    function = context.resolve_value_type(operation)
    for a in NUMBERS:
        for b in NUMBERS:
            asked = [context.resolve_function_type(function, (a, b), {}) for _ in range(2)]
            fresh = types.BaseFunction.get_call_type.asks(function, context, (a, b), {})  # type: ignore[attr-defined]
            assert asked[0] == asked[1]
            assert asked[0].args == fresh.args and asked[0].return_type == fresh.return_type


def test_an_overload_registered_later_is_seen() -> None:
    def halves(x: float) -> float: ...

    @numba.extending.overload(halves)
    def halves_of_float(x):  # type: ignore[no-untyped-def]
        if isinstance(x, types.Float):
            return lambda x: 0.5 * x
        return None

    @numba.njit
    def of_float(x):  # type: ignore[no-untyped-def]
        return halves(x)

    assert of_float(3.0) == 1.5

    @numba.extending.overload(halves)
    def halves_of_integer(x):  # type: ignore[no-untyped-def]
        if isinstance(x, types.Integer):
            return lambda x: x // 2
        return None

    @numba.njit
    def of_both(x, n):  # type: ignore[no-untyped-def]
        return halves(x) + halves(n)

    assert of_both(3.0, 7) == 4.5
