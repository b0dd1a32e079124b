"""What defines an ESDIRK method and a three-stage collocation method: coefficients, and the loop that steps by them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from model.integrators.methods import lower, padded
from model.kernels.signatures import Coefficients


class _StagesInSlots:
    """Stages that the step loop itself forms in the slots of the stage kernel, not from rows of a tableau."""

    gamma: float
    embedded_order: int
    b: NDArray[np.float64]
    c: NDArray[np.float64]

    @property
    def coupling(self) -> tuple[float, float]:
        """Weights of slots 0 and 1 in the right-hand side of the stage kernel."""
        raise NotImplementedError

    @property
    def dense(self) -> NDArray[np.float64]:
        """All the loop needs beyond the stage times, as it reads it."""
        raise NotImplementedError

    @cached_property
    def coefficients(self) -> Coefficients:
        """The numbers as the step loop and the scene's kernels read them; the argument of F is y + slot 0."""
        rows = []
        for third in ((1.0, 0.0), self.coupling):
            square = np.zeros((3, 3))
            square[2, :2] = third
            rows.append(padded(square))
        exponent = 1.0 / (self.embedded_order + 1)
        no_time_derivative = np.zeros(self.stages)
        return Coefficients(*rows, self.b, self.c, no_time_derivative, self.dense, self.gamma, exponent)

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.c)


@dataclass(frozen=True)
class DiagonalTableau(_StagesInSlots):
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
    def loop(self) -> Callable[..., tuple[float, float, int]]:
        """The step loop, compiled on import."""
        from benchmarks.methods.diagonal import integrate_diagonal

        return integrate_diagonal

    @property
    def dense(self) -> NDArray[np.float64]:
        """All the loop needs, (s + 1, s): a, then the weights of the error estimate."""
        return np.ascontiguousarray(np.vstack([self.a, self.b - self.b_embedded]))

    @property
    def coupling(self) -> tuple[float, float]:
        """(slot 1 - slot 0) / gamma."""
        return -1.0 / self.gamma, 1.0 / self.gamma


@dataclass(frozen=True)
class CoupledTableau(_StagesInSlots):
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

    @property
    def loop(self) -> Callable[..., tuple[float, float, int]]:
        """The step loop, compiled on import."""
        from benchmarks.methods.coupled import integrate_coupled

        return integrate_coupled

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
    def coupling(self) -> tuple[float, float]:
        """F alone."""
        return 0.0, 0.0


_LAST = [F(82889, 524892), F(0), F(15625, 83664), F(69875, 102672), F(-2260, 8211)]
_ROWS = [
    [F(1, 4)],
    [F(8611, 62500), F(-1743, 31250)],
    [F(5012029, 34652500), F(-654441, 2922500), F(174375, 388108)],
    [F(15267082809, 155376265600), F(-71443401, 120774400), F(730878875, 902184768), F(2285395, 8070912)],
    _LAST,
]
_EMBEDDED = [
    F(4586570599, 29645900160),
    F(0),
    F(178811875, 945068544),
    F(814220225, 1159782912),
    F(-3700637, 11593932),
    F(61727, 225920),
]

ESDIRK4 = DiagonalTableau(
    name="esdirk4",
    share=0.25,
    order=4,
    embedded_order=3,
    dense_order=3,
    stability="L-stable, stiffly accurate",
    source="Kennedy and Carpenter 2003",
    gamma=0.25,
    a=lower([[float(x) for x in row] for row in _ROWS], 6),
    b=np.array([*map(float, _LAST), 0.25]),
    b_embedded=np.array([float(x) for x in _EMBEDDED]),
    c=np.array([0.0, 0.5, 0.332, 0.62, 0.85, 1.0]),
)
"""ARK4(3)6L[2]SA, implicit part: ESDIRK of order 4, embedded order 3, six stages, L-stable, stiffly accurate.

Stage 1 is explicit, the others share gamma = 1/4. Dense output: cubic through both ends and their derivatives, order 3.
Source: C. A. Kennedy and M. H. Carpenter, Additive Runge-Kutta schemes for convection-diffusion-reaction equations,
Applied Numerical Mathematics 44 (2003) 139-181, appendix; checked here against the order conditions
(tests/benchmarks/test_methods.py).
"""

_R = sqrt(6.0)

RADAU5 = CoupledTableau(
    name="radau5",
    order=5,
    embedded_order=3,
    dense_order=3,
    stability="L-stable, stiffly accurate",
    source="Hairer and Wanner II, IV.8",
    a=np.array(
        [
            [(88.0 - 7.0 * _R) / 360.0, (296.0 - 169.0 * _R) / 1800.0, (-2.0 + 3.0 * _R) / 225.0],
            [(296.0 + 169.0 * _R) / 1800.0, (88.0 + 7.0 * _R) / 360.0, (-2.0 - 3.0 * _R) / 225.0],
            [(16.0 - _R) / 36.0, (16.0 + _R) / 36.0, 1.0 / 9.0],
        ]
    ),
    c=np.array([(4.0 - _R) / 10.0, (4.0 + _R) / 10.0, 1.0]),
    estimate=np.array([-13.0 - 7.0 * _R, -13.0 + 7.0 * _R, -1.0]) / 3.0,
)
"""Radau IIA with three stages: collocation of order 5, embedded order 3, L-stable, stiffly accurate.

Its stages are coupled: one real and one complex system each iteration. Dense output: the collocation polynomial.
Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Section IV.5 (coefficients) and IV.8
(transformation, starting values, error estimate); checked here against the collocation conditions
(tests/benchmarks/test_methods.py).
"""
