"""ARK4(3)6L[2]SA, implicit part: ESDIRK of order 4, embedded order 3, six stages, L-stable, stiffly accurate.

Stage 1 is explicit, the others share gamma = 1/4. Dense output: cubic through both ends and their derivatives, order 3.
Source: C. A. Kennedy and M. H. Carpenter, Additive Runge-Kutta schemes for convection-diffusion-reaction equations,
Applied Numerical Mathematics 44 (2003) 139-181, appendix; checked here against the order conditions
(tests/benchmarks/test_methods.py).
"""

from fractions import Fraction as F

import numpy as np

from benchmarks.methods.tableau import DiagonalTableau
from model.integrators.methods import lower

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
