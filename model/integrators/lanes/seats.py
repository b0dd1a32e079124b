"""A member takes a lane, rests in it, leaves it: the numbers of one lane among those of the others."""

from model.integrators.lanes import slots as S
from model.integrators.step_control import DONE
from model.kernels.compile import uncounted
from model.kernels.lanes.operations import put
from model.kernels.workspace import ACC, IDLE, LANE_SIZE, M_DIAG, M_UP, STIFF, WIDTH, WITH_MEMORY, Q, V, Z


@uncounted
def fill_still(lane, width, n, until, memory, whole, members):
    """Fill the outputs wanted up to ``until`` with the state of a lane as it is."""
    n_z, wanted = members.memory.shape[1], members.wanted
    at = whole[S.N_WHOLE * lane : S.N_WHOLE * lane + S.N_WHOLE]
    k = at[S.ROWS_DONE]
    while k < at[S.N_OUT] and wanted[at[S.FIRST_OUT] + k] <= until:
        for i in range(n):
            put(at[S.ANGLES_AT], n * k + i, memory[(Q + i) * width + lane])
            put(at[S.SPEEDS_AT], n * k + i, memory[(V + i) * width + lane])
        for i in range(n_z):
            put(at[S.MEMORIES_AT], n_z * k + i, memory[(Z + i) * width + lane])
        k += 1
    at[S.ROWS_DONE] = k


@uncounted
def sit_down(lane, width, m, members, space):
    """Put member ``m`` into a lane."""
    memory, numbers, number, whole, _, _ = space
    n = members.angle.shape[1]
    n_z = members.memory.shape[1]
    for k in range(LANE_SIZE if n_z == 0 else WITH_MEMORY):
        memory[k * width + lane] = 0.0
    for i in range(n_z):
        memory[(Z + i) * width + lane] = members.memory[m, i]
    for i in range(n):
        memory[(Q + i) * width + lane] = members.angle[m, i]
        memory[(V + i) * width + lane] = members.speed[m, i]
    for k in range(members.parameters.shape[1]):
        numbers[k * width + lane] = members.parameters[m, k]
    slots = (S.TIME, S.END, S.WANTED_STEP, S.ANGLE, S.SPEED, S.REST, S.LONGEST)
    for k in range(7):
        number[slots[k] * width + lane] = members.start[m, k]
    number[S.AT_REST * width + lane] = 0.0
    at = whole[S.N_WHOLE * lane : S.N_WHOLE * lane + S.N_WHOLE]
    at[S.MEMBER] = m
    at[S.TRIED] = 0
    at[S.FIRST] = at[S.POINT] = members.place[m, 0]
    at[S.LAST] = members.place[m, 0] + members.place[m, 1] - 1
    at[S.FIRST_OUT] = members.place[m, 2]
    at[S.N_OUT] = members.place[m, 3]
    at[S.MOST] = members.place[m, 4]
    at[S.ANGLES_AT] = members.place[m, 5]
    at[S.SPEEDS_AT] = members.place[m, 6]
    at[S.MEMORIES_AT] = members.place[m, 7]
    at[S.ROWS_DONE] = 0
    fill_still(lane, width, n, members.start[m, 0], memory, whole, members)


@uncounted
def leave(lane, width, memory, number):
    """Leave a lane without a member: its numbers are computed with the others, and used by nobody."""
    memory[IDLE * width + lane] = 1.0
    for k in range(S.N_NUMBERS):
        number[k * width + lane] = 1.0
    number[S.TIME * width + lane] = 0.0


@uncounted
def get_up(lane, width, status, members, space):
    """Take the member out of a lane and leave the lane idle."""
    memory, _, number, whole, _, _ = space
    m = whole[S.N_WHOLE * lane + S.MEMBER]
    for i in range(members.angle.shape[1]):
        members.angle[m, i] = memory[(Q + i) * width + lane]
        members.speed[m, i] = memory[(V + i) * width + lane]
    for i in range(members.memory.shape[1]):
        members.memory[m, i] = memory[(Z + i) * width + lane]
    members.reached[m, 0] = number[S.TIME * width + lane]
    members.reached[m, 1] = number[S.WANTED_STEP * width + lane]
    members.reached[m, 2] = number[S.AT_REST * width + lane]
    members.status[m] = status
    leave(lane, width, memory, number)


@uncounted
def fill_lanes(busy, following, width, members, space):
    """Give each lane that is not ``busy`` the next member with something to do; which lanes are, who is next."""
    for lane in range(width):
        while not busy >> lane & 1 and following < members.angle.shape[0]:
            sit_down(lane, width, following, members, space)
            following += 1
            if space.number[S.TIME * width + lane] < space.number[S.END * width + lane]:
                busy |= 1 << lane
            else:
                get_up(lane, width, DONE, members, space)
        if not busy >> lane & 1:
            leave(lane, width, space.step, space.number)
    return busy, following


@uncounted
def copy_lane(lane, width, n, memory, single):
    """Copy what decides about rest from a lane into the workspace of one run."""
    for i in range(n):
        for start in (V, ACC, M_DIAG, M_UP):
            single[start + i] = memory[(start + i) * width + lane]
        for j in range(n):
            k = STIFF + WIDTH * i + j
            single[k] = memory[k * width + lane]
