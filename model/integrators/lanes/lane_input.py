"""The input tables of members side by side: value and slope, kinks inside a step.

As `model.kernels.stepping.inputs`, for tables that are linear between their points and lie one after the other in one
array: ``first`` and ``last`` are the places of a table's ends.
"""

from model.integrators.lanes import slots as S
from model.kernels.compile import uncounted
from model.kernels.stepping.inputs import JUMP, KINK_SHARE
from model.kernels.workspace import F_U, M_DIAG


@uncounted
def input_at(t, k, first, last, time, value):
    """Input at ``t`` and its slope; ``k`` is a start for the search. Returns u, slope, k."""
    while k < last - 1 and t >= time[k + 1] - JUMP:
        k += 1
    while k > first and t < time[k] - JUMP:
        k -= 1
    if t < time[first]:
        return value[first], 0.0, k
    if t >= time[last] - JUMP:
        return value[last], 0.0, k
    slope = (value[k + 1] - value[k]) / (time[k + 1] - time[k])
    return value[k] + slope * (t - time[k]), slope, k


@uncounted
def input_gain(memory, lane, width, n):
    """Most that a unit of input accelerates a coordinate."""
    gain = 0.0
    for i in range(n):
        f_u = memory[(F_U + i) * width + lane]
        if f_u != 0.0:
            gain = max(gain, abs(f_u) / memory[(M_DIAG + i) * width + lane])
    return KINK_SHARE * gain


@uncounted
def fit_to_input(lane, width, gain, members, space):
    """The step of a lane, so short that no kink of its table inside it can do harm; see `stepping.inputs`."""
    number, time, value = space.number, members.time, members.value
    t, step = number[S.TIME * width + lane], number[S.STEP * width + lane]
    angle, speed = number[S.ANGLE * width + lane], number[S.SPEED * width + lane]
    u0 = number[S.START_INPUT * width + lane]
    k, last = space.whole[S.N_WHOLE * lane + S.POINT], space.whole[S.N_WHOLE * lane + S.LAST]
    while True:
        end = t + step
        u1, _, _ = input_at(end, k, k, last, time, value)
        bend = 0.0
        j = k + 1
        while j < last and time[j] < end:
            before = (value[j] - value[j - 1]) / (time[j] - time[j - 1])
            after = (value[j + 1] - value[j]) / (time[j + 1] - time[j])
            reach = end - time[j]
            if gain * abs(after - before) * reach * reach > speed and time[j] - t > 1e-9:
                return time[j] - t
            bend = max(bend, abs(value[j] - (u0 + (u1 - u0) * (time[j] - t) / step)))
            j += 1
        if step < 1e-6 or gain * bend * step <= max(speed, angle / step):
            return step
        step *= 0.5
