"""Contact forces, penetrations and losses along a trajectory, computed only when a run asks for them."""

from typing import NamedTuple

import numpy as np

from model.kernels.compile import kernel
from model.kernels.laws import felt, friction
from model.kernels.layout import (
    A_R,
    BODY_SIZE,
    DAMPER_SIZE,
    GLOBALS,
    GUIDED,
    JF_A,
    JF_B1,
    JF_B2,
    K_A,
    K_B,
    K_C,
    OMEGA_T,
    POSE_SIZE,
    PROBE_SIZE,
    V_T,
)
from model.kernels.trajectory.dynamics import Equations, acceleration, contact_state, probe_state
from model.kernels.trajectory.kinematics import contact_offset, gap_geometry, place

# columns of what `observe_along` gives per contact
SEEN_NORMAL, SEEN_FRICTION, SEEN_DEPTH, SEEN_SLIDE, SEEN_RUBBED, SEEN_FELT = range(6)
SEEN_NX, SEEN_NY, SEEN_X, SEEN_Y = range(6, 10)
SEEN_SIZE = 10


class Observed(NamedTuple):
    """What `observe_along` fills."""

    contact: np.ndarray  # (m, c, SEEN_SIZE)
    pose: np.ndarray  # (m, n, POSE_SIZE)
    acceleration: np.ndarray  # (m, n) of the coordinates, rad/s^2
    joint_loss: np.ndarray  # (m, n) power lost in the joints, W
    tip: np.ndarray  # (m, b, 2) force of each one-sided probe, N, and power lost in it, W


@kernel
def forces_along(q, v, p, tables, normal, tangential):
    """Fill ``normal`` and ``tangential`` (m, c) in N from states (m, n)."""
    pose = np.zeros((q.shape[1], POSE_SIZE))
    for k in range(q.shape[0]):
        place(q[k], v[k], p, tables.parent, pose)
        for c in range(tables.contact.shape[0]):
            fn, ft, _, _, _ = contact_state(c, v[k], p, tables, pose)
            normal[k, c] = fn
            tangential[k, c] = ft


@kernel
def probe_forces_along(q, v, p, tables, force):
    """Fill ``force`` (m, b) in N with what each one-sided probe presses with; states (m, n)."""
    pose = np.zeros((q.shape[1], POSE_SIZE))
    for k in range(q.shape[0]):
        place(q[k], v[k], p, tables.parent, pose)
        o = tables.offset[3]
        for b in range(tables.probe.shape[0]):
            x, rate, _, _ = probe_state(v[k], p, o, tables.probe[b, 0], tables.probe[b, 1], pose, tables.parent)
            fn, _, _ = felt(x, rate, p[o + 4], p[o + 5], p[o + 6], p[o + 7])
            force[k, b] = fn
            o += PROBE_SIZE


@kernel
def penetrations(q, v, p, tables, penetration):
    """Fill ``penetration`` (c,) in m, negative where open, at one state."""
    pose = np.zeros((q.shape[0], POSE_SIZE))
    place(q, v, p, tables.parent, pose)
    for c in range(tables.contact.shape[0]):
        _, _, x, _, _ = contact_state(c, v, p, tables, pose)
        penetration[c] = x


@kernel
def depths_along(q, v, p, tables, contact, depth, rate):
    """Fill ``depth`` (m,) in m, negative where open, and its ``rate`` (m,) in m/s of one contact; states (m, n)."""
    pose = np.zeros((q.shape[1], POSE_SIZE))
    for k in range(q.shape[0]):
        place(q[k], v[k], p, tables.parent, pose)
        _, _, depth[k], rate[k], _ = contact_state(contact, v[k], p, tables, pose)


@kernel
def observe_along(q, v, u, p, tables, observed):
    """Fill ``observed`` with all that acts inside the action, at states (m, n) under inputs (m,).

    Per contact: normal and friction force, N; penetration, m, negative where open; sliding speed of A over B along
    t = z x n, m/s, 0 where open; power lost by rubbing and in the felt, W; normal and point of action in the world.
    """
    seen, pose, turning, braked, tips = observed
    n = q.shape[1]
    m_diag = np.zeros(n)
    m_up = np.zeros(n)
    f = np.zeros(n)
    for k in range(q.shape[0]):
        acceleration(q[k], v[k], u[k], p, tables, Equations(pose[k], m_diag, m_up, f, turning[k]))
        for i in range(n):
            o = GLOBALS + BODY_SIZE * i
            threshold = p[V_T] if tables.parent[i] == GUIDED else p[OMEGA_T]
            torque, _ = friction(v[k, i], 1.0 / threshold, p[o + JF_A], p[o + JF_B1], p[o + JF_B2])
            braked[k, i] = torque * v[k, i]
        for d in range(tables.damper.shape[0]):
            i = tables.damper[d]
            braked[k, i] += p[tables.offset[5] + DAMPER_SIZE * d] * v[k, i] * v[k, i]
        for c in range(tables.contact.shape[0]):
            o = contact_offset(tables.offset[1], c)
            fn, ft, x, rate, slide = contact_state(c, v[k], p, tables, pose[k])
            _, nx, ny, ax, ay, _, _, _ = gap_geometry(
                pose[k], p, o, tables.contact[c, 0], tables.contact[c, 1], tables.contact[c, 2]
            )
            static, _, _ = felt(x, 0.0, p[o + K_A], p[o + K_B], p[o + K_C], 0.0)
            r = p[o + A_R] - 0.5 * max(x, 0.0)
            seen[k, c, SEEN_NORMAL] = fn
            seen[k, c, SEEN_FRICTION] = ft
            seen[k, c, SEEN_DEPTH] = x
            seen[k, c, SEEN_SLIDE] = slide if x > 0.0 else 0.0
            seen[k, c, SEEN_RUBBED] = -ft * slide
            seen[k, c, SEEN_FELT] = (fn - static) * rate
            seen[k, c, SEEN_NX] = nx
            seen[k, c, SEEN_NY] = ny
            seen[k, c, SEEN_X] = ax - r * nx
            seen[k, c, SEEN_Y] = ay - r * ny
        o = tables.offset[3]
        for b in range(tables.probe.shape[0]):
            x, rate, _, _ = probe_state(v[k], p, o, tables.probe[b, 0], tables.probe[b, 1], pose[k], tables.parent)
            fn, _, _ = felt(x, rate, p[o + 4], p[o + 5], p[o + 6], p[o + 7])
            static, _, _ = felt(x, 0.0, p[o + 4], p[o + 5], p[o + 6], 0.0)
            tips[k, b, 0] = fn
            tips[k, b, 1] = (fn - static) * rate
            o += PROBE_SIZE
