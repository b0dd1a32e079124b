"""The state inside a step, at the times at which each lane's member wants it."""

from model.integrators.lanes import slots as S
from model.kernels.compile import inlined, uncounted
from model.kernels.lanes.operations import put
from model.kernels.workspace import AUDIT_Z, MOST_MEMORIES, Q1, V1, WIDTH, Z1, Z_U, Q, U, V, Z

STAGE = 2 * WIDTH


@uncounted
def dense_sums(w, s, n, dense):
    """Sums over the stages that the state inside a step is made of, as rows of ``s``."""
    for m in range(dense.shape[0]):
        for half in range(2):
            for i in range(n):
                x = dense[m, 0] * w[U + WIDTH * half + i]
                for j in range(1, dense.shape[1]):
                    x += dense[m, j] * w[U + STAGE * j + WIDTH * half + i]
                s[S.DENSE + STAGE * m + WIDTH * half + i] = x


@uncounted
def state_inside(w, s, n, n_dense):
    """State at the fraction of the step that each lane asks for, as rows of ``s``."""
    x = s[S.FRACTION]
    y = 1.0 - x
    for half in range(2):
        start, end = (Q, Q1) if half == 0 else (V, V1)
        for i in range(n):
            at = S.DENSE + WIDTH * half + i
            d = s[at + STAGE * (n_dense - 1)]
            for m in range(n_dense - 2, -1, -1):
                d = s[at + STAGE * m] + x * d
            s[S.ROW + WIDTH * half + i] = y * w[start + i] + x * (w[end + i] + y * d)


@uncounted
def memories_inside(w, s, n_z, dense):
    """What is remembered at the same fraction of the step, where energies would be asked for."""
    x = s[S.FRACTION]
    for i in range(n_z):
        inside = 0.0 * x
        for m in range(dense.shape[0] - 1, -1, -1):
            part = 0.0 * x
            for j in range(dense.shape[1]):
                part += dense[m, j] * w[Z_U + MOST_MEMORIES * j + i]
            inside = part + x * inside
        w[AUDIT_Z + i] = (1.0 - x) * w[Z + i] + x * (w[Z1 + i] + (1.0 - x) * inside)


@uncounted
def write_rows(bits, width, n, n_z, memory, number, whole):
    """Write the row of each lane of ``bits`` to its member and go on to the next one."""
    for lane in range(width):
        if bits >> lane & 1:
            at = S.N_WHOLE * lane
            k = n * whole[at + S.ROWS_DONE]
            for i in range(n):
                put(whole[at + S.ANGLES_AT], k + i, number[(S.ROW + i) * width + lane])
                put(whole[at + S.SPEEDS_AT], k + i, number[(S.ROW + WIDTH + i) * width + lane])
            for i in range(n_z):
                put(whole[at + S.MEMORIES_AT], n_z * whole[at + S.ROWS_DONE] + i, memory[(AUDIT_Z + i) * width + lane])
            whole[at + S.ROWS_DONE] += 1


@uncounted
def ask(bits, width, members, space):
    """Of the lanes of ``bits`` those with another output within their steps; sets its fraction of the step."""
    number, whole, wanted = space.number, space.whole, members.wanted
    asking = 0
    for lane in range(width):
        if bits >> lane & 1:
            t, step = number[S.TIME * width + lane], number[S.STEP * width + lane]
            end = number[S.END * width + lane]
            until = end if step == end - t else t + step
            at = S.N_WHOLE * lane
            k = whole[at + S.ROWS_DONE]
            if k < whole[at + S.N_OUT]:
                when = wanted[whole[at + S.FIRST_OUT] + k]
                if when <= until:
                    number[S.FRACTION * width + lane] = (when - t) / step
                    asking |= 1 << lane
    return asking


@inlined
def give_out(bits, w, s, width, dense, members, space):
    """Fill the outputs within the steps of the lanes of ``bits``."""
    n, n_z = members.angle.shape[1], members.memory.shape[1]
    asking = ask(bits, width, members, space)
    if asking:
        dense_sums(w, s, n, dense)
    while asking:
        state_inside(w, s, n, dense.shape[0])
        if n_z > 0:
            memories_inside(w, s, n_z, dense)
        write_rows(asking, width, n, n_z, space.step, space.number, space.whole)
        asking = ask(asking, width, members, space)
