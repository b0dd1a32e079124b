"""Input table of a run: its value and slope, how long it stays constant, and step limits at its kinks.

A table is linear between its points, or held; a held input jumps, so each of its points ends a step. A linear
input has kinks only: steps cross them where an a-priori bound says that the tolerance can bear it. Tables of members
side by side in lanes lie one after the other in one array, each from its ``first`` to its ``last`` point.
"""

from model.kernels.compile import inlined_uncounted, uncounted
from model.kernels.workspace import F_U, M_DIAG

# What a method loses at a kink inside a step, as a share of the bound on the kink's effect; measured with
# benchmarks/tolerance.py on noisy tables: less rejects more steps, more lands on too many points.
KINK_SHARE = 0.5
# Points of a linear table closer than this (s) are a jump; no step is taken inside it.
JUMP = 1e-10


@uncounted
def interpolate_input(t, k, first_row, last_row, drive):
    """Return the input at ``t``, its slope (0 if held) and the row that holds ``t``, searched from row ``k``;
    ``drive``: (times, values, whether held from row to row); outside the table the nearest end's value."""
    time, value, held = drive
    early = 0.0 if held else JUMP
    while k < last_row - 1 and t >= time[k + 1] - early:
        k += 1
    while k > first_row and t < time[k] - early:
        k -= 1
    while k < last_row - 1 and time[k + 1] - time[k] <= early and t >= time[k] - early:  # a jump: what is behind it
        k += 1
    if held:
        return value[last_row] if t >= time[last_row] else value[k], 0.0, k
    if t < time[first_row]:
        return value[first_row], 0.0, k
    if t >= time[last_row] - early or time[last_row] - time[k] <= early:
        return value[last_row], 0.0, k
    slope = (value[k + 1] - value[k]) / (time[k + 1] - time[k])
    return value[k] + slope * (t - time[k]), slope, k


@inlined_uncounted
def interpolate_own_input(t, k, drive):
    return interpolate_input(t, k, 0, drive.time.shape[0] - 1, drive)


@uncounted
def constant_until(t, k, t_end, first_row, last_row, drive):
    """Return the time, at most ``t_end``, up to which the input keeps its value at ``t``.

    ``k`` is the row that `interpolate_input` returned for ``t``, in a table from ``first_row`` to ``last_row``.
    """
    time, value, held = drive
    if t < time[first_row]:
        return min(t_end, time[first_row])
    if t >= time[last_row]:
        return t_end
    j = k
    while j < last_row and value[j + 1] == value[k]:
        j += 1
    if j == last_row:
        return t_end
    return min(t_end, max(t, time[j + 1] if held else time[j]))


@uncounted
def input_gain(w, lane, width, n):
    """Return the largest acceleration of a coordinate by a unit of input, times `KINK_SHARE`, in a lane of the
    workspace ``w``.

    ``w`` is a workspace of rows of ``width`` lanes, of which ``lane`` is read, with ``n`` coordinates.
    """
    gain = 0.0
    for i in range(n):
        f_u = w[(F_U + i) * width + lane]
        if f_u != 0.0:
            gain = max(gain, abs(f_u) / w[(M_DIAG + i) * width + lane])
    return KINK_SHARE * gain


@uncounted
def fit_to_kinks(t, step, u0, k, last_row, drive, gain, bounds):
    """Return ``step`` (s) from ``t``, shortened so that no kink of the input inside it errs by more than ``bounds``
    (rad, rad/s); ``gain``: acceleration per input.

    ``u0`` is the input at ``t``, ``k`` the row that `interpolate_input` returned, ``last_row`` the table's last,
    ``gain`` that of `input_gain`; ``bounds`` are the largest errors of an angle (rad) and a speed (rad/s).

    A kink of strength s, a time r before the end of the step, which began with the slope before it, bends the
    speed by at most |f_u| / M * s r^2 / 2. Where too much of that would be lost the step ends at the kink. Many weak
    kinks add up to a departure from the chord, which is bounded likewise.
    """
    time, value, _ = drive
    angle, speed = bounds
    while True:
        end = t + step
        u1, _, _ = interpolate_input(end, k, k, last_row, drive)
        bend = 0.0
        j = k + 1
        while j < last_row and time[j] < end:
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


@inlined_uncounted
def fit_to_input(t, step, u0, k, drive, w, n, limits):
    """Return `fit_to_kinks` of a single run, whose table is all of ``drive``, from its workspace ``w``."""
    bounds = limits.angle, limits.speed
    return fit_to_kinks(t, step, u0, k, drive.time.shape[0] - 1, drive, input_gain(w, 0, 1, n), bounds)
