"""The compiled step loop of every Rosenbrock method, for members side by side in lanes.

The algorithm is that of `model.integrators.rosenbrock`; each lane has its own time, step, error, input, outputs, end.
An attempt advances all lanes; each lane then accepts or rejects its own. A lane whose member is done or has failed is
given to the next member at once. What is computed for one lane never enters another, so that a member's numbers do not
depend on who sits beside it.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import int64

from model.integrators.lanes import slots as S
from model.integrators.lanes.attempts import counted, fit_steps, read_inputs, read_start, rest, settle
from model.integrators.lanes.outputs import give_out
from model.integrators.lanes.seats import fill_lanes
from model.integrators.rosenbrock import STAGE
from model.integrators.step_control import GROW, SAFETY, SHRINK
from model.kernels.compile import inlined, uncounted_loop
from model.kernels.lanes.events import fit_to_events
from model.kernels.lanes.maths import power
from model.kernels.lanes.operations import bits_of, filled, mask_of, rows, where
from model.kernels.signatures import INTEGRATE_LANES
from model.kernels.workspace import (
    ACC,
    ALLOWANCE,
    INPUT,
    INPUT_RATE,
    MOST_MEMORIES,
    NEEDED,
    NOW,
    Q1,
    STAGE_STEP,
    STEP_RATE,
    WIDTH,
    Z1,
    Z_U,
    Z_WEIGHT,
    Q,
    U,
    V,
    Z,
)  # fmt: skip

INFINITE = float("inf")


@inlined
def ending_at(stop, t, step):
    """As `model.integrators.step_control.ending_at`."""
    left = stop - t
    return where(t + 1.01 * step >= stop, left, where(t + 2.0 * step > stop, 0.5 * left, step))


@inlined
def allow(w, step, n):
    """As `model.integrators.step_control.allow`."""
    for i in range(n):
        w[ALLOWANCE + i] = 1.5 * step * abs(w[V + i]) + step * step * abs(w[ACC + i]) + 1e-7


@inlined
def advance_to_end(w, b, n):
    """The state at the end of the step from its stages, and the estimate of its error against the tolerances."""
    for half in range(2):
        for i in range(WIDTH * half, WIDTH * half + n):
            x = w[Q + i]
            for m in range(b.shape[0]):
                x += b[m] * w[U + STAGE * m + i]
            w[Q1 + i] = x


@inlined
def embedded_error(w, stage, n, angle, speed):
    """Whether the estimate is finite, and its size against the tolerances."""
    last = U + STAGE * stage
    largest_q = filled(0.0, angle)
    largest_v = largest_q
    finite = largest_q == 0.0
    for i in range(n):
        eq = abs(w[last + i])
        ev = abs(w[last + WIDTH + i])
        finite = finite & (eq < INFINITE) & (ev < INFINITE)
        largest_q = max(largest_q, eq)
        largest_v = max(largest_v, ev)
    error = max(largest_q / angle, largest_v / speed)
    return finite & (error < INFINITE), error


@inlined
def end_memories(w, b, n_z, speed, error):
    """Memories at the end of the step; the larger of ``error`` and theirs, no number where one is none."""
    last = b.shape[0] - 1
    for i in range(n_z):
        end = w[Z + i]
        for m in range(b.shape[0]):
            end += b[m] * w[Z_U + MOST_MEMORIES * m + i]
        w[Z1 + i] = end
        wrong = abs(w[Z_U + MOST_MEMORIES * last + i]) * w[Z_WEIGHT + i] / speed
        error = where(wrong <= error, error, wrong)
    return error


@inlined
def next_step(step, error, exponent, accepted, sound, rejected_before, fitted, h):
    """The step to want next, after an accepted attempt or to try again."""
    factor = SAFETY * power(min(max(error, 1e-300), 1e300), -exponent)
    grown = where(error == 0.0, GROW, min(GROW, max(SHRINK, factor)))
    grown = where(rejected_before, min(grown, 1.0), grown)
    held = (step < fitted) & (fitted == h) & (grown >= 1.0)
    after = max(step * grown, where(held, h, 0.0))
    return where(accepted, after, step * where(sound, max(SHRINK, factor), 0.2))


@inlined
def nearly_still(w, s, n):
    """Bits of the lanes that move so little, under an input that does not change, that they may be at rest."""
    fastest = abs(w[V])
    for i in range(1, n):
        fastest = max(fastest, abs(w[V + i]))
    return bits_of((s[S.SLOPE] == 0.0) & (fastest * s[S.WANTED_STEP] < s[S.REST]))


@inlined
def chosen_step(w, p, s, n, n_contacts):
    """The step wanted, and that shortened to events and to the end of the run."""
    h = min(s[S.WANTED_STEP], s[S.LONGEST])
    fitted = fit_to_events(h, w, p, n, n_contacts, s[S.SPEED])
    s[S.WANTED_STEP] = h
    s[S.FITTED] = fitted
    s[S.STEP] = ending_at(s[S.END], s[S.TIME], fitted)


@inlined
def commit(w, s, accepted, n, n_z):
    """The state and time of the lanes that were accepted."""
    for i in range(n_z):
        w[Z + i] = where(accepted, w[Z1 + i], w[Z + i])
    t, step, end = s[S.TIME], s[S.STEP], s[S.END]
    for half in range(2):
        for i in range(WIDTH * half, WIDTH * half + n):
            w[Q + i] = where(accepted, w[Q1 + i], w[Q + i])
    s[S.TIME] = where(accepted, where(step == end - t, end, t + step), t)


@cache
def loop_in_lanes(width: int) -> Any:
    """The step loop for ``width`` lanes."""

    @uncounted_loop(INTEGRATE_LANES)
    def integrate(members, parent, n_contacts, kernels, method, space):
        """Advance every member to its end, or as far as it comes; returns how many attempts that took."""
        a, c, b, node, d, dense, gamma, exponent = method
        memory, numbers, number, _, _, _ = space
        w = rows(memory, width)
        p = rows(numbers, width)
        s = rows(number, width)
        n, n_z = members.angle.shape[1], members.memory.shape[1]
        n_stages = b.shape[0]
        # a plain 0 would be a type of its own, for which numba compiles all that takes a seat once more
        busy, following = fill_lanes(int64(0), int64(0), width, members, space)
        fresh = busy
        rejected = 0
        attempts = 0
        while busy:
            attempts += 1
            read_start(fresh, width, n_contacts, members, space)
            w[INPUT] = s[S.START_INPUT]
            if n_z > 0:
                w[NOW] = s[S.TIME]
            kernels.linearise(memory, numbers)
            # felt that remembers may still creep: what it will do, the bound on rest does not know
            still = 0 if n_z > 0 else nearly_still(w, s, n) & fresh
            rested = rest(still, width, parent, members, space)
            chosen_step(w, p, s, n, n_contacts)
            trying = busy & ~rested
            fit_steps(trying, width, members, space)
            step = s[S.STEP]
            w[STEP_RATE] = 1.0 / step
            w[STAGE_STEP] = gamma * step
            prepared = kernels.prepare(memory)
            # contacts are left out only while every stage stays within these allowances: the answer is the same
            allow(w, step, n)
            mask = kernels.skip(memory, numbers)
            needed = w[NEEDED]
            evaluated = filled(0.0, step)
            for m in range(n_stages):
                if m > 0 and (m == 1 or node[m] != node[m - 1]):
                    s[S.AT] = s[S.TIME] + node[m] * step
                    read_inputs(trying, width, members, space)
                w[INPUT_RATE] = step * d[m] * s[S.SLOPE]
                exceeded = kernels.stage(memory, numbers, a, c, m, mask)
                if m > 0:
                    evaluated += where(mask_of(exceeded, width), float(n_contacts), needed)
            s[S.EVALUATED] = evaluated
            advance_to_end(w, b, n)
            finite, error = embedded_error(w, n_stages - 1, n, s[S.ANGLE], s[S.SPEED])
            if n_z > 0:
                error = end_memories(w, b, n_z, s[S.SPEED], error)
                finite = finite & (error < INFINITE)
            sound = prepared & bits_of(finite) & trying
            within = sound & bits_of(error <= 1.0)
            accepted = mask_of(within, width)
            s[S.NEXT_STEP] = next_step(
                step, error, exponent, accepted, mask_of(sound, width), mask_of(rejected, width), s[S.FITTED],
                s[S.WANTED_STEP],
            )  # fmt: skip
            s[S.WANTED_STEP] = where(mask_of(trying, width), s[S.NEXT_STEP], s[S.WANTED_STEP])
            give_out(within, w, s, width, dense, members, space)
            commit(w, s, accepted, n, n_z)
            counted(trying, within, prepared, n_stages, n_contacts, width, members, space)
            rejected = trying & ~within
            fresh = within | rested
            busy = settle(busy, rejected, sound, width, members, space)
            stayed = busy
            busy, following = fill_lanes(stayed, following, width, members, space)
            fresh = (fresh & stayed) | (busy & ~stayed)
            rejected &= stayed
        return attempts

    return integrate
