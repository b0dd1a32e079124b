"""What holds a prescribed body to its motion: the force at its drive point and the reaction of its pivot.

Computed at output times from states and the prescribed acceleration, by the body's own equation of motion: no
difference of anything. One prescribed body, which hangs from ground, carries no other and is the last coordinate.
"""

import numpy as np

from model.kernels.compile import kernel
from model.kernels.layout import (
    BODY_SIZE,
    DRIVE_X,
    DRIVE_Y,
    GLOBALS,
    GRAVITY,
    MASS,
    POSE_CX,
    POSE_CY,
    POSE_OMEGA,
    POSE_SIZE,
    POSE_X,
    POSE_Y,
)
from model.kernels.trajectory.dynamics import contact_forces, contact_state, inertia_and_joint_forces, mass_matrix
from model.kernels.trajectory.kinematics import contact_offset, gap_geometry, place, point


@kernel
def load_along(q, v, a, p, tables, force, rail):
    """Fill ``force`` (m,) N, downwards at the drive point, and ``rail`` (m,) N, upwards from the pivot on the body.

    States (m, n), accelerations ``a`` (m,) of the last coordinate.
    """
    n = q.shape[1]
    key = n - 1
    pose = np.zeros((n, POSE_SIZE))
    m_diag, m_up, f = np.zeros(n), np.zeros(n), np.zeros(n)
    m = p[GLOBALS + BODY_SIZE * key + MASS]
    at = tables.offset[2]
    for i in range(q.shape[0]):
        place(q[i], v[i], p, tables.parent, pose)
        mass_matrix(pose, p, tables.parent, m_diag, m_up)
        inertia_and_joint_forces(q[i], v[i], 0.0, p, tables, pose, f)
        contact_forces(v[i], p, tables, pose, f)
        x, _ = point(pose, key, p[at + DRIVE_X], p[at + DRIVE_Y])
        force[i] = (f[key] - m_diag[key] * a[i]) / (x - pose[key, POSE_X])
        rx = pose[key, POSE_CX] - pose[key, POSE_X]
        ry = pose[key, POSE_CY] - pose[key, POSE_Y]
        omega = pose[key, POSE_OMEGA]
        up = m * (p[GRAVITY] + a[i] * rx - omega * omega * ry) + force[i]
        for c in range(tables.contact.shape[0]):
            first, second = tables.contact[c, 0], tables.contact[c, 1]
            if first == key or second == key:
                fn, ft, _, _, _ = contact_state(c, v[i], p, tables, pose)
                _, nx, ny, _, _, _, _, _ = gap_geometry(
                    pose, p, contact_offset(tables.offset[1], c), first, second, tables.contact[c, 2]
                )
                fy = fn * ny + ft * nx
                up -= fy if first == key else -fy
        rail[i] = up
