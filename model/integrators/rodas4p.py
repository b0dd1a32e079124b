"""Rodas4P: order 4, embedded order 3, six stages, L-stable, stiffly accurate, dense output of order 3.

Keeps order 4 on parabolic problems, hence mild order reduction on stiff ones.
Source: G. Steinebach, Order-reduction of ROW-methods for DAEs and method of lines applications,
TH Darmstadt preprint 1741 (1995); coefficients in the transformed form as tabulated in
OrdinaryDiffEq.jl (Rodas4PTableau), checked here against the order conditions (tests/model/integrators).
"""

import numpy as np

from model.integrators.tableau import RosenbrockTableau, lower

_LAST = [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401]

RODAS4P = RosenbrockTableau(
    name="rodas4p",
    order=4,
    embedded_order=3,
    dense_order=3,
    stability="L-stable, stiffly accurate",
    source="Steinebach 1995",
    gamma=0.25,
    a=lower(
        [
            [3.0],
            [1.831036793486759, 0.4955183967433795],
            [2.304376582692669, -0.05249275245743001, -1.176798761832782],
            _LAST,
            [*_LAST, 1.0],
        ],
        6,
    ),
    c_coupling=lower(
        [
            [-12.0],
            [-8.791795173947035, -2.207865586973518],
            [10.81793056857153, 6.780270611428266, 19.53485944642410],
            [34.19095006749676, 15.49671153725963, 54.74760875964130, 14.16005392148534],
            [34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095, -5.714285714285717],
        ],
        6,
    ),
    b=np.array([*_LAST, 1.0, 1.0]),
    c=np.array([0.0, 0.75, 0.21, 0.63, 1.0, 1.0]),
    d=np.array([0.25, -0.5, -0.0235040, -0.0362000, 0.0, 0.0]),
    dense=np.array(
        [
            [25.09876703708589, 11.62013104361867, 28.49148307714626, -5.664021568594133, 0.0, 0.0],
            [1.638054557396973, -0.7373619806678748, 8.477918219238990, 15.99253148779520, -1.882352941176471, 0.0],
        ]
    ),
)
