"""What can be done with lanes beside arithmetic: choose by a mask, ask a mask, take numbers apart, reach memory."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from model.kernels.lanes.vector_type import DOUBLE, Lanes, Mask, Rows, call

_INT = ir.IntType(64)
_ONE_EXPONENT = 1023 << 52
_MANTISSA = (1 << 52) - 1
_TWO_52 = 0x4330000000000000  # bits of 2^52


def _bits(value: Any, builder: Any) -> Any:
    return builder.bitcast(value, ir.VectorType(_INT, value.type.count))


def _doubles(value: Any, builder: Any) -> Any:
    return builder.bitcast(value, ir.VectorType(DOUBLE, value.type.count))


def _whole(number: int, width: int) -> Any:
    return ir.Constant(ir.VectorType(_INT, width), [number] * width)


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
def where(typingctx: Any, mask: Any, yes: Any, no: Any) -> Any:
    """``yes`` in the lanes of the mask, ``no`` in the others."""
    if not isinstance(mask, Mask):
        return None
    lanes = Lanes(mask.width)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return lanes(mask, lanes, lanes), generate


def _as_integer(builder: Any, mask: Any) -> Any:
    return builder.bitcast(mask, ir.IntType(mask.type.count))


@intrinsic
def any_of(typingctx: Any, mask: Any) -> Any:
    """Whether a lane of the mask is true."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = _as_integer(builder, args[0])
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


@intrinsic
def bits_of(typingctx: Any, mask: Any) -> Any:
    """The mask as an integer, lane 0 in its lowest bit."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(_as_integer(builder, args[0]), _INT)

    return types.int64(mask), generate


@intrinsic
def mask_of(typingctx: Any, bits: Any, width: Any) -> Any:
    """The mask whose lanes are the lowest bits of an integer; ``width`` is a constant."""
    if not isinstance(width, types.IntegerLiteral):
        return None
    count = width.literal_value

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        low = builder.trunc(args[0], ir.IntType(count))
        return builder.bitcast(low, ir.VectorType(ir.IntType(1), count))

    return Mask(count)(types.int64, width), generate


@intrinsic
def root(typingctx: Any, x: Any) -> Any:
    """Square root, correctly rounded."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, "sqrt", args[0])

    return x(x), generate


@intrinsic
def fused(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    kind = next((k for k in (a, b, c) if isinstance(k, Lanes)), None)
    if kind is None:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, "fma", *args)

    return kind(kind, kind, kind), generate


@intrinsic
def two_to(typingctx: Any, shifted: Any) -> Any:
    """2^k where ``shifted`` is k + 1.5 * 2^52 and -1023 < k < 1024."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        width = sig.args[0].width
        power = builder.shl(_bits(args[0], builder), _whole(52, width))
        return _doubles(builder.add(power, _whole(_ONE_EXPONENT, width)), builder)

    return shifted(shifted), generate


@intrinsic
def exponent_of(typingctx: Any, x: Any) -> Any:
    """The whole k with 2^k <= x < 2^(k + 1), for x > 0 that is not subnormal."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        width = sig.args[0].width
        power = builder.lshr(_bits(args[0], builder), _whole(52, width))
        large = _doubles(builder.or_(power, _whole(_TWO_52, width)), builder)
        return builder.fsub(large, ir.Constant(ir.VectorType(DOUBLE, width), [4503599627370496.0 + 1023.0] * width))

    return x(x), generate


@intrinsic
def mantissa_of(typingctx: Any, x: Any) -> Any:
    """x / 2^k of ``exponent_of``: from 1 to 2."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        width = sig.args[0].width
        low = builder.and_(_bits(args[0], builder), _whole(_MANTISSA, width))
        return _doubles(builder.or_(low, _whole(_ONE_EXPONENT, width)), builder)

    return x(x), generate


@intrinsic
def with_sign(typingctx: Any, size: Any, sign: Any) -> Any:
    """``size`` with the sign of ``sign``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, "copysign", *args)

    return size(size, sign), generate


@intrinsic
def put(typingctx: Any, address: Any, index: Any, value: Any) -> Any:
    """Write a float64 at ``index`` of the row of float64 at a memory ``address`` (an integer)."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        start = builder.inttoptr(args[0], DOUBLE.as_pointer())
        builder.store(args[2], cgutils.gep(builder, start, args[1]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), generate


@intrinsic
def filled(typingctx: Any, value: Any, like: Any) -> Any:
    """``value`` in every lane, as many as ``like`` (lanes or a mask) has."""
    lanes = Lanes(like.width)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return args[0]

    return lanes(lanes, like), generate
