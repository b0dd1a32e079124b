"""The equations of motion once more, in plain NumPy, read straight from an `Action`: slow and obviously right.

An independent check of the compiled kernels (they must agree to 1e-12) and the right-hand side a user would write by
hand. Bodies are points with Jacobians, M = sum m JtJ + I jjt; forces act through
virtual work. Nothing of ``kernels`` or ``scene`` is used. With effects the key's pivot rises by one more coordinate,
and the hammer is two bodies with a spring between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model import BODIES, Action

Vector = NDArray[np.float64]

_COORDINATE = {
    "motor_arm": "motor",
    "motor_drive": "winding",
    "finger": "finger",
    "balance_rail": "key_lift",
    "shank": "shank",
}
_ARM_LEVEL = 0.029  # rad, key at which the motor's arm is level: near rest
_ARM = (
    *("inertia", "length", "joint_friction", "spring_stiffness", "preload_n"),
    *(f"contact_{k}" for k in ("a", "b", "c", "damping")),
)
_DRIVE = (
    *("resistance", "inductance", "torque_constant", "loop_gain"),
    *("supply", "current_limit", "limit_gain", "limit_softness"),
)
_FINGER = (
    *("mass", "stiffness", "damping", "length", "preload_n"),
    *(f"pad_{k}" for k in ("a", "b", "c", "damping")),
)
_BEYOND_HINGE = ("contact04", "contact12", "contact13")


def _rotate(angle: float, vector: Vector) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _turn(vector: Vector) -> Vector:
    """The vector turned by +90 degrees: z x vector."""
    return np.array([-vector[1], vector[0]])


class Twin:
    """Right-hand side of one action; the input is the force on the key (N, downwards), or what an effect takes.

    Of ``motor_arm`` and ``finger`` the torque on the joint, N m; of ``motor_drive`` the amplifier's source, V.
    """

    def __init__(self, action: Action, effects: Sequence[str] = ()) -> None:
        self.action = action
        self.bodies = [*BODIES, *(["shank"] if "shank" in effects else [])]
        self.coordinates = [*BODIES, *(c for e, c in _COORDINATE.items() if e in effects)]
        self.parent = {b: action.structure[f"{b}.parent"] for b in BODIES} | {"shank": "hammer"}
        self.contacts = [f"contact{i:02d}" for i in range(1, 14)]
        self.lifts, self.bends = "balance_rail" in effects, "shank" in effects
        self.mass = {
            b: (action[f"{b}.mass"], action[f"{b}.inertia"], self._local(f"{b}.center_of_mass")) for b in BODIES
        }
        if self.bends:
            self._split_hammer()

    def _local(self, path: str) -> Vector:
        return np.array([self.action[f"{path}.x"], self.action[f"{path}.y"]])

    def _split_hammer(self) -> None:
        """Butt and head from the hammer as a whole: mass, first and second moments add up."""
        a = self.action
        mass, inertia, centre = self.mass["hammer"]
        m, i, c = a["shank.near.mass"], a["shank.near.inertia"], self._local("shank.near.center_of_mass")
        far = (mass * centre - m * c) / (mass - m)
        about = inertia - i - m * (mass - m) / mass * float((c - far) @ (c - far))
        hinge = self._local("shank.hinge")
        self.mass["hammer"], self.mass["shank"] = (m, i, c), (mass - m, about, far - hinge)
        # kinetic energy of free flight about the pivot, as a quadratic form in the speeds of butt and head
        form = np.zeros((2, 2))
        for part, turns in (((m, i, c), np.array([1.0, 0.0])), ((mass - m, about, far), np.array([1.0, 1.0]))):
            arm = np.outer(part[2], np.array([1.0, 0.0])) + np.outer(part[2] - hinge, turns - np.array([1.0, 0.0]))
            form += part[0] * arm.T @ arm + part[1] * np.outer(turns, turns)
        modal = 1.0 / np.linalg.inv(form)[1, 1]
        omega = 2.0 * np.pi * a["shank.frequency_hz"]
        self.stiffness, self.damping = modal * omega**2, 2.0 * a["shank.damping_ratio"] * modal * omega

    def _lineage(self, body: str) -> list[str]:
        out = []
        while body != "ground":
            out.append(body)
            body = self.parent[body]
        return out

    def _place(self, q: Vector, v: Vector) -> None:
        self.turned = dict(zip(self.coordinates, q, strict=True))
        self.angle, self.omega, self.pivot = {"ground": 0.0}, {"ground": 0.0}, {"ground": np.zeros(2)}
        for body in self.bodies:
            up, i = self.parent[body], self.coordinates.index(body)
            local = self._local("shank.hinge" if body == "shank" else f"{body}.pivot")
            self.pivot[body] = self.pivot[up] + _rotate(self.angle[up], local)
            if body == "key" and self.lifts:
                self.pivot[body] = self.pivot[body] + np.array([0.0, q[self.coordinates.index("key_lift")]])
            self.angle[body] = self.angle[up] + q[i]
            self.omega[body] = self.omega[up] + v[i]

    def _point(self, body: str, path: str) -> Vector:
        local = self._local(path)
        if body == "shank":  # drawn in the frame of the straight hammer
            local = local - self._local("shank.hinge")
        return self.pivot[body] + _rotate(self.angle[body], local)

    def _surface_body(self, name: str, side: str) -> str:
        body = self.action.structure[f"{name}.{side}.body"]
        return "shank" if self.bends and body == "hammer" and name in _BEYOND_HINGE else body

    def _point_jacobian(self, body: str, point: Vector) -> NDArray[np.float64]:
        """(2, n): velocity of a point fixed to ``body`` per unit joint speed."""
        out = np.zeros((2, len(self.coordinates)))
        for b in self._lineage(body):
            out[:, self.coordinates.index(b)] = _turn(point - self.pivot[b])
        if body == "key" and self.lifts:
            out[1, self.coordinates.index("key_lift")] = 1.0
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
        first, second = self._surface_body(name, "first"), self._surface_body(name, "second")
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
        """Normal force, friction force (N) and their generalised force (n,) at the placed state."""
        a = self.action
        x, n, centre, first, second = self.gap(name)
        if x <= 0:
            return 0.0, 0.0, np.zeros(len(self.coordinates))
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
        """Generalised force (n,) and mass matrix (n, n)."""
        a, n = self.action, len(self.coordinates)
        self._place(q, v)
        mass, f = np.zeros((n, n)), np.zeros(n)
        for body in self.bodies:
            m, inertia, local = self.mass[body]
            centre = self.pivot[body] + _rotate(self.angle[body], local)
            j, turning = self._point_jacobian(body, centre), np.zeros(n)
            turning[[self.coordinates.index(b) for b in self._lineage(body)]] = 1.0
            mass += m * j.T @ j + inertia * np.outer(turning, turning)
            f += j.T @ (m * (np.array([0.0, -a["gravity.g"]]) - self._convective(body, centre)))
            if body in BODIES:
                i = BODIES.index(body)
                f[i] -= self._curve(v[i], a["friction_threshold.omega_t"], f"{body}.joint_friction")
        for body in ("jack", "repetition"):
            i, s = BODIES.index(body), f"{body}_spring"
            f[i] += a[f"{s}.torque"] - a[f"{s}.stiffness"] * (q[i] - a[f"{s}.angle"])
        if "motor" in self.coordinates:
            wound = "winding" in self.coordinates
            self._press("motor", v, self._torque_of_winding(v, force_n, mass, f) if wound else force_n, mass, f)
        elif "finger" in self.coordinates:
            self._press("finger", v, force_n, mass, f)
        else:
            f += self._point_jacobian("key", self._point("key", "drive.point")).T @ np.array([0.0, -force_n])
        for name in self.contacts:
            f += self.contact(name, v)[2]
        if self.bends:
            i = self.coordinates.index("shank")
            f[i] -= self.stiffness * q[i] + self.damping * v[i]
        if self.lifts:
            i = self.coordinates.index("key_lift")
            friction = a["balance_rail.guide_friction.A"] * np.tanh(v[i] / a["friction_threshold.v_t"])
            f[i] += self.rail_force(q[i], v[i]) - friction
        return f, mass

    def _torque_of_winding(self, v: Vector, source_v: float, mass: NDArray[np.float64], f: Vector) -> float:
        """Add the winding's inductance and voltages to ``mass`` and ``f``; the torque of its current, N m."""
        d = {k: self.action[f"motor_drive.{k}"] for k in _DRIVE}
        i, current = self.coordinates.index("winding"), v[self.coordinates.index("winding")]
        share = d["limit_softness"]

        def held(x: float, limit: float) -> float:
            over = (abs(x) - (1.0 - share) * limit) / (share * limit)
            return x if over <= 0.0 else np.sign(x) * limit * (1.0 - share + share * over / (1.0 + over**4) ** 0.25)

        beyond = current - held(current, d["current_limit"])
        volts = held(source_v - d["loop_gain"] * current - d["limit_gain"] * beyond, d["supply"])
        mass[i, i] += d["inductance"]
        f[i] += volts - d["resistance"] * current - d["torque_constant"] * v[self.coordinates.index("motor")]
        return float(d["torque_constant"] * current)

    def _arm(self, coordinate: str) -> dict[str, float]:
        """Numbers of the motor arm, or of the finger as one."""
        if coordinate == "motor":
            return {k: self.action[f"motor_arm.{k}"] for k in _ARM} | {"damping": 0.0}
        g = {k: self.action[f"finger.{k}"] for k in _FINGER}
        square = g["length"] ** 2
        return g | {
            "inertia": g["mass"] * square, "spring_stiffness": g["stiffness"] * square, "joint_friction": 0.0,
            "damping": g["damping"] * square, **{f"contact_{k}": g[f"pad_{k}"] for k in ("a", "b", "c", "damping")},
        }  # fmt: skip

    def _press(self, coordinate: str, v: Vector, torque_nm: float, mass: NDArray[np.float64], f: Vector) -> None:
        """Add rotor and arm, or finger, and their contact with the key to ``mass`` and ``f``."""
        a, i = self._arm(coordinate), self.coordinates.index(coordinate)
        level = self._local("key.pivot") + _rotate(_ARM_LEVEL, self._local("drive.point"))
        arm = _rotate(self.turned[coordinate], np.array([-a["length"], 0.0]))
        tip, point = level + np.array([a["length"], 0.0]) + arm, self._point("key", "drive.point")
        closing = self._point_jacobian("key", point)[1]  # of the penetration, per unit speed
        closing[i] -= _turn(arm)[1]
        x, rate = point[1] - tip[1], float(closing @ v)
        static = max(0.0, a["contact_a"] * x**3 + a["contact_b"] * x**2 + a["contact_c"] * x) if x > 0.0 else 0.0
        f -= closing * static * max(0.0, 1.0 + a["contact_damping"] * rate)
        mass[i, i] += a["inertia"]
        f[i] += torque_nm + a["preload_n"] * a["length"] - a["spring_stiffness"] * self.turned[coordinate]
        f[i] -= a["damping"] * v[i] + a["joint_friction"] * np.tanh(v[i] / self.action["friction_threshold.omega_t"])

    def rail_force(self, lift: float, rate: float) -> float:
        """Force of the balance rail on the key (N) at a height (m) of its pivot above its place in the set."""
        a, b, c, damping, load = (
            self.action[f"balance_rail.{k}"] for k in ("normal.a", "normal.b", "normal.c", "normal.D", "load_at_rest")
        )
        roots = np.roots([a, b, c, -load])
        sink = min(r.real for r in roots if abs(r.imag) < 1e-12 * abs(r) and r.real >= 0.0)
        x = sink - lift
        static = max(0.0, a * x**3 + b * x**2 + c * x) if x > 0.0 else 0.0
        return float(static * max(0.0, 1.0 - damping * rate))

    def acceleration(self, q: Vector, v: Vector, force_n: float) -> Vector:
        """Accelerations of the coordinates (n,), rad/s^2, at angles ``q`` and speeds ``v``."""
        f, mass = self.forces_and_mass(q, v, force_n)
        return np.asarray(np.linalg.solve(mass, f))

    def held_key(self, q: Vector, v: Vector, key_acceleration: float) -> tuple[Vector, float]:
        """Accelerations of the other bodies (4,) while the key's is prescribed, and the force that takes, N."""
        f, mass = self.forces_and_mass(q, v, 0.0)
        others = np.linalg.solve(mass[1:, 1:], f[1:] - mass[1:, 0] * key_acceleration)
        missing = mass[0] @ np.append(key_acceleration, others) - f[0]
        down = self._point_jacobian("key", self._point("key", "drive.point")).T @ np.array([0.0, -1.0])
        return np.asarray(others, dtype=float), float(missing / down[0])
