"""What defines a Rosenbrock method of the RODAS family, in the form that solves for transformed stages.

Stage i solves  (1/(gamma h) - J) U_i = F(t + c_i h, y + sum_j a_ij U_j) + sum_j C_ij U_j / h + h d_i F_t;
the step is y + sum_j b_j U_j, the last stage alone is the embedded error, and inside a step
y(s) = (1-s) y0 + s (y1 + (1-s) (H_1 + s (H_2 + ...))) with H_k = sum_j h_kj U_j.
Source of the form: Hairer and Wanner, Solving Ordinary Differential Equations II, Section IV.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.integrators.rosenbrock import integrate
from model.kernels.signatures import Coefficients
from model.kernels.workspace import MAX_STAGES


@dataclass(frozen=True)
class RosenbrockTableau:
    """Coefficients (s stages) and properties of one method; stiffly accurate, the last a-row is b."""

    name: str
    order: int
    embedded_order: int
    dense_order: int
    stability: str
    source: str
    gamma: float
    a: NDArray[np.float64]  # (s, s), strictly lower
    c_coupling: NDArray[np.float64]  # (s, s), strictly lower: C_ij
    b: NDArray[np.float64]  # (s,)
    c: NDArray[np.float64]  # (s,) stage times
    d: NDArray[np.float64]  # (s,) weights of the time derivative
    dense: NDArray[np.float64]  # (m, s): h_kj
    share: float = 1.0  # of the local tolerance: what its error estimate leaves unseen (benchmarks/tolerance.py)

    loop = staticmethod(integrate)

    @cached_property
    def coefficients(self) -> Coefficients:
        """The numbers as the step loop and the scene's kernels read them."""
        exponent = 1.0 / (self.embedded_order + 1)
        a, c = padded(self.a), padded(self.c_coupling)
        return Coefficients(a, c, self.b, self.c, self.d, self.dense, self.gamma, exponent)

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.b)


def padded(square: NDArray[np.float64]) -> NDArray[np.float64]:
    """``square`` row by row with ``MAX_STAGES`` numbers a row, as the stage kernel reads it."""
    out = np.zeros((MAX_STAGES, MAX_STAGES))
    out[: len(square), : len(square)] = square
    return out.ravel()


def lower(rows: list[list[float]], size: int) -> NDArray[np.float64]:
    """Strictly lower triangular (size, size) from ragged rows that start with the second stage."""
    out = np.zeros((size, size))
    for i, row in enumerate(rows, start=1):
        out[i, : len(row)] = row
    return out
