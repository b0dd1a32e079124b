"""Integrate the tangents along a recorded motion, with error control over every parameter."""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.step_control import FIRST_STEP, WHOLE
from model.integrators.tangents.channels import (
    advance_channels,
    interpolate_channels,
    propagate_free_modes,
    solve_channels,
)
from model.integrators.tangents.linearised_nodes import LINEAR, LINEARISE_NODE, linearise_node
from model.integrators.tangents.radau import NODES, STAGES, WANTED, estimate_error, interpolate_step, solve_step
from model.integrators.tangents.recorded_motion import DRIVE, MOTION, interpolate_state
from model.kernels.compile import inlined_uncounted, uncounted_loop
from model.kernels.inputs import interpolate_own_input
from model.kernels.kernel_value import KernelType, numba_kernel

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS = 0, 1, 2
MOST_STEPS = 50  # attempts for each step of the motion; a blow of the printed action takes about one
# as `model.integrators.step_control`, for steps of another order; s
SAFETY, GROW, SHRINK, SMALLEST_STEP = 0.8, 6.0, 0.1, 1e-10
POWER = -1.0 / (STAGES + 1)  # of the step in the estimated error


class Landings(NamedTuple):
    """Where steps end: kinks (k, 2), the last time before and the first after each, increasing.

    ``woken`` (w, 3) are times at which a string's modes are stepped again, or left, both among the kinks: the time, for
    how long (s) they were free or -1, and the step of the motion that begins there.
    """

    kink: np.ndarray
    woken: np.ndarray


_f, _i = types.float64, types.int64
_table, _cube = types.Array(_f, 2, "C"), types.Array(_f, 3, "C")
LANDINGS = types.NamedUniTuple(_table, 2, Landings)
FOLLOW = types.Tuple((_i, _f, _i, _i))(  # status, time reached, steps, rejected ones
    MOTION, DRIVE, LANDINGS, LINEAR, WANTED, _cube, _cube, KernelType(LINEARISE_NODE, of_numba=True)
)
NODE = numba_kernel(linearise_node, LINEARISE_NODE)
"""Given to `integrate_tangents` as a value, so that LLVM does not compile it twice more inside the loop."""


@inlined_uncounted
def copy_elements(out, given):
    """Copy ``given`` (n, P) into ``out`` as far as its shape (n, P') reaches.

    Number by number, as an assigned row brings the text of numba's message about shapes, seconds to compile. What
    fills ``given`` up to whole lanes is left out where ``out`` has no place for it.
    """
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = given[i, k]


@inlined_uncounted
def fill_remaining_outputs(nth, until, wanted, tangent, channels):
    """Fill the outputs from the ``nth`` up to the time ``until`` with the present tangent; return the next to fill."""
    while nth < wanted.time.shape[0] and wanted.time[nth] <= until:
        row = wanted.row[nth]
        if wanted.channel.shape[0] > 0:
            interpolate_channels(0.0, channels, wanted.channel[row])
        copy_elements(wanted.angle[row], tangent[0])
        copy_elements(wanted.speed[row], tangent[1])
        nth += 1
    return nth


@inlined_uncounted
def linearise_at(t, m, place, motion, drive, linear, linearise):
    """Fill row ``m`` of ``linear`` with the linearised equations at ``t``; return the indices (motion's step, input
    interval) of ``t``, searched from ``place``."""
    k = interpolate_state(t, place[0], motion, linear.space.point)
    u, _, k_in = interpolate_own_input(t, place[1], drive)
    changes = linear.input_slope
    if changes.shape[0] > 0:
        x = min(1.0, max(0.0, (t - drive.time[k_in]) / (drive.time[k_in + 1] - drive.time[k_in])))
        for j in range(changes.shape[2]):
            linear.space.input_change[0, j] = (1.0 - x) * changes[k_in, 0, j] + x * changes[k_in, 1, j]
    linearise(m, u, linear)
    return k, k_in


@inlined_uncounted
def step_end_limit(t, k, motion, stride):
    """Return the end of the step of the motion ``stride`` - 1 after that at ``t``; the search begins at ``k``."""
    steps = motion.step
    last = steps.shape[0] - 1
    while k > 0 and t < steps[k, 0]:
        k -= 1
    while k < last and t >= steps[k + 1, 0]:
        k += 1
    k = min(last, k + stride - 1)
    return steps[k, 0] + steps[k, 1]


@inlined_uncounted
def fit_step(h, left):
    if h < 0.5 * left:
        return h
    return 0.5 * left if WHOLE * h < left else left


@inlined_uncounted
def accept_step(tangent, reached, largest):
    """Copy ``reached`` into ``tangent`` and update ``largest``, the largest magnitudes so far."""
    n = tangent.shape[1]
    for half in range(2):
        for i in range(n):
            for k in range(tangent.shape[2]):
                x = reached[half, i, k]
                tangent[half, i, k] = x
                largest[n * half + i, k] = max(largest[n * half + i, k], abs(x))


@inlined_uncounted
def reuse_end_node(space):
    """Copy what was linearised at the last node of a step to node 0, the start of the next."""
    copy_elements(space.mass[0], space.mass[STAGES])
    copy_elements(space.stiff[0], space.stiff[STAGES])
    copy_elements(space.damp[0], space.damp[STAGES])
    copy_elements(space.load[0], space.load[STAGES])
    channels = space.channels
    if channels.many.shape[0] > 0:
        copy_elements(channels.push[0], channels.push[STAGES])
        copy_elements(channels.turn[0], channels.turn[STAGES])
        copy_elements(channels.speed[0], channels.speed[STAGES])
        copy_elements(channels.load[0], channels.load[STAGES])
        for c in range(channels.many.shape[0]):
            channels.fade[0, c] = channels.fade[STAGES, c]
        if channels.modes.awake.shape[0] > 0:
            channels.modes.hard[0], channels.modes.lossy[0] = channels.modes.hard[STAGES], channels.modes.lossy[STAGES]
            copy_elements(channels.modes.load[0], channels.modes.load[STAGES])


@inlined_uncounted
def load_string_tangents(row, motion, linear):
    """Put a string's modes to rest where ``row`` (time; time free, s, or negative; step) has a negative second number;
    else wake them and advance their tangents, in place, over the time in which they were free."""
    modes, loads = linear.space.channels.modes, linear.loads
    modes.awake[0] = 0 if row[1] < 0.0 else 1
    if row[1] >= 0.0:
        before = int(row[2]) - 1
        interpolate_state(motion.step[before, 0], before, motion, linear.space.point)
        loads.input[0] = row[1]
        loads.propagate_modes(linear.space.point, loads.input, linear.scene.parameters, loads.modes)
        propagate_free_modes(loads.modes, linear.space.channels)


@inlined_uncounted
def clear_released_memories(channels):
    """Set to 0 the tangents of internal variables of felt that has been released."""
    for c in range(channels.before.shape[0]):
        if channels.began[c] == 1:
            for j in range(channels.inner.shape[1]):
                channels.inner[c, j] = 0.0


@uncounted_loop(FOLLOW)
def integrate_tangents(motion, drive, landings, linear, wanted, tangent, reached, linearise):
    """Integrate ``tangent`` (2, n, P), derivatives of angles and speeds by the parameters, in place along the whole
    motion and fill the outputs of ``wanted``; return status, time reached, s, steps and rejected steps."""
    space, kinks = linear.space, landings.kink
    channels, woken = space.channels, 0
    t = motion.step[0, 0]
    end = motion.step[-1, 0] + motion.step[-1, 1]
    steps, rejected, kink = 0, 0, 0
    place = (0, 0)
    h = FIRST_STEP
    fresh = True
    out = fill_remaining_outputs(0, t, wanted, tangent, channels)
    while t < end:
        while kink < kinks.shape[0] and kinks[kink, 1] <= t:
            kink += 1
        at_kink = kinks[kink, 0] if kink < kinks.shape[0] else 2.0 * end + 1.0
        if at_kink <= t:  # two kinks within a picosecond
            t = kinks[kink, 1]
            fresh = True
            continue
        while woken < landings.woken.shape[0] and landings.woken[woken, 0] <= t:
            load_string_tangents(landings.woken[woken], motion, linear)
            woken += 1
            fresh = True
        if fresh:
            place = linearise_at(t, 0, place, motion, drive, linear, linearise)
            fresh = False
            clear_released_memories(channels)
        # a string's modes are resolved as the motion's steps resolve them: the joints may not tell how fast they swing
        stride = wanted.stride
        if channels.modes.awake.shape[0] > 0 and channels.modes.awake[0] == 1:
            stride = 1
        stop = min(end, at_kink, step_end_limit(t, place[0], motion, stride))
        step = fit_step(h, stop - t)
        after = stop if step == stop - t else t + step
        for m in range(STAGES):
            at = after if m == STAGES - 1 else t + NODES[m] * step
            place = linearise_at(at, m + 1, place, motion, drive, linear, linearise)
        error = 1e300
        if solve_step(step, tangent, space):
            error = estimate_error(step, tangent, wanted, space)
        factor = max(SHRINK, min(GROW, SAFETY * max(error, 1e-12) ** POWER))
        # a kink that is not known leaves an error in proportion to the step across it
        if error > 1.0 and (step > SMALLEST_STEP or error > 1e200):
            rejected += 1
            h = step * factor
            if h < 1e-3 * SMALLEST_STEP:
                return STEP_TOO_SMALL, t, steps, rejected
            continue
        steps += 1
        if steps + rejected > MOST_STEPS * motion.step.shape[0] + 1000:
            return TOO_MANY_STEPS, t, steps, rejected
        if channels.many.shape[0] > 0:
            solve_channels(step, space.slopes, channels)
        while out < wanted.time.shape[0] and wanted.time[out] <= after:
            row, x = wanted.row[out], (wanted.time[out] - t) / step
            interpolate_step(x, step, tangent, space, reached[0], reached[1])
            copy_elements(wanted.angle[row], reached[0])
            copy_elements(wanted.speed[row], reached[1])
            if wanted.channel.shape[0] > 0:
                interpolate_channels(x, channels, wanted.channel[row])
            out += 1
        interpolate_step(1.0, step, tangent, space, reached[0], reached[1])
        accept_step(tangent, reached, space.largest)
        if channels.many.shape[0] > 0:
            advance_channels(channels)
        h = max(step * factor, h if factor >= 1.0 else 0.0)
        t = after
        if after == at_kink:
            t = kinks[kink, 1]
            fresh = True
        else:
            reuse_end_node(space)
    fill_remaining_outputs(out, 2.0 * abs(end) + 1.0, wanted, tangent, channels)
    return DONE, t, steps, rejected
