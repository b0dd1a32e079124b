"""Radau IIA with three stages: collocation of order 5, embedded order 3, L-stable, stiffly accurate.

Its stages are coupled: one real and one complex system each iteration. Dense output: the collocation polynomial.
Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Section IV.5 (coefficients) and IV.8
(transformation, starting values, error estimate); checked here against the collocation conditions
(tests/benchmarks/test_methods.py).
"""

from math import sqrt

import numpy as np

from benchmarks.methods.tableau import CoupledTableau

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
