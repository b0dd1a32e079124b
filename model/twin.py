"""The equations of motion once more, in plain NumPy, read straight from an `Action`: slow and obviously right.

An independent check of the compiled kernels (they must agree to 1e-12) and the right-hand side a user would write by
hand, which benchmarks compare with. Bodies are points with Jacobians, M = sum m JtJ + I jjt; forces act through
virtual work. Nothing of ``kernels`` or ``scene`` is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .parameters import BODIES, Action

Vector = NDArray[np.float64]


def _rotate(angle: float, vector: Vector) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _turn(vector: Vector) -> Vector:
    """The vector turned by +90 degrees: z x vector."""
    return np.array([-vector[1], vector[0]])


class Twin:
    """Right-hand side of one action; the input is the force on the key, N, positive downwards."""

    def __init__(self, action: Action) -> None:
        self.action = action
        self.parent = {b: action.structure[f"{b}.parent"] for b in BODIES}
        self.contacts = [f"contact{i:02d}" for i in range(1, 14)]

    def _lineage(self, body: str) -> list[str]:
        out = []
        while body != "ground":
            out.append(body)
            body = self.parent[body]
        return out

    def _place(self, q: Vector, v: Vector) -> None:
        self.angle, self.omega, self.pivot = {"ground": 0.0}, {"ground": 0.0}, {"ground": np.zeros(2)}
        for i, body in enumerate(BODIES):
            up = self.parent[body]
            local = np.array([self.action[f"{body}.pivot.x"], self.action[f"{body}.pivot.y"]])
            self.pivot[body] = self.pivot[up] + _rotate(self.angle[up], local)
            self.angle[body] = self.angle[up] + q[i]
            self.omega[body] = self.omega[up] + v[i]

    def _point(self, body: str, path: str) -> Vector:
        local = np.array([self.action[f"{path}.x"], self.action[f"{path}.y"]])
        return self.pivot[body] + _rotate(self.angle[body], local)

    def _point_jacobian(self, body: str, point: Vector) -> NDArray[np.float64]:
        """(2, 5): velocity of a point fixed to ``body`` per unit joint speed."""
        out = np.zeros((2, len(BODIES)))
        for b in self._lineage(body):
            out[:, BODIES.index(b)] = _turn(point - self.pivot[b])
        return out

    def _convective(self, body: str, point: Vector) -> Vector:
        """Acceleration of a body-fixed point at zero joint accelerations."""
        up = self.parent[body]
        out = -(self.omega[body] ** 2) * (point - self.pivot[body])
        if up != "ground":
            out = out - self.omega[up] ** 2 * (self.pivot[body] - self.pivot[up])
        return out

    def _curve(self, s: float, scale: float, path: str) -> float:
        a, b1, b2 = (self.action[f"{path}.{k}"] for k in ("A", "B1", "B2"))
        z = s / scale
        return a * (np.tanh(z) + b1 * z / (1 + b2 * z**4))

    def gap(self, name: str) -> tuple[float, Vector, Vector, str, str]:
        """Penetration, normal from second to first, centre of the first circle, names of both bodies."""
        a = self.action
        first, second = a.structure[f"{name}.first.body"], a.structure[f"{name}.second.body"]
        shape = a.structure[f"{name}.second.shape"]
        centre, other = self._point(first, f"{name}.first"), self._point(second, f"{name}.second")
        r = a[f"{name}.first.radius"]
        u = centre - other
        if shape == "line":
            normal = np.array([a[f"{name}.second.normal.x"], a[f"{name}.second.normal.y"]])
            normal = _rotate(self.angle[second], normal / np.linalg.norm(normal))
            return r - float(u @ normal), normal, centre, first, second
        rho = a[f"{name}.second.radius"]
        if shape == "hybrid":
            start, end = (
                _rotate(self.angle[second] + a[f"{name}.second.arc_{k}"], np.array([1.0, 0.0]))
                for k in ("start", "end")
            )
            lines = [e for e, t in ((start, -_turn(start)), (end, _turn(end))) if u @ t > 0]
            if lines:
                normal = max(lines, key=lambda e: float(u @ e))
                return r + rho - float(u @ normal), normal, centre, first, second
        distance = float(np.linalg.norm(u))
        return r + rho - distance, u / distance, centre, first, second

    def contact(self, name: str, v: Vector) -> tuple[float, float, Vector]:
        """Normal force, friction force (N) and their generalised force (5,) at the placed state."""
        a = self.action
        x, n, centre, first, second = self.gap(name)
        if x <= 0:
            return 0.0, 0.0, np.zeros(len(BODIES))
        point = centre - (a[f"{name}.first.radius"] - x / 2) * n
        relative = self._point_jacobian(first, point) - self._point_jacobian(second, point)
        speed = relative @ v
        ka, kb, kc, damping = (a[f"{name}.normal.{k}"] for k in ("a", "b", "c", "D"))
        static = ka * x**3 + kb * x**2 + kc * x
        normal = max(0.0, static) * max(0.0, 1 - damping * float(n @ speed))
        t = _turn(n)
        tangential = -normal * self._curve(float(t @ speed), a["friction_threshold.v_t"], f"{name}.friction")
        return normal, tangential, relative.T @ (normal * n + tangential * t)

    def forces_and_mass(self, q: Vector, v: Vector, force_n: float) -> tuple[Vector, NDArray[np.float64]]:
        """Generalised force (5,) and mass matrix (5, 5)."""
        a = self.action
        self._place(q, v)
        mass, f = np.zeros((len(BODIES), len(BODIES))), np.zeros(len(BODIES))
        for body in BODIES:
            centre = self._point(body, f"{body}.center_of_mass")
            j, turning = self._point_jacobian(body, centre), np.zeros(len(BODIES))
            turning[[BODIES.index(b) for b in self._lineage(body)]] = 1.0
            m = a[f"{body}.mass"]
            mass += m * j.T @ j + a[f"{body}.inertia"] * np.outer(turning, turning)
            f += j.T @ (m * (np.array([0.0, -a["gravity.g"]]) - self._convective(body, centre)))
            i = BODIES.index(body)
            f[i] -= self._curve(v[i], a["friction_threshold.omega_t"], f"{body}.joint_friction")
        for body in ("jack", "repetition"):
            i, s = BODIES.index(body), f"{body}_spring"
            f[i] += a[f"{s}.torque"] - a[f"{s}.stiffness"] * (q[i] - a[f"{s}.angle"])
        f += self._point_jacobian("key", self._point("key", "drive.point")).T @ np.array([0.0, -force_n])
        for name in self.contacts:
            f += self.contact(name, v)[2]
        return f, mass

    def acceleration(self, q: Vector, v: Vector, force_n: float) -> Vector:
        """Joint accelerations (5,), rad/s^2, at angles ``q`` and speeds ``v``."""
        f, mass = self.forces_and_mass(q, v, force_n)
        return np.asarray(np.linalg.solve(mass, f))

    def held_key(self, q: Vector, v: Vector, key_acceleration: float) -> tuple[Vector, float]:
        """Accelerations of the other bodies (4,) while the key's is prescribed, and the force that takes, N."""
        f, mass = self.forces_and_mass(q, v, 0.0)
        others = np.linalg.solve(mass[1:, 1:], f[1:] - mass[1:, 0] * key_acceleration)
        missing = mass[0] @ np.append(key_acceleration, others) - f[0]
        down = self._point_jacobian("key", self._point("key", "drive.point")).T @ np.array([0.0, -1.0])
        return np.asarray(others, dtype=float), float(missing / down[0])
