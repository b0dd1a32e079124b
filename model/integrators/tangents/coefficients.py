"""Coefficients of Radau's collocation method (IIA), of order 2 s - 1 for s nodes, and of an estimate of its error.

Hairer and Wanner, Solving Ordinary Differential Equations II, Sections IV.5 and IV.8.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Collocation(NamedTuple):
    """A method with s nodes.

    nodes : (s,) shares of a step; the last is 1
    lagrange : (s, s) coefficients, lowest power first, of the polynomials that are 1 at a node and 0 at the others
    once, twice : (s, s) weights of the second derivative in the first and in the value at the nodes
    filter : share of a step by which the estimate is damped
    estimate_rise, estimate_once, estimate_twice : the estimate's weights of the first derivative, of the second
        derivatives in that of the first, and in that of the value; its order is s
    """

    nodes: Array
    lagrange: Array
    once: Array
    twice: Array
    filter: float
    estimate_rise: float
    estimate_once: Array
    estimate_twice: Array


def radau(stages: int) -> Collocation:
    """Radau's method with an odd number of nodes."""
    one, two = np.polynomial.Polynomial([0.0] * (stages - 1) + [1.0]), np.polynomial.Polynomial([-1.0, 1.0])
    nodes = np.sort((one * two**stages).deriv(stages - 1).roots().real)
    nodes[-1] = 1.0
    powers = np.arange(1, stages + 1)
    steep = np.vander(nodes, increasing=True)
    lagrange = np.linalg.inv(steep).T
    once = (nodes[:, None] ** powers / powers) @ lagrange.T
    values = np.linalg.eigvals(np.linalg.inv(once))
    damped = float(1.0 / values[np.argmin(np.abs(values.imag))].real)
    moments = 1.0 / powers
    moments[0] -= damped
    estimate = np.linalg.solve(steep.T, moments) - once[-1]
    of_values = estimate @ np.linalg.inv(once)
    rise = damped + float(of_values @ nodes)
    twice = once @ once
    return Collocation(
        nodes, np.ascontiguousarray(lagrange), np.ascontiguousarray(once), np.ascontiguousarray(twice), damped,
        rise, estimate, of_values @ twice,
    )  # fmt: skip
