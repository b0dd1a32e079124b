"""How the force of a probe, the vertical contact of the motor arm's tip with the key, changes with its numbers."""

from model.kernels import layout as L
from model.kernels.compile import inlined_uncounted
from model.kernels.laws import felt
from model.kernels.trajectory.kinematics import direction
from model.kernels.workspace import V


@inlined_uncounted
def change_probe(k, number, rise, w, p, tables, space):
    """Add what a unit of a number of probe ``k`` does, or with ``number`` -1 what raising B by ``rise`` does."""
    pose, push, parent = space.pose, space.push, tables.parent
    a, b = tables.probe[k, 0], tables.probe[k, 1]
    o = tables.offset[3] + L.PROBE_SIZE * k
    la, ha = direction(pose, a, p[o], p[o + 1])
    lb, hb = direction(pose, b, p[o + 2], p[o + 3])
    guide = parent[b] if parent[b] >= 0 and parent[parent[b]] == L.GUIDED else -1
    depth = pose[b, L.POSE_Y] + hb - pose[a, L.POSE_Y] - ha
    rate = lb * w[V + b] - la * w[V + a]
    if guide >= 0:
        rate += w[V + guide]
    force, by_depth, by_rate = felt(depth, rate, p[o + 4], p[o + 5], p[o + 6], p[o + 7])
    if not force > 0.0:
        return
    change = by_depth * rise
    if number >= 4:
        factor = 1.0 + p[o + 7] * rate
        fit = ((p[o + 4] * depth + p[o + 5]) * depth + p[o + 6]) * depth
        powers = (depth * depth * depth * factor, depth * depth * factor, depth * factor, fit * rate)
        change = powers[number - 4]
    elif number >= 0:
        x, y = (1.0, 0.0) if number % 2 == 0 else (0.0, 1.0)
        if number < 2:
            arm, height = direction(pose, a, x, y)
            change = -by_depth * height - by_rate * arm * w[V + a]
            push[a] += force * arm
        else:
            arm, height = direction(pose, b, x, y)
            change = by_depth * height + by_rate * arm * w[V + b]
            push[b] -= force * arm
    push[a] += change * la
    push[b] -= change * lb
    if guide >= 0:
        push[guide] -= change
