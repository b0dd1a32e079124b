"""What defines a method: Rosenbrock methods of the RODAS family, and ESDIRK methods.

A Rosenbrock method is given in the form that solves for transformed stages.

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

    @cached_property
    def flat_a(self) -> NDArray[np.float64]:
        """``a`` row by row with ``MAX_STAGES`` numbers a row, as the kernels read it."""
        return _flat(self.a)

    @cached_property
    def flat_c(self) -> NDArray[np.float64]:
        """``c_coupling`` in the same order."""
        return _flat(self.c_coupling)

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.b)


def _flat(square: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros((MAX_STAGES, MAX_STAGES))
    out[: len(square), : len(square)] = square
    return out.ravel()


def lower(rows: list[list[float]], size: int) -> NDArray[np.float64]:
    """Strictly lower triangular (size, size) from ragged rows that start with the second stage."""
    out = np.zeros((size, size))
    for i, row in enumerate(rows, start=1):
        out[i, : len(row)] = row
    return out


@dataclass(frozen=True)
class DiagonalTableau:
    """Coefficients (s stages) and properties of one ESDIRK method; stiffly accurate, the last row of a is b."""

    name: str
    order: int
    embedded_order: int
    dense_order: int
    stability: str
    source: str
    gamma: float
    a: NDArray[np.float64]  # (s, s), strictly lower; the diagonal is gamma but for the first stage
    b: NDArray[np.float64]  # (s,)
    b_embedded: NDArray[np.float64]  # (s,)
    c: NDArray[np.float64]  # (s,) stage times
    share: float = 1.0  # of the local tolerance, as in RosenbrockTableau

    @property
    def dense(self) -> NDArray[np.float64]:
        """All the loop needs, (s + 1, s): a, then the weights of the error estimate."""
        return np.ascontiguousarray(np.vstack([self.a, self.b - self.b_embedded]))

    @property
    def flat_a(self) -> NDArray[np.float64]:
        """Rows for the stage kernel: the argument of F is y + slot 0."""
        return _third_row(1.0, 0.0)

    @property
    def flat_c(self) -> NDArray[np.float64]:
        """Rows for the stage kernel: (slot 1 - slot 0) / gamma."""
        return _third_row(-1.0 / self.gamma, 1.0 / self.gamma)

    @property
    def d(self) -> NDArray[np.float64]:
        """No time derivative is used."""
        return np.zeros(len(self.b))

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.b)


def _third_row(first: float, second: float) -> NDArray[np.float64]:
    out = np.zeros((MAX_STAGES, MAX_STAGES))
    out[2, :2] = first, second
    return out.ravel()
