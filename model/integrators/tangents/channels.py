"""Internal variables of felt and string in a tangent step: each couples to the joints through one scalar, a channel.

A memory z of felt follows z' = g(q, v, z), a first-order equation whose tangent at the nodes of a step is linear in
those of the joints. A string's modes follow the force of its contact, which follows their sums. Either way the number s
that reaches the joints answers to what enters, e = g_q sigma + g_v nu + load, by a small matrix over the nodes: of felt
s is the tangent of z, of the string what its modes take off the tangent of the force. So both are eliminated from the
system of the joints, as a step of the motion eliminates them.
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from model.kernels import workspace as W
from model.kernels.compile import inlined_uncounted, uncounted_loop
from model.kernels.lanes import LANES, broadcast_like, rows

Array = NDArray[np.float64]


class Collocation(NamedTuple):
    """A method with s nodes.

    nodes : (s,) shares of a step; the last is 1
    lagrange : (s, s) coefficients, lowest power first, of the polynomials that are 1 at a node and 0 at the others
    once, twice : (s, s) weights of the second derivative in the first and in the value at the nodes
    filter : share of a step by which the estimate is damped
    estimate_rise, estimate_once, estimate_twice : the estimate's weights of the first derivative, of the second
        derivatives in that of the first, and in that of the value; its order is s
    """

    nodes: Array
    lagrange: Array
    once: Array
    twice: Array
    filter: float
    estimate_rise: float
    estimate_once: Array
    estimate_twice: Array


def make_radau_collocation(stages: int) -> Collocation:
    """Radau IIA collocation with an odd number of ``stages``: nodes, matrices, error estimate."""
    one, two = np.polynomial.Polynomial([0.0] * (stages - 1) + [1.0]), np.polynomial.Polynomial([-1.0, 1.0])
    nodes = np.sort((one * two**stages).deriv(stages - 1).roots().real)
    nodes[-1] = 1.0
    powers = np.arange(1, stages + 1)
    steep = np.vander(nodes, increasing=True)
    lagrange = np.linalg.inv(steep).T
    once = (nodes[:, None] ** powers / powers) @ lagrange.T
    values = np.linalg.eigvals(np.linalg.inv(once))
    damped = float(1.0 / values[np.argmin(np.abs(values.imag))].real)
    moments = 1.0 / powers
    moments[0] -= damped
    estimate = np.linalg.solve(steep.T, moments) - once[-1]
    of_values = estimate @ np.linalg.inv(once)
    rise = damped + float(of_values @ nodes)
    twice = once @ once
    return Collocation(
        nodes, np.ascontiguousarray(lagrange), np.ascontiguousarray(once), np.ascontiguousarray(twice), damped,
        rise, estimate, of_values @ twice,
    )  # fmt: skip


STAGES = 5  # of Radau's method: the ninth order
METHOD = make_radau_collocation(STAGES)
NODES, ONCE, TWICE = METHOD.nodes, METHOD.once, METHOD.twice
WAY_BY_WAY, WAY_BY_RATE, RATE_BY_WAY, RATE_BY_RATE = range(4)


class Modes(NamedTuple):
    """Tangents of a string's K modes, and how they answer in a step; of no string empty.

    awake : (1,) 1 where they are stepped
    first : (1,) place of their numbers in the parameter vector
    number : (3, K) gains, stiffnesses, dampings; ``moved`` (3, K, P) their derivatives
    tangent : (2, K, P) of ways and rates
    load : (S + 1, K, P) of their rates, filled where ``loaded`` (1,) is 1
    hard, lossy : (S + 1,) of the contact's force by way and rate
    start : (K, 4, S) way and rate at the nodes by those at the start
    forced : (K, 2, S, S) way and rate at the nodes by the mode's acceleration from outside
    force : (S, S) the force's tangent by what enters
    sums : (2, S, P) what ways and rates add up to at the nodes without the force
    """

    awake: np.ndarray
    first: np.ndarray
    number: np.ndarray
    moved: np.ndarray
    tangent: np.ndarray
    load: np.ndarray
    loaded: np.ndarray
    hard: np.ndarray
    lossy: np.ndarray
    start: np.ndarray
    forced: np.ndarray
    force: np.ndarray
    sums: np.ndarray


class Channels(NamedTuple):
    """C channels, the string's last, at the start of a step and at its S nodes.

    links, many : (C, k) coordinates that it acts on, or -1 - i of the i-th prescribed one; (C,) how many they are
    push, turn, speed : (S + 1, C, k) force by s; what enters by angle and by speed
    fade : (S + 1, C) of felt, rate of z by z
    load : (S + 1, C, P) what enters by parameters
    operator, free : (C, S, S), (C, S) s at the nodes by what enters and, of felt, by s at the start
    known, value, entered : (S, C, P) s without the joints' answer; s; what enters in all
    inner : (C, P) s of felt at the start of the step
    before : (C,) what felt remembered before the last node was linearised
    began : (C,) 1 where it starts anew there
    small : (3, S, S) for what is computed
    """

    links: np.ndarray
    many: np.ndarray
    push: np.ndarray
    turn: np.ndarray
    speed: np.ndarray
    fade: np.ndarray
    load: np.ndarray
    operator: np.ndarray
    free: np.ndarray
    known: np.ndarray
    value: np.ndarray
    entered: np.ndarray
    inner: np.ndarray
    before: np.ndarray
    began: np.ndarray
    small: np.ndarray
    modes: Modes


_f, _i = types.float64, types.int64
_numbers, _table, _cube, _four = (types.Array(_f, k, "C") for k in (1, 2, 3, 4))
_integers, _links = types.Array(_i, 1, "C"), types.Array(_i, 2, "C")
MODES = types.NamedTuple(
    [_integers, _integers, _table, *[_cube] * 3, _integers, _numbers, _numbers, _cube, _four, _table, _cube], Modes
)
CHANNELS = types.NamedTuple(
    [
        _links,
        _integers,
        *[_cube] * 3,
        _table,
        *[_cube] * 2,
        _table,
        *[_cube] * 3,
        _table,
        _numbers,
        _integers,
        _cube,
        MODES,
    ],
    Channels,
)
FILL = types.void(_i, _numbers, CHANNELS)
LOAD_MODES = types.void(_i, _i, _numbers, MODES)
ANSWERS = types.void(_f, CHANNELS)
COUPLE = types.void(_f, _i, _table, CHANNELS)
KNOW = types.void(_f, _cube, _table, CHANNELS)
PUSH = types.void(_i, types.Array(_i, 1, "C"), _table, CHANNELS)
FIND = types.void(_f, _table, CHANNELS)
ADVANCE = types.void(CHANNELS)
AT = types.void(_f, CHANNELS, _table)
CARRY = types.void(_numbers, CHANNELS)


@uncounted_loop(FILL)
def fill_channels(m, w, channels):
    """Copy the derivatives that linearising left in the workspace ``w`` to node ``m`` of the channels."""
    modes = channels.modes
    for c in range(channels.many.shape[0]):
        felt = c < channels.many.shape[0] - modes.awake.shape[0]
        for k in range(channels.many[c]):
            at = W.LINKS * c + k
            channels.push[m, c, k] = w[W.Z_PUSH + at] if felt else w[W.S_ALONG + k]
            channels.turn[m, c, k] = w[W.Z_TURN + at] if felt else w[W.S_ANGLES + k]
            channels.speed[m, c, k] = w[W.Z_SPEED + at] if felt else w[W.S_SPEEDS + k]
        if felt:
            channels.fade[m, c] = w[W.Z_FADE + c]
        else:
            modes.hard[m], modes.lossy[m] = w[W.S_HARD], w[W.S_LOSSY]


@uncounted_loop(LOAD_MODES)
def load_modes(m, size, by_number, modes):
    """Fill row ``m`` of ``modes.load`` with derivatives by the parameters; ``by_number`` has ``size`` a scene number.

    Of these (`parameter_loads`) the first is read at each mode's gain, stiffness and damping: the derivative of the
    mode's rate. ``modes.moved`` has the derivatives of gain, stiffness and damping by the parameters.
    """
    many, blocks = modes.number.shape[1], modes.load.shape[2] // LANES
    load, moved = rows(modes.load, LANES), rows(modes.moved, LANES)
    for i in range(many):
        for b in range(blocks):
            sum_ = broadcast_like(0.0, load[0])
            for k in range(3):
                sum_ = sum_ + by_number[size * (modes.first[0] + k * many + i)] * moved[(k * many + i) * blocks + b]
            load[(m * many + i) * blocks + b] = sum_


@inlined_uncounted
def invert(a, out):
    """Fill ``out`` with the inverse of ``a`` (S, S), which is overwritten."""
    n = a.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        pivot = 1.0 / a[best, k]
        for j in range(n):
            a[k, j], a[best, j] = a[best, j], a[k, j]
            out[k, j], out[best, j] = out[best, j], out[k, j]
        for j in range(n):
            a[k, j] *= pivot
            out[k, j] *= pivot
        for i in range(n):
            x = a[i, k]
            if i != k and x != 0.0:
                for j in range(n):
                    a[i, j] -= x * a[k, j]
                    out[i, j] -= x * out[k, j]


@inlined_uncounted
def multiply(a, b, out):
    """Fill ``out`` with the product of ``a`` and ``b`` (S, S)."""
    for i in range(a.shape[0]):
        for j in range(a.shape[0]):
            sum_ = 0.0
            for k in range(a.shape[0]):
                sum_ += a[i, k] * b[k, j]
            out[i, j] = sum_


@inlined_uncounted
def prepare_modes(h, channels):
    """Fill ``start``, ``forced`` and ``force`` of ``channels.modes`` for a step ``h``, s, from the modes' numbers and
    from ``hard`` and ``lossy`` at its nodes, filled before."""
    modes, matrix, inverse, by_force = channels.modes, channels.small[0], channels.small[1], channels.small[2]
    for m in range(STAGES):
        for j in range(STAGES):
            by_force[m, j] = 1.0 if m == j else 0.0
    for i in range(modes.number.shape[1]):
        g, k, c = modes.number[0, i], modes.number[1, i], modes.number[2, i]
        for m in range(STAGES):
            for j in range(STAGES):
                matrix[m, j] = (1.0 if m == j else 0.0) + h * c * ONCE[m, j] + h * h * k * TWICE[m, j]
        invert(matrix, inverse)
        way, rate = modes.forced[i, 0], modes.forced[i, 1]
        multiply(TWICE, inverse, way)
        multiply(ONCE, inverse, rate)
        for m in range(STAGES):
            ways, rates = 0.0, 0.0
            turned, moved = 0.0, 0.0
            for j in range(STAGES):
                way[m, j] *= h * h
                rate[m, j] *= h
                ways -= way[m, j] * k
                rates -= rate[m, j] * k
                turned -= way[m, j] * (c + k * h * NODES[j])
                moved -= rate[m, j] * (c + k * h * NODES[j])
                by_force[m, j] += g * (modes.hard[m + 1] * way[m, j] + modes.lossy[m + 1] * rate[m, j])
            modes.start[i, WAY_BY_WAY, m] = 1.0 + ways
            modes.start[i, RATE_BY_WAY, m] = rates
            modes.start[i, WAY_BY_RATE, m] = h * NODES[m] + turned
            modes.start[i, RATE_BY_RATE, m] = 1.0 + moved
    invert(by_force, modes.force)


@uncounted_loop(ANSWERS)
def prepare_channels(h, channels):
    """Fill ``operator`` and ``free`` (and the string's modes) of ``channels``, the felts and the string that have
    memory, for a step ``h``, s, from ``fade`` at its nodes, filled before."""
    modes, matrix, inverse = channels.modes, channels.small[0], channels.small[1]
    felts = channels.many.shape[0] - modes.awake.shape[0]
    for c in range(felts):
        for m in range(STAGES):
            for j in range(STAGES):
                matrix[m, j] = (1.0 if m == j else 0.0) - h * ONCE[m, j] * channels.fade[j + 1, c]
        invert(matrix, inverse)
        multiply(inverse, ONCE, channels.operator[c])
        for m in range(STAGES):
            sum_ = 0.0
            for j in range(STAGES):
                channels.operator[c, m, j] *= h
                sum_ += inverse[m, j]
            channels.free[c, m] = sum_
    if felts < channels.many.shape[0] and modes.awake[0] == 1:
        prepare_modes(h, channels)
        for m in range(STAGES):
            for j in range(STAGES):
                channels.operator[felts, m, j] = modes.force[m, j] - (1.0 if m == j else 0.0)


@uncounted_loop(COUPLE)
def add_channel_coupling(h, n, a, channels):
    """Subtract from the system matrix ``a`` (S n, S n) of a step ``h`` what joints do to each other through felt
    memories and the string: push times `operator` (filled before) times turn and speed; the string only while it
    sounds."""
    answer = channels.small[0]
    for c in range(channels.many.shape[0]):
        if c == channels.many.shape[0] - channels.modes.awake.shape[0] and channels.modes.awake[0] == 0:
            continue
        for kj in range(channels.many[c]):
            j = channels.links[c, kj]
            if j < 0:
                continue
            for m in range(STAGES):
                for of in range(STAGES):
                    sum_ = 0.0
                    for k in range(STAGES):
                        turned = channels.turn[k + 1, c, kj] * h * h * TWICE[k, of]
                        moved = channels.speed[k + 1, c, kj] * h * ONCE[k, of]
                        sum_ += channels.operator[c, m, k] * (turned + moved)
                    answer[m, of] = sum_
            for ki in range(channels.many[c]):
                i = channels.links[c, ki]
                if i < 0:
                    continue
                for m in range(STAGES):
                    push = channels.push[m + 1, c, ki]
                    if push != 0.0:
                        for of in range(STAGES):
                            a[n * m + i, n * of + j] -= push * answer[m, of]


@uncounted_loop(KNOW)
def predict_free_channels(h, tangent, carried, channels):
    """Fill ``known`` and ``entered`` of ``channels`` for a step ``h``, s, as if joints went on from ``tangent`` (2, n,
    P) unaccelerated; ``carried`` (k, P): derivatives of the prescribed coordinates."""
    n, blocks = tangent.shape[1], tangent.shape[2] // LANES
    modes, count = channels.modes, channels.many.shape[0]
    felts = count - modes.awake.shape[0]
    sigma, given, load = rows(tangent, LANES), rows(carried, LANES), rows(channels.load, LANES)
    known, entered, inner = rows(channels.known, LANES), rows(channels.entered, LANES), rows(channels.inner, LANES)
    sums, of_modes, mode_load = rows(modes.sums, LANES), rows(modes.tangent, LANES), rows(modes.load, LANES)
    many = modes.number.shape[1]
    for c in range(count):
        if c == felts and modes.awake[0] == 0:
            continue
        for b in range(blocks):
            for m in range(STAGES):
                sum_ = load[((m + 1) * count + c) * blocks + b]
                for k in range(channels.many[c]):
                    j, turn, speed = channels.links[c, k], channels.turn[m + 1, c, k], channels.speed[m + 1, c, k]
                    if turn == 0.0 and speed == 0.0:
                        continue
                    if j < 0:
                        sum_ = sum_ + turn * given[(-1 - j) * blocks + b]
                    else:
                        at = j * blocks + b
                        sum_ = sum_ + turn * sigma[at] + (turn * h * NODES[m] + speed) * sigma[n * blocks + at]
                entered[(m * count + c) * blocks + b] = sum_
            if c < felts:
                for m in range(STAGES):
                    sum_ = channels.free[c, m] * inner[c * blocks + b]
                    for k in range(STAGES):
                        sum_ = sum_ + channels.operator[c, m, k] * entered[(k * count + c) * blocks + b]
                    known[(m * count + c) * blocks + b] = sum_
                continue
            for m in range(STAGES):
                way = broadcast_like(0.0, entered[0])
                rate = broadcast_like(0.0, entered[0])
                for i in range(many):
                    y, u = of_modes[i * blocks + b], of_modes[(many + i) * blocks + b]
                    way = way + modes.start[i, WAY_BY_WAY, m] * y + modes.start[i, WAY_BY_RATE, m] * u
                    rate = rate + modes.start[i, RATE_BY_WAY, m] * y + modes.start[i, RATE_BY_RATE, m] * u
                    if modes.loaded[0] == 1:
                        for k in range(STAGES):
                            x = mode_load[((k + 1) * many + i) * blocks + b]
                            way = way + modes.forced[i, 0, m, k] * x
                            rate = rate + modes.forced[i, 1, m, k] * x
                sums[m * blocks + b] = way
                sums[(STAGES + m) * blocks + b] = rate
            for m in range(STAGES):
                sum_ = broadcast_like(0.0, entered[0])
                for k in range(STAGES):
                    given_way = modes.hard[k + 1] * sums[k * blocks + b]
                    given_way = given_way + modes.lossy[k + 1] * sums[(STAGES + k) * blocks + b]
                    sum_ = sum_ + channels.operator[c, m, k] * entered[(k * count + c) * blocks + b]
                    sum_ = sum_ - modes.force[m, k] * given_way
                known[(m * count + c) * blocks + b] = sum_


@uncounted_loop(PUSH)
def add_known_forces(n, row_of, rhs, channels):
    """Add the forces of the ``known`` channels to the right-hand side ``rhs`` (S n, P), in its order ``row_of``."""
    blocks, count = rhs.shape[1] // LANES, channels.many.shape[0]
    known, to = rows(channels.known, LANES), rows(rhs, LANES)
    for c in range(count):
        if c == count - channels.modes.awake.shape[0] and channels.modes.awake[0] == 0:
            continue
        for m in range(STAGES):
            for k in range(channels.many[c]):
                push, i = channels.push[m + 1, c, k], channels.links[c, k]
                if push != 0.0 and i >= 0:
                    row = row_of[n * m + i] * blocks
                    for b in range(blocks):
                        to[row + b] = to[row + b] + push * known[(m * count + c) * blocks + b]


@uncounted_loop(FIND)
def solve_channels(h, slopes, channels):
    """Fill ``value`` and complete ``entered`` of ``channels`` for a step ``h``, s, by ``slopes`` (S n, P), the
    accelerations' derivatives by the parameters at the nodes."""
    n, blocks, count = slopes.shape[0] // STAGES, slopes.shape[1] // LANES, channels.many.shape[0]
    felts = count - channels.modes.awake.shape[0]
    nu = rows(slopes, LANES)
    known, value, entered = rows(channels.known, LANES), rows(channels.value, LANES), rows(channels.entered, LANES)
    for c in range(count):
        if c == felts and channels.modes.awake[0] == 0:
            channels.value[:, c, :] = 0.0
            continue
        for b in range(blocks):
            for m in range(STAGES):
                value[(m * count + c) * blocks + b] = known[(m * count + c) * blocks + b]
            for k in range(STAGES):
                sum_ = broadcast_like(0.0, nu[0])
                for link in range(channels.many[c]):
                    j, turn, speed = (
                        channels.links[c, link],
                        channels.turn[k + 1, c, link],
                        channels.speed[k + 1, c, link],
                    )
                    if j < 0 or (turn == 0.0 and speed == 0.0):
                        continue
                    for of in range(STAGES):
                        weight = turn * h * h * TWICE[k, of] + speed * h * ONCE[k, of]
                        sum_ = sum_ + weight * nu[(n * of + j) * blocks + b]
                at = (k * count + c) * blocks + b
                entered[at] = entered[at] + sum_
                for m in range(STAGES):
                    to = (m * count + c) * blocks + b
                    value[to] = value[to] + channels.operator[c, m, k] * sum_


@uncounted_loop(ADVANCE)
def advance_channels(channels):
    """Replace the start values of felt and modes in ``channels`` by those at the end of the solved step."""
    modes, count = channels.modes, channels.many.shape[0]
    felts, blocks = count - modes.awake.shape[0], channels.inner.shape[1] // LANES
    value, inner, entered = rows(channels.value, LANES), rows(channels.inner, LANES), rows(channels.entered, LANES)
    last = STAGES - 1
    for c in range(felts):
        for b in range(blocks):
            inner[c * blocks + b] = value[(last * count + c) * blocks + b]
    if felts == count or modes.awake[0] == 0:
        return
    many, tangent, load = modes.number.shape[1], rows(modes.tangent, LANES), rows(modes.load, LANES)
    for i in range(many):
        for b in range(blocks):
            y, u = tangent[i * blocks + b], tangent[(many + i) * blocks + b]
            way = modes.start[i, WAY_BY_WAY, last] * y + modes.start[i, WAY_BY_RATE, last] * u
            rate = modes.start[i, RATE_BY_WAY, last] * y + modes.start[i, RATE_BY_RATE, last] * u
            for k in range(STAGES):
                at = (k * count + felts) * blocks + b
                x = modes.number[0, i] * (value[at] + entered[at])
                if modes.loaded[0] == 1:
                    x = x + load[((k + 1) * many + i) * blocks + b]
                way = way + modes.forced[i, 0, last, k] * x
                rate = rate + modes.forced[i, 1, last, k] * x
            tangent[i * blocks + b] = way
            tangent[(many + i) * blocks + b] = rate


@inlined_uncounted
def channel_start(c, b, channels):
    """Derivatives of internal variable (channel) ``c`` by the parameters of block ``b``, at the start of a step."""
    modes, blocks = channels.modes, channels.inner.shape[1] // LANES
    out = broadcast_like(0.0, rows(channels.inner, LANES)[0])
    if c < channels.many.shape[0] - modes.awake.shape[0]:
        out = out + rows(channels.inner, LANES)[c * blocks + b]
    elif modes.awake[0] == 1:
        many, tangent = modes.number.shape[1], rows(modes.tangent, LANES)
        for i in range(many):
            out = out - modes.hard[0] * tangent[i * blocks + b] - modes.lossy[0] * tangent[(many + i) * blocks + b]
    return out


@uncounted_loop(AT)
def interpolate_channels(x, channels, out):
    """Fill ``out`` (C, P) with the channels' derivatives at the fraction ``x`` of the solved step, by its
    polynomial."""
    count, blocks = channels.many.shape[0], channels.inner.shape[1] // LANES
    value, to = rows(channels.value, LANES), rows(out, LANES)
    for c in range(count):
        for b in range(blocks):
            weight = 1.0
            for m in range(STAGES):
                weight *= (x - NODES[m]) / -NODES[m]
            sum_ = weight * channel_start(c, b, channels)
            for m in range(STAGES):
                weight = x / NODES[m]
                for k in range(STAGES):
                    if k != m:
                        weight *= (x - NODES[k]) / (NODES[m] - NODES[k])
                sum_ = sum_ + weight * value[(m * count + c) * blocks + b]
            to[c * blocks + b] = sum_


@uncounted_loop(CARRY)
def propagate_free_modes(carried, channels):
    """Advance ``channels.modes.tangent`` of a free string by its transition coefficients ``carried``, (10 K,)."""
    modes = channels.modes
    many, blocks = modes.number.shape[1], channels.inner.shape[1] // LANES
    tangent, moved = rows(modes.tangent, LANES), rows(modes.moved, LANES)
    for i in range(many):
        for b in range(blocks):
            y, u = tangent[i * blocks + b], tangent[(many + i) * blocks + b]
            k, c = moved[(many + i) * blocks + b], moved[(2 * many + i) * blocks + b]
            for half in range(2):
                at = 10 * i + 2 + 4 * half  # as `propagate_modes` lays them out
                x = carried[at] * y + carried[at + 1] * u + carried[at + 2] * k + carried[at + 3] * c
                tangent[(half * many + i) * blocks + b] = x
