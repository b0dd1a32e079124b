"""States of a scene looked at: what its contacts do, how its bodies move, what its joints bear.

Forces and accelerations are functions of the state alone, from the same kernels as the motion. Joint forces are what
Newton's law leaves over, from the outer bodies inwards. World frame: x right, y up. Used by `observe` along a motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.kernels import layout as L
from model.kernels.tables import output as O
from model.scene.build import Scene

Array = NDArray[np.float64]


class Observer:
    """Looks at states of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        t, p = scene.tables, scene.vector
        self.parent = [int(w) for w in t.parent]
        self.outwards = sorted(range(scene.size), key=lambda i: self.parent[i] >= 0)  # what stands on the ground first
        blocks = p[L.GLOBALS : L.GLOBALS + L.BODY_SIZE * scene.size].reshape(scene.size, L.BODY_SIZE)
        self.mass = blocks[:, L.MASS]
        self.down = [int(body) for kind, body in t.drive if kind == L.FORCE_DOWN]

    def look(self, q: Array, v: Array, u: Array) -> Look:
        """Everything at states (m, n) under inputs (m,)."""
        m, n, c = len(q), self.scene.size, len(self.scene.contacts)
        seen, pose = np.zeros((m, c, O.SEEN_SIZE)), np.zeros((m, n, L.POSE_SIZE))
        turning, braked = np.zeros((m, n)), np.zeros((m, n))
        t, p = self.scene.tables, self.scene.vector
        q, v, u = (np.require(a, float, ["C", "W"]) for a in (q, v, u))
        tips = np.zeros((m, len(t.probe), 2))
        O.observe_along(q, v, u, p, t, seen, pose, turning, braked, tips)
        return Look(self, pose, v, turning, seen, braked, u, tips)


class Look:
    """States looked at: motion of the bodies and forces of the joints on demand."""

    def __init__(
        self,
        observer: Observer,
        pose: Array,
        rate: Array,
        turning: Array,
        seen: Array,
        braked: Array,
        u: Array,
        tips: Array,
    ) -> None:
        self.observer, self.pose, self.seen, self.braked, self.u, self.tips = observer, pose, seen, braked, u, tips
        m, n = turning.shape
        self.turning = np.zeros((m, n))  # angular acceleration from ground
        self.velocity, self.acceleration = np.zeros((m, n, 2)), np.zeros((m, n, 2))
        pivot_v, pivot_a = np.zeros((m, n, 2)), np.zeros((m, n, 2))
        pivot, center = pose[:, :, [L.POSE_X, L.POSE_Y]], pose[:, :, [L.POSE_CX, L.POSE_CY]]
        omega = pose[:, :, L.POSE_OMEGA]
        for i in observer.outwards:
            w = observer.parent[i]
            if w == L.GUIDED:  # does not turn; its coordinate is the height of its pivot
                pivot_v[:, i, 1], pivot_a[:, i, 1] = rate[:, i], turning[:, i]
                self.velocity[:, i], self.acceleration[:, i] = pivot_v[:, i], pivot_a[:, i]
                continue
            self.turning[:, i] = turning[:, i]
            if w >= 0:
                self.turning[:, i] += self.turning[:, w]
                arm = pivot[:, i] - pivot[:, w]
                pivot_v[:, i] = pivot_v[:, w] + omega[:, w, None] * _turn(arm)
                pivot_a[:, i] = pivot_a[:, w] + _carried(arm, omega[:, w], self.turning[:, w])
            arm = center[:, i] - pivot[:, i]
            self.velocity[:, i] = pivot_v[:, i] + omega[:, i, None] * _turn(arm)
            self.acceleration[:, i] = pivot_a[:, i] + _carried(arm, omega[:, i], self.turning[:, i])

    def joints(self) -> Array:
        """Force (m, n, 2) on each body from what carries it: what Newton's law leaves over when all others are known.

        Friction, springs and damping of a joint are torques; they do not enter here.
        """
        observer, tables = self.observer, self.observer.scene.tables
        force = observer.mass[:, None] * self.acceleration
        force[:, :, 1] += observer.mass * observer.scene.vector[L.GRAVITY]
        normal, press = self.seen[:, :, O.SEEN_NX : O.SEEN_NY + 1], self.seen[:, :, O.SEEN_NORMAL, None]
        push = press * normal + self.seen[:, :, O.SEEN_FRICTION, None] * _turn(normal)
        for c, (first, second, *_) in enumerate(tables.contact):
            if first >= 0:
                force[:, first] -= push[:, c]
            if second >= 0:
                force[:, second] += push[:, c]
        for b, (upper, lower) in enumerate(tables.probe):
            force[:, upper, 1] -= self.tips[:, b, 0]
            force[:, lower, 1] += self.tips[:, b, 0]
        for body in observer.down:
            force[:, body, 1] += self.u
        for i in reversed(observer.outwards):
            if observer.parent[i] >= 0:
                force[:, observer.parent[i]] += force[:, i]
        return force


def _turn(vector: Array) -> Array:
    """The vectors turned by +90 degrees."""
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def _carried(arm: Array, omega: Array, alpha: Array) -> Array:
    """Acceleration of a point at ``arm`` from the pivot of a turning body, beyond the pivot's own."""
    return alpha[:, None] * _turn(arm) - (omega**2)[:, None] * arm
