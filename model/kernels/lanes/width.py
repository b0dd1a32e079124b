"""How many members this processor advances side by side."""

from __future__ import annotations

import sys
from functools import cache

from llvmlite import binding

LEAST_WIDTH = 4  # of the kernels where members must be computed in lanes although the processor has none


@cache
def lanes_here() -> int:
    """Doubles in one vector register: 8 with AVX-512, 4 with AVX2 and fused multiply-add, 1 where neither is known."""
    if sys.maxsize < 2**32:
        return 1
    features = binding.get_host_cpu_features()
    if features.get("avx512f") and features.get("avx512dq"):
        return 8
    return 4 if features.get("avx2") and features.get("fma") else 1
