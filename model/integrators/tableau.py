"""What defines a method: Rosenbrock methods of the RODAS family, ESDIRK methods, and three-stage collocation.

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


def _third_row(first: float, second: float) -> NDArray[np.float64]:
    out = np.zeros((MAX_STAGES, MAX_STAGES))
    out[2, :2] = first, second
    return out.ravel()


class StagesInSlots:
    """Stages that the step loop itself forms in the slots of the stage kernel, not from rows of a tableau."""

    c: NDArray[np.float64]

    @property
    def flat_a(self) -> NDArray[np.float64]:
        """Rows for the stage kernel: the argument of F is y + slot 0."""
        return _third_row(1.0, 0.0)

    @property
    def d(self) -> NDArray[np.float64]:
        """No time derivative is used."""
        return np.zeros(len(self.c))

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.c)


@dataclass(frozen=True)
class DiagonalTableau(StagesInSlots):
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
    def flat_c(self) -> NDArray[np.float64]:
        """Rows for the stage kernel: (slot 1 - slot 0) / gamma."""
        return _third_row(-1.0 / self.gamma, 1.0 / self.gamma)


@dataclass(frozen=True)
class CoupledTableau(StagesInSlots):
    """Coefficients (three stages) and properties of one collocation method; stiffly accurate, last row of a is b.

    With T^-1 a^-1 T = diag(gamma, [[alpha, -beta], [beta, alpha]]) the stage equations fall into a real and a complex
    system. The embedded error is (gamma / h - J)^-1 (F(y) + sum_i estimate_i Z_i / h).
    Source of the form: Hairer and Wanner, Solving Ordinary Differential Equations II, Section IV.8.
    """

    name: str
    order: int
    embedded_order: int
    dense_order: int
    stability: str
    source: str
    a: NDArray[np.float64]  # (3, 3)
    c: NDArray[np.float64]  # (3,) stage times
    estimate: NDArray[np.float64]  # (3,) weights of the error estimate
    share: float = 1.0  # of the local tolerance, as in RosenbrockTableau

    @cached_property
    def transformation(self) -> tuple[float, complex, NDArray[np.float64]]:
        """Eigenvalues gamma and alpha + i beta (beta > 0) of the inverse of ``a``, and T (3, 3)."""
        values, vectors = np.linalg.eig(np.linalg.inv(self.a))
        real, lower_half = int(np.argmin(np.abs(values.imag))), int(np.argmin(values.imag))
        x = vectors[:, lower_half]  # of alpha - i beta: its real and imaginary part turn as the block above
        t = np.column_stack([vectors[:, real].real, x.real, x.imag])
        return float(values[real].real), complex(values[lower_half].conj()), t

    @property
    def gamma(self) -> float:
        """The real eigenvalue of the inverse of ``a``."""
        return self.transformation[0]

    @property
    def b(self) -> NDArray[np.float64]:
        """Weights (3,)."""
        return np.ascontiguousarray(self.a[-1])

    @property
    def dense(self) -> NDArray[np.float64]:
        """All the loop needs, (11, 3): T, T^-1, the polynomial (row k: of s^(k+1)), the estimate, (alpha, beta, 0)."""
        _, pair, t = self.transformation
        polynomial = np.linalg.inv(self.c[:, None] ** np.arange(1, 4))
        return np.ascontiguousarray(
            np.vstack([t, np.linalg.inv(t), polynomial, self.estimate, [pair.real, pair.imag, 0.0]])
        )

    @property
    def flat_c(self) -> NDArray[np.float64]:
        """Rows for the stage kernel: F alone."""
        return _third_row(0.0, 0.0)
