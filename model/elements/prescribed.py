"""A prescribed coordinate: piecewise polynomials of the time, which is then the scene's input.

The time is the input, so that df/du is the time derivative that a Rosenbrock step needs. In the parameter vector:
number of pieces m, then m + 1 increasing breaks (s), then m rows of `ORDER` coefficients, highest power first, in the
time since the row's break. Outside the breaks the first or last polynomial goes on.
"""

from __future__ import annotations

from model.compiler.expressions import Expression, intern, maximum, minimum, read, value_of
from model.compiler.programs import Assign, Statement, While, make_lane_integer, variable

ORDER = 6  # coefficients of a piece: a quintic
Motion = tuple[Expression, Expression, Expression, Expression]


def interpolate_motion(offset: int, t: Expression, piece: Expression) -> tuple[list[Statement], Motion]:
    """Statements that set the variable ``piece``, searched from ``piece``, to the polynomial that holds time ``t``, s;
    angle and its three derivatives there. The motion's numbers begin at ``offset`` in the parameters."""
    count = read("p", offset)
    k = value_of("piece")

    def start(behind: int) -> Expression:
        return read("p", offset + 1 + behind, make_lane_integer(k))

    find: list[Statement] = [
        Assign(variable("piece"), minimum(maximum(piece, 0.0), count - 1.0)),
        While((k < count - 1.0) & (t >= start(1)), [Assign(variable("piece"), k + 1.0)]),
        While((k > 0.0) & (t < start(0)), [Assign(variable("piece"), k - 1.0)]),
    ]
    behind = intern("whole_add", make_lane_integer(count), intern("whole_multiply", make_lane_integer(k), ORDER))
    row = [read("p", offset + 2 + i, behind) for i in range(ORDER)]
    x = t - start(0)
    out = []
    for derivative in range(4):
        degree = ORDER - 1 - derivative
        value = row[0]
        for c in row[1:]:
            value = value * x + c
        out.append(value)
        row = [(degree - i) * c if degree - i != 1 else c for i, c in enumerate(row[:-1])]
    return find, (out[0], out[1], out[2], out[3])
