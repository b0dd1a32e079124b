"""Types of the four kernels that a scene provides to the step loop; see ``emit`` for what they do.

With explicit types a compiled kernel is a plain value (`types.FunctionType`): one step loop per kind of method
serves all scenes, and is compiled once.
"""

from numba import types

_array = types.Array(types.float64, 1, "C")
_f, _i = types.float64, types.int64

LINEARISE = _i(_array, _array, _f)  # w, p, u -> number of touching contacts
ENERGY = LINEARISE  # w, p, u -> 0
PREPARE = _i(_array, _f)  # w, gamma h -> 1, or 0 where the step is too large
SKIP = _i(_array, _array)  # w, p -> mask of contacts that cannot touch
STAGE = _i(_array, _array, _array, _array, _i, _f, _f, _f, _f, _i)
# w, p, a, c, stage, gamma h, h, u, weight of du/dt, mask -> 1 where a coordinate left its allowance

_function = types.FunctionType
_table = types.Array(types.float64, 2, "C")
_integers = types.Array(types.int64, 1, "C")

INTEGRATE = types.Tuple((_f, _f, _i))(
    *(_f, _f, _f, _array, _array),  # t, t_end, h, q, v
    *(_array, _array, types.boolean),  # table_t, table_u, held
    *(_array, _table, _table),  # out_t, out_q, out_v
    *(_array, _integers),  # p, parent
    *(_function(LINEARISE), _function(PREPARE), _function(SKIP), _function(STAGE), _i),  # kernels, n_contacts
    *(_array, _array, _array, _array, _array, _table, _f),  # a, C, b, c, d, dense, gamma
    *(_f, _f, _f, _f, _f, _i),  # tolerance_q, tolerance_v, exponent, rest_limit, h_max, max_steps
    *(_integers, _array, _function(ENERGY), _array),  # counters, times, energy, audit
)
