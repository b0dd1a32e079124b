"""How many members advance side by side, and whether the processor that kernels are compiled for gains by it."""

from __future__ import annotations

import sys
from functools import cache

from model.kernels.compile import target

# doubles in a register of AVX-512. With AVX2 a row takes two registers, still a third faster than rows of four:
# what is done lane by lane around the arithmetic is shared by more members
LANES = 8


@cache
def lanes_pay() -> bool:
    """Whether the target has vectors wide enough, and multiplies and adds in one: AVX-512, or AVX2 with FMA."""
    features = target()[1].split(",")
    return sys.maxsize > 2**32 and ("+avx512f" in features or {"+avx2", "+fma"} <= set(features))
