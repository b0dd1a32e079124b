"""What numba remembers of plain numbers changes no type and no result."""

from __future__ import annotations

import operator
from itertools import product

import numba
import pytest
from numba.core import ir, types
from numba.core.compiler import Flags, run_frontend
from numba.core.registry import cpu_target

import model.kernels.compile  # the memo is on from here
from model.kernels.typing_memo import compare_flags_quickly, list_variables_quickly, remember_plain_numbers

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


def flags_of(error_model: str | None, nogil: bool | None) -> Flags:
    """Options of a function of which some are set."""
    flags = Flags()
    if error_model is not None:
        flags.error_model = error_model
    if nogil is not None:
        flags.release_gil = nogil
    return flags


def test_options_are_equal_where_all_of_them_are_and_hash_alike() -> None:
    if not compare_flags_quickly():
        pytest.skip("this numba keeps its options in another way, and compares them itself")
    choices = [flags_of(*chosen) for chosen in product((None, "python", "numpy"), (None, False, True))]
    for one, two in product(choices, choices):
        assert (one == two) is (one.values() == two.values())
        assert one != two or hash(one) == hash(two)
    assert (choices[0] == 0) is False


def test_variables_of_instructions_are_those_numba_finds_itself() -> None:
    def looped(values, by=(1, 2)):
        total = 0.0
        for k, value in enumerate(values):
            total += by[k % 2] * value if value > 0 else max(k, *by)
        return {"total": [total, values[:-1]]}

    def all_variables(part: object) -> list[ir.Var]:
        if isinstance(part, ir.Var):
            return [part]
        if isinstance(part, ir.Expr):
            return all_variables(part._kws)
        if isinstance(part, ir.Inst):
            return all_variables(part.__dict__)
        if isinstance(part, dict):
            return all_variables(list(part.values()))
        return [v for one in part for v in all_variables(one)] if isinstance(part, list | tuple) else []

    assert list_variables_quickly()
    found = [(one.list_vars(), all_variables(one)) for b in run_frontend(looped).blocks.values() for one in b.body]
    assert len(found) > 30 and all(ours == theirs for ours, theirs in found)
