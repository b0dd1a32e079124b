"""Contact forces along a trajectory, computed only when a run asks for them."""

import numpy as np

from .compile import kernel
from .dynamics import contact_state, probe_state
from .kinematics import place
from .laws import felt
from .layout import POSE_SIZE, PROBE_SIZE


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
            x, rate, _, _ = probe_state(v[k], p, o, tables.probe[b, 0], tables.probe[b, 1], pose)
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
