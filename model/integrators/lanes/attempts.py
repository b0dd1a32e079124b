"""What of an attempt is done lane by lane: input tables, rest, steps fitted to kinks, counts, members that are done."""

from model.integrators.lanes import slots as S
from model.integrators.lanes.lane_input import fit_to_input, input_at, input_gain
from model.integrators.lanes.seats import copy_lane, fill_still, get_up
from model.integrators.rosenbrock import WAKING_STEP
from model.integrators.step_control import DONE, NOT_FINITE, SMALLEST_STEP, STEP_TOO_SMALL, TOO_MANY_STEPS
from model.kernels.compile import uncounted
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RESTS, N_RHS, N_SKIPPED, N_STEPS
from model.kernels.stepping.events import at_rest
from model.kernels.stepping.inputs import constant_until
from model.kernels.workspace import INPUT, V


@uncounted
def read_start(bits, width, n_contacts, members, space):
    """Read input and slope at the start of the step in the lanes of ``bits``, whose forces will be linearised there."""
    number, whole, counters = space.number, space.whole, members.counters
    for lane in range(width):
        if bits >> lane & 1:
            at = S.N_WHOLE * lane
            t, first, last = number[S.TIME * width + lane], whole[at + S.FIRST], whole[at + S.LAST]
            u, slope, k = input_at(t, whole[at + S.POINT], first, last, members.time, members.value)
            whole[at + S.POINT] = k
            number[S.START_INPUT * width + lane] = u
            number[S.SLOPE * width + lane] = slope
            m = whole[at + S.MEMBER]
            counters[m, N_RHS] += 1
            counters[m, N_JACOBIAN] += 1
            counters[m, N_CONTACT] += n_contacts


@uncounted
def read_inputs(bits, width, members, space):
    """Read the input at the times of a stage."""
    number, whole, memory = space.number, space.whole, space.step
    for lane in range(width):
        if bits >> lane & 1:
            at = S.N_WHOLE * lane
            t, first, last = number[S.AT * width + lane], whole[at + S.FIRST], whole[at + S.LAST]
            u, _, k = input_at(t, whole[at + S.POINT], first, last, members.time, members.value)
            whole[at + S.POINT] = k
            memory[INPUT * width + lane] = u


@uncounted
def rest(bits, width, parent, members, space):
    """Let members of the lanes of ``bits`` that are at rest stay until their input changes; which ones did."""
    number, whole, memory = space.number, space.whole, space.step
    n = parent.shape[0]
    rested = 0
    for lane in range(width):
        if bits >> lane & 1:
            at = S.N_WHOLE * lane
            t, end = number[S.TIME * width + lane], number[S.END * width + lane]
            first, last = whole[at + S.FIRST], whole[at + S.LAST]
            quiet = constant_until(t, whole[at + S.POINT], end, first, last, members.time, members.value, False)
            copy_lane(lane, width, n, memory, space.single)
            if quiet > t and at_rest(space.single, parent, space.parts, number[S.REST * width + lane]):
                for i in range(n):
                    memory[(V + i) * width + lane] = 0.0
                fill_still(lane, width, n, quiet, memory, whole, members)
                number[S.AT_REST * width + lane] += quiet - t
                number[S.TIME * width + lane] = quiet
                number[S.WANTED_STEP * width + lane] = WAKING_STEP
                members.counters[whole[at + S.MEMBER], N_RESTS] += 1
                rested |= 1 << lane
    return rested


@uncounted
def fit_steps(bits, width, members, space):
    """Shorten the steps of the lanes of ``bits`` to kinks of their input tables."""
    number, whole, memory = space.number, space.whole, space.step
    n = members.angle.shape[1]
    for lane in range(width):
        if bits >> lane & 1:
            at = S.N_WHOLE * lane
            t, step = number[S.TIME * width + lane], number[S.STEP * width + lane]
            k, last = whole[at + S.POINT], whole[at + S.LAST]
            if k + 1 < last and members.time[k + 1] < t + step:
                gain = input_gain(memory, lane, width, n)
                number[S.STEP * width + lane] = fit_to_input(lane, width, gain, members, space)


@uncounted
def counted(trying, within, prepared, n_stages, n_contacts, width, members, space):
    """Count an attempt: steps, rejections, evaluations."""
    number, whole, counters = space.number, space.whole, members.counters
    for lane in range(width):
        if trying >> lane & 1:
            m = whole[S.N_WHOLE * lane + S.MEMBER]
            if within >> lane & 1:
                counters[m, N_STEPS] += 1
            else:
                counters[m, N_REJECTED] += 1
            if not prepared >> lane & 1:
                continue
            evaluated = int(number[S.EVALUATED * width + lane])
            counters[m, N_RHS] += n_stages - 1
            counters[m, N_CONTACT] += evaluated
            counters[m, N_SKIPPED] += (n_stages - 1) * n_contacts - evaluated


@uncounted
def settle(busy, rejected, sound, width, members, space):
    """Take members that are done, or cannot go on, out of their lanes; which lanes stay busy."""
    number, whole = space.number, space.whole
    for lane in range(width):
        if busy >> lane & 1:
            at = S.N_WHOLE * lane
            whole[at + S.TRIED] += 1
            status = -1
            if not number[S.TIME * width + lane] < number[S.END * width + lane]:
                status = DONE
            elif rejected >> lane & 1 and number[S.WANTED_STEP * width + lane] < SMALLEST_STEP:
                status = STEP_TOO_SMALL if sound >> lane & 1 else NOT_FINITE
            elif whole[at + S.TRIED] >= whole[at + S.MOST]:
                status = TOO_MANY_STEPS
            if status >= 0:
                get_up(lane, width, status, members, space)
                busy &= ~(1 << lane)
    return busy
