"""Numbers of one run side by side in a vector, where several of its bodies need the same function at once."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from model.kernels.lanes.vector_type import DOUBLE, Lanes


@intrinsic
def bundled(typingctx: Any, width: Any, *numbers: Any) -> Any:
    """Lanes of these numbers, zeros after them; ``width`` is a constant."""
    if not isinstance(width, types.IntegerLiteral):
        return None
    count = len(numbers[0]) if len(numbers) == 1 and isinstance(numbers[0], types.BaseTuple) else len(numbers)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        out = ir.Constant(ir.VectorType(DOUBLE, width.literal_value), [0.0] * width.literal_value)
        for k in range(count):
            number = builder.extract_value(args[1], k)
            out = builder.insert_element(out, number, ir.Constant(ir.IntType(32), k))
        return out

    return Lanes(width.literal_value)(width, types.StarArgTuple([types.float64] * count)), generate


@intrinsic
def number(typingctx: Any, lanes: Any, place: Any) -> Any:
    """The number of a lane; ``place`` is a constant."""
    if not isinstance(place, types.IntegerLiteral) or not isinstance(lanes, Lanes):
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(args[0], ir.Constant(ir.IntType(32), place.literal_value))

    return types.float64(lanes, place), generate
