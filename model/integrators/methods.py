"""Integration methods by name: ``get_method(name)`` gives one, ``METHODS`` lists them.

Rosenbrock methods of the RODAS family, in the form that solves for transformed stages. Stage i solves

    (1/(gamma h) - J) U_i = F(t + c_i h, y + sum_j a_ij U_j) + sum_j C_ij U_j / h + h d_i F_t;

the step is y + sum_j b_j U_j, the last stage alone is the embedded error, and inside a step
y(s) = (1-s) y0 + s (y1 + (1-s) (H_1 + s (H_2 + ...))) with H_k = sum_j h_kj U_j.
Source of the form: Hairer and Wanner, Solving Ordinary Differential Equations II, Section IV.7. Coefficients as
tabulated in OrdinaryDiffEq.jl (Rodas4PTableau, Rodas5PTableau), checked against the order conditions
(tests/model/integrators). Benchmarks add other methods to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
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
        a, c = pad_rows(self.a), pad_rows(self.c_coupling)
        return Coefficients(a, c, self.b, self.c, self.d, self.dense, self.gamma, exponent)

    @property
    def stages(self) -> int:
        return len(self.b)


def pad_rows(square: NDArray[np.float64]) -> NDArray[np.float64]:
    """``square`` row by row with ``MAX_STAGES`` numbers a row, as the stage kernel reads it."""
    out = np.zeros((MAX_STAGES, MAX_STAGES))
    out[: len(square), : len(square)] = square
    return out.ravel()


def strictly_lower(rows: list[list[float]], size: int) -> NDArray[np.float64]:
    """Strictly lower triangular (size, size) from ragged rows that start with the second stage."""
    out = np.zeros((size, size))
    for i, row in enumerate(rows, start=1):
        out[i, : len(row)] = row
    return out


# G. Steinebach, Order-reduction of ROW-methods for DAEs and method of lines applications, TH Darmstadt preprint 1741
# (1995). Six stages; keeps order 4 on parabolic problems, hence mild order reduction on stiff ones.
_LAST_4P = [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401]

RODAS4P = RosenbrockTableau(
    name="rodas4p",
    order=4,
    embedded_order=3,
    dense_order=3,
    stability="L-stable, stiffly accurate",
    source="Steinebach 1995",
    gamma=0.25,
    a=strictly_lower(
        [
            [3.0],
            [1.831036793486759, 0.4955183967433795],
            [2.304376582692669, -0.05249275245743001, -1.176798761832782],
            _LAST_4P,
            [*_LAST_4P, 1.0],
        ],
        6,
    ),
    c_coupling=strictly_lower(
        [
            [-12.0],
            [-8.791795173947035, -2.207865586973518],
            [10.81793056857153, 6.780270611428266, 19.53485944642410],
            [34.19095006749676, 15.49671153725963, 54.74760875964130, 14.16005392148534],
            [34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095, -5.714285714285717],
        ],
        6,
    ),
    b=np.array([*_LAST_4P, 1.0, 1.0]),
    c=np.array([0.0, 0.75, 0.21, 0.63, 1.0, 1.0]),
    d=np.array([0.25, -0.5, -0.0235040, -0.0362000, 0.0, 0.0]),
    dense=np.array(
        [
            [25.09876703708589, 11.62013104361867, 28.49148307714626, -5.664021568594133, 0.0, 0.0],
            [1.638054557396973, -0.7373619806678748, 8.477918219238990, 15.99253148779520, -1.882352941176471, 0.0],
        ]
    ),
)

# G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential
# Equations package, BIT Numerical Mathematics 63 (2023), doi 10.1007/s10543-023-00967-x. Eight stages.
_LAST_5P = [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946]

RODAS5P = RosenbrockTableau(
    name="rodas5p",
    share=0.35,
    order=5,
    embedded_order=4,
    dense_order=4,
    stability="L-stable, stiffly accurate",
    source="Steinebach 2023",
    gamma=0.21193756319429014,
    a=strictly_lower(
        [
            [3.0],
            [2.849394379747939, 0.45842242204463923],
            [-6.954028509809101, 2.489845061869568, -10.358996098473584],
            [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641],
            _LAST_5P,
            [*_LAST_5P, 1.0],
            [*_LAST_5P, 1.0, 1.0],
        ],
        8,
    ),
    c_coupling=strictly_lower(
        [
            [-14.155112264123755],
            [-17.97296035885952, -2.859693295451294],
            [147.12150275711716, -1.41221402718213, 71.68940251302358],
            [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306],
            [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471],
            [30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
             -28.087943162872662],
            [37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
             -54.66780262877968, -9.48861652309627],
        ],
        8,
    ),
    b=np.array([*_LAST_5P, 1.0, 1.0, 1.0]),
    c=np.array([0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0]),
    d=np.array([0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069,
                0.0, 0.0, 0.0]),
    dense=np.array(
        [
            [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204, 0.524948541321073,
             1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
            [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796, 20.176138334709044,
             15.98066361424651, -6.789040303419874, -6.710236069923372],
            [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643, -52.072871366152654,
             -59.78993625266729, -0.15582684282751913, 4.883087185713722],
        ]
    ),
)  # fmt: skip

METHODS: dict[str, RosenbrockTableau] = {method.name: method for method in (RODAS4P, RODAS5P)}
DEFAULT_METHOD = RODAS4P.name


def get_method(name: str) -> RosenbrockTableau:
    """Return the method of that name; raise ``InputError`` that lists the known ones."""
    try:
        return METHODS[name]
    except KeyError:
        raise InputError(f"method: found {name!r}, allowed {', '.join(METHODS)}") from None
