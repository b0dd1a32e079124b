"""Contact forces, accelerations and joint forces at single states of a scene.

Forces and accelerations are functions of the state alone, from the same kernels as the motion. World frame: x right,
y up. `model.inside.observe_motion` evaluates them along a motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.kernels import layout as L
from model.kernels.trajectory import contact_forces as O
from model.scene.build import Scene

Array = NDArray[np.float64]


class Observer:
    """Evaluates states of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        t, p = scene.tables, scene.vector
        self.parent = [int(w) for w in t.parent]
        self.outwards = sorted(range(scene.size), key=lambda i: self.parent[i] >= 0)  # bodies on the ground first
        blocks = p[L.GLOBALS : L.GLOBALS + L.BODY_SIZE * scene.size].reshape(scene.size, L.BODY_SIZE)
        self.mass = blocks[:, L.MASS]
        self.pressed = [int(body) for kind, body in t.drive if kind == L.FORCE_DOWN]

    def evaluate(self, q: ArrayLike, v: ArrayLike, u: ArrayLike) -> ObservedStates:
        """Everything at states (m, n) under inputs (m,)."""
        angle, speed = as_numbers(q, "states: angles", 2), as_numbers(v, "states: speeds", 2)
        value, n = as_numbers(u, "states: input", 1), len(self.parent)
        if angle.shape != speed.shape or angle.shape != (len(value), n):
            raise InputError(
                f"states: found {angle.shape} angles, {speed.shape} speeds and {value.shape} inputs, "
                f"allowed (m, {n}) twice and (m,)"
            )
        return ObservedStates(self, angle, speed, value)


class ObservedStates:
    """Contacts, motion of the bodies and, on demand, forces of the joints at states (m, n) under inputs (m,).

    Attributes
    ----------
    contact : (m, c, SEEN_SIZE) per contact, columns as in `model.kernels.trajectory.contact_forces`
    pose : (m, n, POSE_SIZE) of the bodies
    turning : (m, n) angular acceleration from ground, rad/s^2
    velocity, acceleration : (m, n, 2) of the centres of mass
    joint_loss_w : (m, n) power lost in the joints
    tip : (m, b, 2) force of each one-sided probe, N, and power lost in it, W
    """

    def __init__(self, observer: Observer, q: Array, v: Array, u: Array) -> None:
        scene, m, n = observer.scene, len(q), observer.scene.size
        self.observer, self.input = observer, u
        self.contact, self.pose = np.zeros((m, len(scene.contacts), O.SEEN_SIZE)), np.zeros((m, n, L.POSE_SIZE))
        self.joint_loss_w, self.tip = np.zeros((m, n)), np.zeros((m, len(scene.tables.probe), 2))
        rate = np.zeros((m, n))  # of the coordinates' speeds
        observed = O.Observed(self.contact, self.pose, rate, self.joint_loss_w, self.tip)
        O.observe_along(q, v, u, scene.vector, scene.tables, observed)
        self.turning = np.zeros((m, n))
        self.velocity, self.acceleration = np.zeros((m, n, 2)), np.zeros((m, n, 2))
        pivot_v, pivot_a = np.zeros((m, n, 2)), np.zeros((m, n, 2))
        pivot, center = self.pose[:, :, [L.POSE_X, L.POSE_Y]], self.pose[:, :, [L.POSE_CX, L.POSE_CY]]
        omega = self.pose[:, :, L.POSE_OMEGA]
        for i in observer.outwards:
            w = observer.parent[i]
            if w == L.GUIDED:  # does not turn; its coordinate is the height of its pivot
                pivot_v[:, i, 1], pivot_a[:, i, 1] = v[:, i], rate[:, i]
                self.velocity[:, i], self.acceleration[:, i] = pivot_v[:, i], pivot_a[:, i]
                continue
            self.turning[:, i] = rate[:, i]
            if w >= 0:
                self.turning[:, i] += self.turning[:, w]
                arm = pivot[:, i] - pivot[:, w]
                pivot_v[:, i] = pivot_v[:, w] + omega[:, w, None] * _perpendicular(arm)
                pivot_a[:, i] = pivot_a[:, w] + _relative_acceleration(arm, omega[:, w], self.turning[:, w])
            arm = center[:, i] - pivot[:, i]
            self.velocity[:, i] = pivot_v[:, i] + omega[:, i, None] * _perpendicular(arm)
            self.acceleration[:, i] = pivot_a[:, i] + _relative_acceleration(arm, omega[:, i], self.turning[:, i])

    def poses(self) -> Array:
        """Pivot x, y (m) and orientation from ground (rad) of each body, (m, n, 3)."""
        found: Array = self.pose[:, :, [L.POSE_X, L.POSE_Y, L.POSE_PHI]]
        return found

    def joint_forces(self) -> Array:
        """Force (m, n, 2) on each body in the joint that carries it, by Newton's law from the outer bodies inwards.

        Friction, springs and damping of a joint are torques and do not enter.
        """
        observer, tables, contact = self.observer, self.observer.scene.tables, self.contact
        force = observer.mass[:, None] * self.acceleration
        force[:, :, 1] += observer.mass * observer.scene.vector[L.GRAVITY]
        normal, press = contact[:, :, O.SEEN_NX : O.SEEN_NY + 1], contact[:, :, O.SEEN_NORMAL, None]
        push = press * normal + contact[:, :, O.SEEN_FRICTION, None] * _perpendicular(normal)
        for c, (first, second, *_) in enumerate(tables.contact):
            if first >= 0:
                force[:, first] -= push[:, c]
            if second >= 0:
                force[:, second] += push[:, c]
        for b, (upper, lower) in enumerate(tables.probe):
            force[:, upper, 1] -= self.tip[:, b, 0]
            force[:, lower, 1] += self.tip[:, b, 0]
        for body in observer.pressed:
            force[:, body, 1] += self.input
        for i in reversed(observer.outwards):
            if observer.parent[i] >= 0:
                force[:, observer.parent[i]] += force[:, i]
        return force


def _perpendicular(vector: Array) -> Array:
    """The vectors turned by +90 degrees."""
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def _relative_acceleration(arm: Array, omega: Array, alpha: Array) -> Array:
    """Acceleration of a point at ``arm`` from the pivot of a turning body, beyond the pivot's own."""
    return alpha[:, None] * _perpendicular(arm) - (omega**2)[:, None] * arm
