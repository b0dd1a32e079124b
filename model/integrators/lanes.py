"""Step loop of the Rosenbrock methods in lanes: load, step and retire the members of a batch side by side.

The algorithm is that of `model.integrators.rosenbrock`; each lane has its own time, step, error, input, outputs, end.
What is computed for one lane never enters another. A lane whose member is done or has failed is given to the next.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import int64

from model.integrators.step_control import (
    BOUND_SLACK,
    DONE,
    FAILED,
    FIRST_STEP,
    NOT_FINITE,
    SMALLEST_STEP,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    fit_to_stop,
    inverse_power,
    is_at_rest,
    next_step_size,
    rejected_step_size,
)
from model.kernels.compile import inlined_uncounted, uncounted, uncounted_loop
from model.kernels.inputs import JUMP, constant_until, fit_to_kinks, input_gain, interpolate_input
from model.kernels.kernel_value import pointer_at
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RESTS, N_RHS, N_SKIPPED, N_STEPS
from model.kernels.signatures import INTEGRATE_LANES, InputTable
from model.kernels.workspace import (
    ACC,
    ALLOWANCE,
    ANGLE_LIMIT,
    AUDIT_Q,
    AUDIT_V,
    AUDIT_Z,
    ERROR,
    FITTED,
    FRACTION,
    IDLE,
    INPUT,
    INPUT_RATE,
    LANE_SIZE,
    M_DIAG,
    M_UP,
    NEEDED,
    NOW,
    Q1,
    SPEED_LIMIT,
    STAGE_STEP,
    STEP_RATE,
    STIFF,
    V1,
    WIDTH,
    WITH_MEMORY,
    Z1,
    Q,
    V,
    Z,
)

# rows of the loop's own numbers, a number per lane
TIME, END, WANTED, REST, LONGEST, STEP, SLOPE, START_INPUT, AT_REST, EXCEEDED = range(10)
QUIET = 10  # time up to which the input was last found to stay constant
BASE_TIME, BASE, KINK = range(11, 14)  # point of the table before the start of the step, time of the next one
N_NUMBERS = 14
# its integers, of each lane
MEMBER, TRIED, POINT, ROWS_DONE, FIRST, LAST, FIRST_WANTED, N_OUT, MOST = range(9)
N_WHOLE = 9


# a member takes a lane, rests in it, leaves it ------------------------------------------------------------------------


@inlined_uncounted
def write_row(lane, width, starts, members, space):
    """Write angles, speeds and internal variables, which begin at the three rows ``starts`` of the step's memory, to
    the next output of the member in a lane."""
    memory, at = space.step, space.whole[N_WHOLE * lane : N_WHOLE * lane + N_WHOLE]
    sizes = members.angle.shape[1], members.angle.shape[1], members.memory.shape[1]
    for k in range(3):
        row = pointer_at(members.out[at[MEMBER], k])
        for i in range(sizes[k]):
            row[at[ROWS_DONE] * sizes[k] + i] = memory[(starts[k] + i) * width + lane]
    at[ROWS_DONE] += 1


@uncounted
def fill_lane_outputs(lane, width, until, members, space):
    at = space.whole[N_WHOLE * lane : N_WHOLE * lane + N_WHOLE]
    while at[ROWS_DONE] < at[N_OUT] and members.wanted[at[FIRST_WANTED] + at[ROWS_DONE]] <= until:
        write_row(lane, width, (Q, V, Z), members, space)


@uncounted
def load_lane(lane, width, m, members, space):
    """Copy state, parameters and limits of member ``m`` into the lane, and fill its outputs up to the start."""
    memory, numbers, number, whole, _, _ = space
    n_z = members.memory.shape[1]
    for k in range(LANE_SIZE if n_z == 0 else WITH_MEMORY):
        memory[k * width + lane] = 0.0
    for i in range(n_z):
        memory[(Z + i) * width + lane] = members.memory[m, i]
    for i in range(members.angle.shape[1]):
        memory[(Q + i) * width + lane] = members.angle[m, i]
        memory[(V + i) * width + lane] = members.speed[m, i]
    for k in range(members.parameters.shape[1]):
        numbers[k * width + lane] = members.parameters[m, k]
    for k in range(5):  # TIME to LONGEST
        number[k * width + lane] = members.start[m, k]
    memory[ANGLE_LIMIT * width + lane] = members.start[m, 5]
    memory[SPEED_LIMIT * width + lane] = members.start[m, 6]
    number[AT_REST * width + lane] = 0.0
    number[QUIET * width + lane] = members.start[m, 0]
    at, place = whole[N_WHOLE * lane : N_WHOLE * lane + N_WHOLE], members.place[m]
    at[MEMBER] = m
    at[TRIED] = 0
    at[FIRST] = at[POINT] = place[0]
    at[LAST] = place[0] + place[1] - 1
    at[FIRST_WANTED] = place[2]
    at[N_OUT] = place[3]
    at[MOST] = place[4]
    at[ROWS_DONE] = 0
    fill_lane_outputs(lane, width, members.start[m, 0], members, space)


@inlined_uncounted
def clear_lane(lane, width, memory, number):
    """Leave a lane without a member: its numbers are computed with the others, and used by nobody."""
    memory[IDLE * width + lane] = 1.0
    memory[ANGLE_LIMIT * width + lane] = memory[SPEED_LIMIT * width + lane] = 1.0
    for k in range(N_NUMBERS):
        number[k * width + lane] = 1.0
    for k in (TIME, START_INPUT, BASE, SLOPE):  # an input that stays: no piece of a motion is looked for
        number[k * width + lane] = 0.0


@uncounted
def retire_lane(lane, width, status, members, space):
    """Write state, time reached, next step, time at rest and ``status`` of a lane to its member, and leave the lane
    idle."""
    memory, _, number, whole, _, _ = space
    m = whole[N_WHOLE * lane + MEMBER]
    for i in range(members.angle.shape[1]):
        members.angle[m, i] = memory[(Q + i) * width + lane]
        members.speed[m, i] = memory[(V + i) * width + lane]
    for i in range(members.memory.shape[1]):
        members.memory[m, i] = memory[(Z + i) * width + lane]
    members.reached[m, 0] = number[TIME * width + lane]
    members.reached[m, 1] = number[WANTED * width + lane]
    members.reached[m, 2] = number[AT_REST * width + lane]
    members.status[m] = status
    clear_lane(lane, width, memory, number)


@inlined_uncounted
def fill_lanes(busy, following, width, members, space):
    """Load the next members with something to do, from number ``following`` on, into the lanes without a bit in
    ``busy``; return the bits of busy lanes and the number of who is next. Members with nothing to do are retired as
    `DONE`."""
    for lane in range(width):
        while not busy >> lane & 1 and following < members.angle.shape[0]:
            load_lane(lane, width, following, members, space)
            following += 1
            if space.number[TIME * width + lane] < space.number[END * width + lane]:
                busy |= 1 << lane
            else:
                retire_lane(lane, width, DONE, members, space)
        if not busy >> lane & 1:
            clear_lane(lane, width, space.step, space.number)
    return busy, following


@inlined_uncounted
def is_nearly_at_rest(lane, width, n, memory, number):
    """Return whether a lane's ``n`` coordinates move, in a step of the size to try, by less than its limit of rest,
    under an input that does not change, so that it may be at rest."""
    if number[SLOPE * width + lane] != 0.0:
        return False
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, abs(memory[(V + i) * width + lane]))
    return fastest * number[WANTED * width + lane] < number[REST * width + lane]


@inlined_uncounted
def skip_resting_lanes(bits, width, parent, members, space):
    """Advance members at rest in the lanes of ``bits`` to where their input changes; return the bits of these lanes."""
    number, whole, memory, single = space.number, space.whole, space.step, space.single
    n = parent.shape[0]
    drive = InputTable(members.time, members.value, False)
    rested = 0
    for lane in range(width):
        if bits >> lane & 1 and is_nearly_at_rest(lane, width, n, memory, number):
            at = N_WHOLE * lane
            t, end = number[TIME * width + lane], number[END * width + lane]
            quiet = number[QUIET * width + lane]
            if quiet <= t:
                quiet = constant_until(t, whole[at + POINT], end, whole[at + FIRST], whole[at + LAST], drive)
                number[QUIET * width + lane] = quiet
            for i in range(n):  # what decides about rest, as in the workspace of one run
                for start in (V, ACC, M_DIAG, M_UP):
                    single[start + i] = memory[(start + i) * width + lane]
                for j in range(n):
                    k = STIFF + WIDTH * i + j
                    single[k] = memory[k * width + lane]
            if quiet > t and is_at_rest(single, parent, space.parts, number[REST * width + lane]):
                for i in range(n):
                    memory[(V + i) * width + lane] = 0.0
                fill_lane_outputs(lane, width, quiet, members, space)
                number[AT_REST * width + lane] += quiet - t
                number[TIME * width + lane] = quiet
                number[WANTED * width + lane] = FIRST_STEP
                members.counters[whole[at + MEMBER], N_RESTS] += 1
                rested |= 1 << lane
    return rested


# an attempt -----------------------------------------------------------------------------------------------------------


@inlined_uncounted
def read_start_input(bits, width, n_contacts, members, space):
    """Set the input at the start of the step, and its slope, of the lanes of ``bits``, which are linearised there, and
    count that for their members."""
    number, whole, counters, memory = space.number, space.whole, members.counters, space.step
    drive = InputTable(members.time, members.value, False)
    for lane in range(width):
        if bits >> lane & 1:
            at, t = N_WHOLE * lane, number[TIME * width + lane]
            u, slope, k = interpolate_input(t, whole[at + POINT], whole[at + FIRST], whole[at + LAST], drive)
            whole[at + POINT] = k
            number[BASE_TIME * width + lane], number[BASE * width + lane] = drive.time[k], drive.value[k]
            number[KINK * width + lane] = drive.time[k + 1] - JUMP if drive.time[k] <= t else t
            number[START_INPUT * width + lane] = u
            number[SLOPE * width + lane] = slope
            m = whole[at + MEMBER]
            counters[m, N_RHS] += 1
            counters[m, N_JACOBIAN] += 1
            counters[m, N_CONTACT] += n_contacts
        memory[INPUT * width + lane] = number[START_INPUT * width + lane]
        if members.memory.shape[1] > 0:
            memory[NOW * width + lane] = number[TIME * width + lane]


@inlined_uncounted
def read_stage_input(bits, width, node, members, space):
    """Set the input of every lane at the fraction ``node`` of its step; lanes of ``bits`` past a kink look it up."""
    number, whole, memory = space.number, space.whole, space.step
    late = 0
    for lane in range(width):  # of all lanes, so that they are computed together
        t = number[TIME * width + lane] + node * number[STEP * width + lane]
        since = t - number[BASE_TIME * width + lane]
        memory[INPUT * width + lane] = number[BASE * width + lane] + number[SLOPE * width + lane] * since
        late |= (t >= number[KINK * width + lane]) << lane
    late &= bits
    drive = InputTable(members.time, members.value, False)
    for lane in range(width):
        if late >> lane & 1:
            t = number[TIME * width + lane] + node * number[STEP * width + lane]
            at = N_WHOLE * lane
            k, first, last = whole[at + POINT], whole[at + FIRST], whole[at + LAST]
            memory[INPUT * width + lane], _, whole[at + POINT] = interpolate_input(t, k, first, last, drive)


@inlined_uncounted
def choose_steps(bits, width, gamma, members, space):
    """Set the step of each lane and how far each coordinate may go in it: steps end where their member ends and, in the
    lanes of ``bits``, at harmful kinks of the input; ``gamma``: the method's."""
    number, whole, memory = space.number, space.whole, space.step
    n = members.angle.shape[1]
    drive = InputTable(members.time, members.value, False)
    for lane in range(width):
        t = number[TIME * width + lane]
        step = fit_to_stop(number[END * width + lane], t, memory[FITTED * width + lane])
        k, last = whole[N_WHOLE * lane + POINT], whole[N_WHOLE * lane + LAST]
        if bits >> lane & 1 and k + 1 < last and members.time[k + 1] < t + step:
            bounds = memory[ANGLE_LIMIT * width + lane], memory[SPEED_LIMIT * width + lane]
            gain = input_gain(memory, lane, width, n)
            step = fit_to_kinks(t, step, number[START_INPUT * width + lane], k, last, drive, gain, bounds)
        number[STEP * width + lane] = step
    for lane in range(width):
        step = number[STEP * width + lane]
        memory[STEP_RATE * width + lane] = 1.0 / step
        memory[STAGE_STEP * width + lane] = gamma * step
        number[EXCEEDED * width + lane] = 0.0
    for i in range(WIDTH):  # prescribed coordinates too
        for lane in range(width):
            step = number[STEP * width + lane]
            v, acc = memory[(V + i) * width + lane], memory[(ACC + i) * width + lane]
            memory[(ALLOWANCE + i) * width + lane] = 1.5 * step * abs(v) + step * step * abs(acc) + BOUND_SLACK


@inlined_uncounted
def accept_or_reject(trying, sound, rejected, exponent, width, space):
    """Set the next step size of the lanes of ``trying``; return the bits of those whose error norm is at most 1.
    ``sound``: lanes that could be solved and are finite; ``rejected``: lanes whose attempt before was rejected."""
    number, memory = space.number, space.step
    within = 0
    for lane in range(width):
        if trying >> lane & 1:
            step, error = number[STEP * width + lane], memory[ERROR * width + lane]
            power = inverse_power(error, exponent)
            if not sound >> lane & 1:
                number[WANTED * width + lane] = FAILED * step
            elif error <= 1.0:
                within |= 1 << lane
                before = rejected >> lane & 1 == 1
                h, fitted = number[WANTED * width + lane], memory[FITTED * width + lane]
                number[WANTED * width + lane] = next_step_size(step, power, before, fitted, h)
            else:
                number[WANTED * width + lane] = rejected_step_size(step, power)
    return within


@inlined_uncounted
def step_end_time(lane, width, number):
    t, step, end = number[TIME * width + lane], number[STEP * width + lane], number[END * width + lane]
    return end if step == end - t else t + step


@inlined_uncounted
def find_next_output(bits, width, members, space):
    """Return the lanes of ``bits`` with another output within their steps, and set its fraction of the step."""
    number, whole = space.number, space.whole
    asking = 0
    for lane in range(width):
        at = N_WHOLE * lane
        k = whole[at + ROWS_DONE]
        if bits >> lane & 1 and k < whole[at + N_OUT]:
            when = members.wanted[whole[at + FIRST_WANTED] + k]
            if when <= step_end_time(lane, width, number):
                t, step = number[TIME * width + lane], number[STEP * width + lane]
                space.step[FRACTION * width + lane] = (when - t) / step
                asking |= 1 << lane
    return asking


@inlined_uncounted
def write_rows(bits, width, members, space):
    """Write the state inside the step of each lane of ``bits`` to its member's next row."""
    for lane in range(width):
        if bits >> lane & 1:
            write_row(lane, width, (AUDIT_Q, AUDIT_V, AUDIT_Z), members, space)


@inlined_uncounted
def store_accepted(within, width, members, space):
    """Replace state and time by those at the end of the step, in the lanes with a bit in ``within``."""
    memory = space.step
    for start, end, n in (
        (Q, Q1, members.angle.shape[1]),
        (V, V1, members.angle.shape[1]),
        (Z, Z1, members.memory.shape[1]),
    ):
        for i in range(n):
            for lane in range(width):  # a choice, so that it becomes one instruction for all of them
                old, new = memory[(start + i) * width + lane], memory[(end + i) * width + lane]
                memory[(start + i) * width + lane] = new if within >> lane & 1 else old
    for lane in range(width):
        if within >> lane & 1:
            space.number[TIME * width + lane] = step_end_time(lane, width, space.number)


@inlined_uncounted
def count_attempt(trying, within, prepared, shape, width, members, space):
    """Count an attempt for the members in the lanes of ``trying``: steps (lanes of ``within``), else rejections, and,
    in the lanes of ``prepared``, evaluations; ``shape``: numbers of stages and of contacts."""
    n_stages, n_contacts = shape
    for lane in range(width):
        if trying >> lane & 1:
            m = space.whole[N_WHOLE * lane + MEMBER]
            members.counters[m, N_STEPS if within >> lane & 1 else N_REJECTED] += 1
            if prepared >> lane & 1:
                needed = (n_stages - 1) * space.step[NEEDED * width + lane]
                evaluated = int(needed + space.number[EXCEEDED * width + lane])
                members.counters[m, N_RHS] += n_stages - 1
                members.counters[m, N_CONTACT] += evaluated
                members.counters[m, N_SKIPPED] += (n_stages - 1) * n_contacts - evaluated


@inlined_uncounted
def retire_finished_lanes(busy, rejected, sound, width, members, space):
    """Retire members that are at their end, took a step too small, are not finite or had too many attempts; return the
    bits of the lanes that stay busy."""
    number, whole = space.number, space.whole
    for lane in range(width):
        if busy >> lane & 1:
            at = N_WHOLE * lane
            whole[at + TRIED] += 1
            status = -1
            if not number[TIME * width + lane] < number[END * width + lane]:
                status = DONE
            elif rejected >> lane & 1 and number[WANTED * width + lane] < SMALLEST_STEP:
                status = STEP_TOO_SMALL if sound >> lane & 1 else NOT_FINITE
            elif whole[at + TRIED] >= whole[at + MOST]:
                status = TOO_MANY_STEPS
            if status >= 0:
                retire_lane(lane, width, status, members, space)
                busy &= ~(1 << lane)
    return busy


@cache
def compile_lane_loop(width: int) -> Any:
    """Compiled step loop of ``width`` members side by side, which takes (members, parent, n_contacts, kernels,
    method, space), advances every member to its end, or as far as it comes, in place, and returns how many attempts
    that took."""

    @uncounted_loop(INTEGRATE_LANES)
    def integrate(members, parent, n_contacts, kernels, method, space):
        """Advance every member to its end, or as far as it comes; returns how many attempts that took."""
        a, c, b, node, d, dense, gamma, exponent = method
        memory, numbers, number, _, _, _ = space
        n_z, n_stages, n_dense = members.memory.shape[1], b.shape[0], dense.shape[0]
        busy = fresh = rejected = following = attempts = int64(0)  # a plain 0 would be a type of its own, compiled anew
        while True:
            stayed = busy
            busy, following = fill_lanes(stayed, following, width, members, space)
            if not busy:
                return attempts
            fresh = (fresh & stayed) | (busy & ~stayed)
            rejected &= stayed
            attempts += 1
            read_start_input(fresh, width, n_contacts, members, space)
            kernels.linearise(memory, numbers)
            # felt that remembers may still creep: what it will do, the bound on rest does not know
            rested = skip_resting_lanes(fresh if n_z == 0 else 0, width, parent, members, space)
            for lane in range(width):  # the steps wanted, before they are fitted to events
                h = min(number[WANTED * width + lane], number[LONGEST * width + lane])
                number[WANTED * width + lane] = memory[FITTED * width + lane] = h
            kernels.fit(memory, numbers)
            trying = busy & ~rested
            # contacts are left out only while every stage stays within its allowance: the answer is the same
            choose_steps(trying, width, gamma, members, space)
            prepared = kernels.prepare(memory)
            mask = kernels.skip(memory, numbers)
            for m in range(n_stages):
                if m > 0 and (m == 1 or node[m] != node[m - 1]):
                    read_stage_input(trying, width, node[m], members, space)
                for lane in range(width):  # what the change of the input adds to a stage
                    weight = number[STEP * width + lane] * d[m] * number[SLOPE * width + lane]
                    memory[INPUT_RATE * width + lane] = weight
                exceeded = kernels.stage(memory, numbers, a, c, m, mask)
                if m > 0 and exceeded:  # all contacts count, not only those needed
                    for lane in range(width):
                        if exceeded >> lane & 1:
                            number[EXCEEDED * width + lane] += n_contacts - memory[NEEDED * width + lane]
            sound = prepared & trying & kernels.end(memory, b, n_stages, n_z)
            within = accept_or_reject(trying, sound, rejected, exponent, width, space)
            asking = find_next_output(within, width, members, space)
            if asking:
                kernels.dense(memory, dense, n_dense, n_stages, n_z)
            while asking:
                kernels.interpolate(memory, n_dense, n_z)
                write_rows(asking, width, members, space)
                asking = find_next_output(asking, width, members, space)
            store_accepted(within, width, members, space)
            count_attempt(trying, within, prepared, (n_stages, n_contacts), width, members, space)
            rejected = trying & ~within
            fresh = within | rested
            busy = retire_finished_lanes(busy, rejected, sound, width, members, space)

    return integrate
