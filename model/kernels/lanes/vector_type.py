"""Compiled values with one number per lane: arithmetic, comparisons that give a mask, memory by rows of lanes.

``Lanes`` is a row of doubles, ``Mask`` a row of truth values, ``Rows`` a block of memory whose entry ``k`` is the row
of lanes at ``k * width``. A float64 beside lanes stands for the same number in each.

Every operation is one that IEEE 754 rounds correctly (sum, product, quotient, square root, a b + c rounded once), and
no optimiser may reorder them. Where a product stands directly in a sum, it is rounded once with it: that is decided
here from the text alone, never by LLVM, so that a lane's bits cannot depend on which code path was compiled how.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, models, register_model

from model.kernels.typing_memo import count_as_plain

DOUBLE = ir.DoubleType()


class _Row(types.Type):  # type: ignore[misc]
    """One value per lane."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"{type(self).__name__}({width})")


count_as_plain(_Row)


class Lanes(_Row):
    """A double per lane."""

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A number stands for the same number in every lane."""
        return Conversion.unsafe if isinstance(other, (types.Float, types.Integer)) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A name that is a number on one way and lanes on another is lanes."""
        return self if isinstance(other, (types.Float, types.Integer)) else None


class Mask(_Row):
    """A truth value per lane."""


class Rows(_Row):
    """Memory of rows of lanes."""


class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.width))


class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


class _RowsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, DOUBLE.as_pointer())


register_model(Lanes)(_LanesModel)
register_model(Mask)(_MaskModel)
register_model(Rows)(_RowsModel)


def splat(builder: Any, value: Any, width: int) -> Any:
    """The same value in every lane."""
    kind = ir.VectorType(value.type, width)
    if isinstance(value, ir.Constant):
        return ir.Constant(kind, [value.constant] * width)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), width), None)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), places)


def call(builder: Any, name: str, *values: Any) -> Any:
    """LLVM's intrinsic of that name on vectors of doubles."""
    kind = values[0].type
    function_type = ir.FunctionType(kind, [kind] * len(values))
    full = f"llvm.{name}.v{kind.count}f64"
    function = builder.module.globals.get(full) or ir.Function(builder.module, function_type, full)
    return builder.call(function, values)


@lower_cast(types.Float, Lanes)
def _from_float(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return splat(builder, context.cast(builder, value, fromty, types.float64), toty.width)


@lower_cast(types.Integer, Lanes)
def _from_integer(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return splat(builder, context.cast(builder, value, fromty, types.float64), toty.width)


def _width(args: Any) -> int | None:
    """Width of the lanes among the arguments; None where there are none or others."""
    found = {a.width for a in args if isinstance(a, Lanes)}
    if len(found) != 1 or not all(isinstance(a, (Lanes, types.Float, types.Integer)) for a in args):
        return None
    return int(found.pop())


def _typed(key: Any, arguments: int, result: type) -> None:
    """Give ``key`` a meaning for lanes: ``arguments`` of them, numbers among them, a row of kind ``result``."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        key: Any = None

        def generic(self, args: Any, kws: Any) -> Any:
            width = _width(args)
            if kws or len(args) != arguments or width is None:
                return None
            return signature(result(width), *[Lanes(width)] * arguments)

    Template.key = key
    infer_global(key)(Template)


def _is_product(value: Any) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul"


def _add(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    a, b = args
    if _is_product(a):
        return call(builder, "fma", *a.operands, b)
    if _is_product(b):
        return call(builder, "fma", *b.operands, a)
    return builder.fadd(a, b)


def _subtract(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    a, b = args
    if _is_product(b):
        x, y = b.operands
        return call(builder, "fma", builder.fneg(x), y, a)
    if _is_product(a):
        return call(builder, "fma", *a.operands, builder.fneg(b))
    return builder.fsub(a, b)


def _multiply(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fmul(*args)


def _divide(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fdiv(*args)


def _negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])


def _absolute(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return call(builder, "fabs", args[0])


def _larger(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    a, b = args
    return builder.select(builder.fcmp_ordered(">", b, a), b, a)


def _smaller(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    a, b = args
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


def _operation(keys: tuple[Any, ...], arguments: int, lower: Any) -> None:
    """Give operators a meaning for lanes, ``lower`` writes the instruction."""
    for key in keys:
        _typed(key, arguments, Lanes)
        lower_builtin(key, *[Lanes] * arguments)(lower)


_operation((operator.add, operator.iadd), 2, _add)
_operation((operator.sub, operator.isub), 2, _subtract)
_operation((operator.mul, operator.imul), 2, _multiply)
_operation((operator.truediv, operator.itruediv), 2, _divide)
_operation((operator.neg,), 1, _negative)
_operation((abs,), 1, _absolute)
_operation((max,), 2, _larger)
_operation((min,), 2, _smaller)


def _comparison(key: Any, sign: str) -> None:
    _typed(key, 2, Mask)

    @lower_builtin(key, Lanes, Lanes)
    def compare(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        make = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
        return make(sign, *args)


_comparison(operator.lt, "<")
_comparison(operator.le, "<=")
_comparison(operator.gt, ">")
_comparison(operator.ge, ">=")
_comparison(operator.eq, "==")
_comparison(operator.ne, "!=")


def _logic(key: Any, name: str) -> None:
    class Template(AbstractTemplate):  # type: ignore[misc]
        key: Any = None

        def generic(self, args: Any, kws: Any) -> Any:
            if kws or not all(isinstance(a, Mask) and a == args[0] for a in args):
                return None
            return signature(args[0], *args)

    Template.key = key
    infer_global(key)(Template)

    @lower_builtin(key, *[Mask] * (1 if name == "not_" else 2))
    def combine(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, name)(*args)


_logic(operator.and_, "and_")
_logic(operator.iand, "and_")
_logic(operator.or_, "or_")
_logic(operator.ior, "or_")
_logic(operator.invert, "not_")


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
    """Pointer to a row of lanes."""
    at = builder.gep(rows, [builder.mul(index, ir.Constant(index.type, width))])
    return builder.bitcast(at, ir.VectorType(DOUBLE, width).as_pointer())


@lower_builtin(operator.getitem, Rows, types.int64)
def _read(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_place(builder, args[0], args[1], sig.args[0].width), align=8)


@lower_builtin(operator.setitem, Rows, types.int64, Lanes)
def _write(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[2], _place(builder, args[0], args[1], sig.args[0].width), align=8)
    return context.get_dummy_value()
