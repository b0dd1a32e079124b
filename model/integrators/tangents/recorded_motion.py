"""A recorded motion for the tangents: its state at any time, and the kinks of its forces.

At a kink a contact begins or ceases to push, passes from an arc to its tangent, slides the other way, or is pressed out
again: there the Jacobian jumps, or turns within a layer so thin that a step could pass over it unseen.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from model.kernels.compile import inlined, step_loop
from model.kernels.inputs import interpolate_own_input
from model.kernels.kernel_value import KernelType
from model.kernels.signatures import INTEGRATE, LINEARISE, REGIME, InputTable
from model.kernels.workspace import NOW, SIZE, WITH_MEMORY, Q, V, Z

NARROW = 1e-12  # s, between the two sides of a kink


class Motion(NamedTuple):
    """Steps of a run of n coordinates and z memories, N = 2 n + z, as the step loop keeps them.

    step : (k, 2 + N (2 + r)) start and length; angles, speeds and memories at the start and at the end, then rows of
        the dense output
    size, coordinates : N and n
    """

    step: np.ndarray
    size: int
    coordinates: int


class RegimeDetector(NamedTuple):
    """What tells the regime of a state: input, a scene's numbers and kernels, memory for them."""

    drive: InputTable
    parameters: np.ndarray
    linearise: Any
    regime: Any
    prescribed: bool
    workspace: np.ndarray


_f, _i = types.float64, types.int64
_table, _numbers = types.Array(_f, 2, "C"), types.Array(_f, 1, "C")
_, DRIVE, _, NUMBERS, KERNELS, *_ = INTEGRATE.args
MOTION = types.NamedTuple([_table, _i, _i], Motion)
STATES_ALONG = types.void(MOTION, _numbers, _table)
SEEN = types.NamedTuple(
    [DRIVE, _numbers, KernelType(LINEARISE), KernelType(REGIME), types.boolean, _numbers], RegimeDetector
)
FIND_KINKS = _i(MOTION, SEEN, _table)


@inlined
def interpolate_state(t, k, motion, w):
    """Write the state at ``t`` (s) to the workspace ``w``; returns the step's index, searched from ``k``."""
    steps, size, n = motion
    last = steps.shape[0] - 1
    while k < last and t >= steps[k + 1, 0]:
        k += 1
    while k > 0 and t < steps[k, 0]:
        k -= 1
    x = (t - steps[k, 0]) / steps[k, 1]
    rows = steps.shape[1] // size - 2
    for i in range(size):
        d, at = 0.0, steps.shape[1] - size + i
        for _ in range(rows):
            d = steps[k, at] + x * d
            at -= size
        to = Q + i if i < n else (V + i - n if i < 2 * n else Z + i - 2 * n)
        w[to] = (1.0 - x) * steps[k, 2 + i] + x * (steps[k, 2 + size + i] + (1.0 - x) * d)
    if size > 2 * n:
        w[NOW] = t
    return k


@step_loop(STATES_ALONG)
def interpolate_states(motion, times, state):
    """Fill ``state`` (m, N) with angles, speeds and internal variables at ``times`` (m,)."""
    n = motion.coordinates
    w = np.zeros(SIZE if state.shape[1] == 2 * n else WITH_MEMORY)
    k = 0
    for m in range(times.shape[0]):
        k = interpolate_state(times[m], k, motion, w)
        for i in range(state.shape[1]):
            state[m, i] = w[Q + i if i < n else (V + i - n if i < 2 * n else Z + i - 2 * n)]


@inlined
def evaluate_regime(t, k, k_in, motion, observer):
    """Return the regime at a time within or at the start of step ``k``, and the interval of the input there."""
    interpolate_state(t, k, motion, observer.workspace)
    if observer.prescribed:  # linearising finds the coordinates that are
        u, _, k_in = interpolate_own_input(t, k_in, observer.drive)
        observer.linearise(observer.workspace, observer.parameters, u)
    return observer.regime(observer.workspace, observer.parameters), k_in


@step_loop(FIND_KINKS)
def find_kinks(motion, observer, kinks):
    """Fill ``kinks`` (m, 2), in order of time, with the last time, s, before and the first after each change of regime
    along the motion; return how many are filled, m at most."""
    found = 0
    steps = motion.step
    now, k_in = evaluate_regime(steps[0, 0], 0, 0, motion, observer)
    for k in range(steps.shape[0] - 1):
        before, left, end = now, steps[k, 0], steps[k + 1, 0]
        now, k_in = evaluate_regime(end, k + 1, k_in, motion, observer)
        while before != now and found < kinks.shape[0]:
            right = end
            while right - left > max(NARROW, 8e-16 * abs(right)):
                middle = 0.5 * (left + right)
                there, k_in = evaluate_regime(middle, k, k_in, motion, observer)
                if there == before:
                    left = middle
                else:
                    right = middle
            kinks[found, 0] = left
            kinks[found, 1] = right
            found += 1
            if not right < end:
                break
            before, k_in = evaluate_regime(right, k, k_in, motion, observer)
            left = right
    return found
