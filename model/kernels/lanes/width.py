"""How many members advance side by side, and whether this processor gains by it."""

from __future__ import annotations

import sys
from functools import cache

from llvmlite import binding

# doubles in a register of AVX-512. With AVX2 a row takes two registers, still a third faster than rows of four:
# what is done lane by lane around the arithmetic is shared by more members
LANES = 8


@cache
def lanes_pay() -> bool:
    """Whether this processor has vectors wide enough, and multiplies and adds in one: AVX-512, or AVX2 with FMA."""
    if sys.maxsize < 2**32:
        return False
    features = binding.get_host_cpu_features()
    return bool(features.get("avx512f") or (features.get("avx2") and features.get("fma")))
