"""What a step loop is given, in named groups, and the types of the kernels that a scene provides to it.

Numbers come in named tuples, so that two of the same type cannot change places unseen; numba converts nothing inside a
tuple, so each field must have exactly its type: ``float``, ``int``, C-contiguous float64 arrays.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from model.kernels.kernel_value import KernelType, pointer


class Span(NamedTuple):
    """Where a run starts and ends; ``angle``, ``speed`` (n,) and ``memory`` (z,) are changed in place."""

    time: float  # s
    end: float  # s
    step: float  # s, the first to try
    angle: np.ndarray
    speed: np.ndarray
    memory: np.ndarray  # of felt that remembers; most scenes have none


class InputTable(NamedTuple):
    """Input u(t), (k,) increasing times: linear between its points, or each value held until the next time."""

    time: np.ndarray
    value: np.ndarray
    held: bool


class Outputs(NamedTuple):
    """Times (m,) at which the state is wanted, and the rows (m, n), of memories (m, z), that are filled.

    ``steps`` (k, 2 + N (2 + r)) is filled with each step, or empty: start and length, then of the N = 2 n + z numbers
    of the state the start, the end, and r rows of the dense output. The loop ends, too, when its rows are used up.
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    memory: np.ndarray
    steps: np.ndarray


class SceneNumbers(NamedTuple):
    """Parameter vector of a scene, parents (n,) of its free coordinates, number of contacts in its kernels."""

    parameters: np.ndarray
    parent: np.ndarray
    n_contacts: int


class Coefficients(NamedTuple):
    """Coefficients of a method with s stages; the loops of its kind give ``dense`` its meaning."""

    a: np.ndarray  # rows of MAX_STAGES numbers, as the stage kernel reads them
    c: np.ndarray  # the same, of the coupling
    b: np.ndarray  # (s,)
    node: np.ndarray  # (s,) stage times
    d: np.ndarray  # (s,) weights of the time derivative
    dense: np.ndarray
    gamma: float
    exponent: float  # of the step in the estimated error


class Limits(NamedTuple):
    """What a step must keep to: local errors of angle and speed, motion that counts as rest, longest and most steps."""

    angle: float  # rad
    speed: float  # rad/s
    rest: float  # rad
    longest_step: float  # s
    most_steps: int


class Account(NamedTuple):
    """What a run adds to: work counters (see `layout.COUNTERS`), time at rest (1,), energies (6,) or (0,) for none."""

    counters: np.ndarray
    time_at_rest: np.ndarray
    energies: np.ndarray


class StepKernels(NamedTuple):
    """The kernels of a scene, for one run or for lanes; their signatures are below.

    ``energy`` is called only where energies are wanted, never in lanes.
    """

    linearise: Any
    prepare: Any
    skip: Any
    stage: Any
    fit: Any
    end: Any
    dense: Any
    interpolate: Any
    energy: Any


class LaneMembers(NamedTuple):
    """Members of a batch, a row each: what they are given, and what becomes of them.

    ``start`` (m, 7): time, end and first step (s), motion that counts as rest (rad), longest step (s), limits of local
    errors (rad, rad/s). ``place`` (m, 5): where its input starts in ``time`` and ``value`` and how many points it has,
    the same of its outputs in ``wanted``, most attempts. ``out`` (m, 3): addresses of the rows that its angles, speeds
    and memories at these are written to.
    ``reached`` (m, 3): time, next step, time at rest (s). ``angle``, ``speed`` and ``memory`` are changed in place.
    """

    start: np.ndarray
    place: np.ndarray
    parameters: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    memory: np.ndarray
    time: np.ndarray
    value: np.ndarray
    wanted: np.ndarray
    out: np.ndarray
    reached: np.ndarray
    status: np.ndarray
    counters: np.ndarray


class LaneSpace(NamedTuple):
    """Memory of a run in lanes: rows of the step, of parameters, of the loop's numbers, its integers lane by lane.

    ``single`` and ``parts`` (n, n + 1) are the workspace in which one lane is looked at by itself.
    """

    step: np.ndarray
    parameters: np.ndarray
    number: np.ndarray
    whole: np.ndarray
    single: np.ndarray
    parts: np.ndarray


_array = types.Array(types.float64, 1, "C")
_table = types.Array(types.float64, 2, "C")
_integers = types.Array(types.int64, 1, "C")
_f, _i = types.float64, types.int64

LINEARISE = _i(pointer, pointer, _f)  # w, p, u -> number of touching contacts
OBSERVE = _i(
    pointer, pointer, pointer, pointer
)  # state, input, p, row to fill -> 0; see `model.codegen.observable_programs`
REGIME = _i(pointer, pointer)  # workspace, p -> bits: `model.codegen.parameter_derivatives`
# of `model.codegen.step_update`, for one run and for lanes
_STEPPING = {
    "fit": _i(pointer, pointer),  # w, p -> 0
    "end": _i(pointer, pointer, _i, _i),  # w, b, stages, memories -> 1, or bits of the lanes, where the error is finite
    "dense": _i(pointer, pointer, _i, _i, _i),  # w, dense, its rows, stages, memories -> 0
    "interpolate": _i(pointer, _i, _i),  # w, rows of dense, memories -> 0
}
STEP = {
    "linearise": LINEARISE,
    "prepare": _i(pointer, _f),  # w, gamma h -> 1, or 0 where the step is too large
    "skip": _i(pointer, pointer),  # w, p -> mask of contacts that cannot touch
    # w, p, a, c, stage, gamma h, 1/h, u, weight of du/dt, mask -> 1 where a coordinate left its allowance
    "stage": _i(pointer, pointer, pointer, pointer, _i, _f, _f, _f, _f, _i),
} | _STEPPING
"""Kernels of the step loop by name."""
IN_LANES = {
    "linearise": _i(pointer, pointer),  # w, p -> 0
    "prepare": _i(pointer),  # w -> bits of the lanes whose step is not too large
    "skip": _i(pointer, pointer),  # w, p -> mask of contacts that touch in no lane
    # w, p, a, c, stage, mask -> bits of the lanes in which a coordinate left its allowance
    "stage": _i(pointer, pointer, pointer, pointer, _i, _i),
} | _STEPPING
"""The same for lanes: numbers of the step, u and h among them, are rows of lanes in w, parameters rows in p; what was a
truth value is an integer with a bit per lane."""
ALONE = {"energy": LINEARISE, "regime": REGIME} | dict.fromkeys(
    ("numbers", "normals", "propagate_modes", "contacts", "tips", "bodies", "amplifier", "press"), OBSERVE
)
"""Kernels that are asked for one by one."""
_STEP_KERNELS, _LANE_KERNELS = (
    types.NamedTuple([KernelType(of) for of in (*kernels.values(), kernels["linearise"])], StepKernels)
    for kernels in (STEP, IN_LANES)
)
_integer_table = types.Array(types.int64, 2, "C")
_COEFFICIENTS = types.NamedTuple([_array, _array, _array, _array, _array, _table, _f, _f], Coefficients)
INTEGRATE_LANES = _i(  # attempts, each of all lanes
    types.NamedTuple(
        [
            _table, _integer_table, *[_table] * 4, *[_array] * 3, _integer_table, _table, _integers, _integer_table,
        ],
        LaneMembers,
    ),
    _integers,  # parents of the coordinates
    _i,  # contacts
    _LANE_KERNELS,
    _COEFFICIENTS,
    types.NamedTuple([_array, _array, _array, _integers, _array, _table], LaneSpace),
)  # fmt: skip

INTEGRATE = types.Tuple((_f, _f, _i))(  # time reached, next step to try, status
    types.NamedTuple([_f, _f, _f, _array, _array, _array], Span),
    types.NamedTuple([_array, _array, types.boolean], InputTable),
    types.NamedTuple([_array, *[_table] * 4], Outputs),
    types.NamedTuple([_array, _integers, _i], SceneNumbers),
    _STEP_KERNELS,
    _COEFFICIENTS,
    types.NamedTuple([_f, _f, _f, _f, _i], Limits),
    types.NamedTuple([_integers, _array, _array], Account),
)
