"""Vector-register arithmetic for numba: several numbers side by side, rows of them in memory.

Every operation is one that IEEE 754 rounds correctly (sum, product, quotient, a b + c rounded once), and no optimiser
may reorder them. Where a product stands directly in a sum, it is rounded once with it: that is decided here from the
text alone, never by LLVM, so that a lane's bits cannot depend on which code path was compiled how.
"""

from __future__ import annotations

import operator
import sys
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model
from numpy.typing import NDArray

from model.compiler.native import DOUBLE, broadcast, call_intrinsic
from model.kernels.compile import target_processor

# doubles in a register of AVX-512. With AVX2 a row takes two registers, still a third faster than rows of four:
# what is done lane by lane around the arithmetic is shared by more members
LANES = 8


@cache
def has_wide_vectors() -> bool:
    """Whether the target has vectors wide enough, and multiplies and adds in one: AVX-512, or AVX2 with FMA."""
    features = target_processor()[1].split(",")
    return sys.maxsize > 2**32 and ("+avx512f" in features or {"+avx2", "+fma"} <= set(features))


def allocate_aligned(*shape: int) -> NDArray[np.float64]:
    """Zeros of a shape that start at a cache line of 64 bytes: a row of lanes across two takes twice the time."""
    count = int(np.prod(shape))
    whole = np.zeros(count + 8)
    start = (-whole.ctypes.data % 64) // 8  # bytes of a line and of a number
    return whole[start : start + count].reshape(shape)


class _Row(types.Type):  # type: ignore[misc]
    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"{type(self).__name__}({width})")


class Lanes(_Row):
    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        return Conversion.unsafe if isinstance(other, (types.Float, types.Integer)) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Common type of a variable that is scalar on one branch and lanes on another: lanes."""
        return self if isinstance(other, (types.Float, types.Integer)) else None


class Rows(_Row):
    """Memory of rows of lanes."""


class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.width))


class _RowsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, DOUBLE.as_pointer())


register_model(Lanes)(_LanesModel)
register_model(Rows)(_RowsModel)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _from_number(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return broadcast(builder, context.cast(builder, value, fromty, types.float64), toty.width)


def _width(args: Any) -> int | None:
    """Width of the lanes among the arguments; None where there are none or others."""
    found = {a.width for a in args if isinstance(a, Lanes)}
    if len(found) != 1 or not all(isinstance(a, (Lanes, types.Float, types.Integer)) for a in args):
        return None
    return int(found.pop())


def _operation(key: Any, arguments: int, lower: Any) -> None:
    """Register an operator for lanes with ``arguments`` operands, scalars among them, that ``lower`` writes."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        key: Any = None

        def generic(self, args: Any, kws: Any) -> Any:
            width = _width(args)
            if kws or len(args) != arguments or width is None:
                return None
            return signature(Lanes(width), *[Lanes(width)] * arguments)

    Template.key = key
    infer_global(key)(Template)
    lower_builtin(key, *[Lanes] * arguments)(lambda context, builder, sig, args: lower(builder, *args))


def _is_product(value: Any) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul"


def _add(b: Any, x: Any, y: Any) -> Any:
    if _is_product(x):
        return call_intrinsic(b, "fma", *x.operands, y)
    return call_intrinsic(b, "fma", *y.operands, x) if _is_product(y) else b.fadd(x, y)


def _subtract(b: Any, x: Any, y: Any) -> Any:
    if _is_product(y):
        return call_intrinsic(b, "fma", b.fneg(y.operands[0]), y.operands[1], x)
    return call_intrinsic(b, "fma", *x.operands, b.fneg(y)) if _is_product(x) else b.fsub(x, y)


for _keys, _lower in (
    ((operator.add, operator.iadd), _add),
    ((operator.sub, operator.isub), _subtract),
    ((operator.mul, operator.imul), lambda b, x, y: b.fmul(x, y)),
    ((operator.truediv, operator.itruediv), lambda b, x, y: b.fdiv(x, y)),
    ((abs,), lambda b, x: call_intrinsic(b, "fabs", x)),
    ((max,), lambda b, x, y: b.select(b.fcmp_ordered(">", y, x), y, x)),
):
    for _key in _keys:
        _operation(_key, _lower.__code__.co_argcount - 1, _lower)


@infer_global(operator.getitem)
class _Get(AbstractTemplate):  # type: ignore[misc]
    key = operator.getitem

    def generic(self, args: Any, kws: Any) -> Any:
        if len(args) != 2 or not isinstance(args[0], Rows) or not isinstance(args[1], types.Integer):
            return None
        return signature(Lanes(args[0].width), args[0], types.int64)


@infer_global(operator.setitem)
class _Set(AbstractTemplate):  # type: ignore[misc]
    key = operator.setitem

    def generic(self, args: Any, kws: Any) -> Any:
        if len(args) != 3 or not isinstance(args[0], Rows) or not isinstance(args[1], types.Integer):
            return None
        return signature(types.none, args[0], types.int64, Lanes(args[0].width))


def _place(builder: Any, rows: Any, index: Any, width: int) -> Any:
    at = builder.gep(rows, [builder.mul(index, ir.Constant(index.type, width))])
    return builder.bitcast(at, ir.VectorType(DOUBLE, width).as_pointer())


@lower_builtin(operator.getitem, Rows, types.int64)
def _read(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_place(builder, args[0], args[1], sig.args[0].width), align=8)


@lower_builtin(operator.setitem, Rows, types.int64, Lanes)
def _write(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[2], _place(builder, args[0], args[1], sig.args[0].width), align=8)
    return context.get_dummy_value()


@intrinsic
def rows(typingctx: Any, array: Any, width: Any) -> Any:
    """Memory of a C-contiguous float64 array (k,), or of its address, as rows of ``width`` lanes (a constant)."""
    if not isinstance(width, types.IntegerLiteral) or not isinstance(array, (types.Array, types.CPointer)):
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = args[0]
        if isinstance(sig.args[0], types.Array):
            data = context.make_array(sig.args[0])(context, builder, data).data
        return builder.bitcast(data, DOUBLE.as_pointer())

    return Rows(width.literal_value)(array, width), generate


@intrinsic
def broadcast_like(typingctx: Any, value: Any, like: Any) -> Any:
    lanes = Lanes(like.width)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return args[0]

    return lanes(lanes, like), generate
