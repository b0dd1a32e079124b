"""Equations of an action whose joints give or not, with every body free: position and angle each, joints as forces.

An independent check of what generated kernels do with joints that give (docs/explanation/effects.md), slow
and plain: no tree of coordinates, no mass matrix of joints. A joint that gives is a known force, one that does not an
unknown reaction that keeps two points together; all follow from one linear system. Geometry of gaps and laws are those
of `tests.model.verification.reference_equations.Twin`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model import BODIES, Action
from tests.model.verification.reference_equations import Twin

Vector = NDArray[np.float64]


def _turn(vector: Vector) -> Vector:
    return np.array([-vector[1], vector[0]])


class FreeBodies(Twin):
    """Accelerations of one action under a force on the key.

    Parameters
    ----------
    action : parameter set
    pins : body and direction, x or y, of each way in which a joint gives, as `model.scene.build.Scene.pins`
    """

    def __init__(self, action: Action, pins: Sequence[tuple[str, str]]) -> None:
        super().__init__(action)
        self.pins = list(pins)

    def _place(self, q: Vector, v: Vector) -> None:
        count = len(BODIES)
        give = {pin: (q[count + k], v[count + k]) for k, pin in enumerate(self.pins)}
        self.way, self.rate = (
            {b: np.array([give.get((b, axis), (0.0, 0.0))[k] for axis in "xy"]) for b in BODIES} for k in (0, 1)
        )
        self.given = give
        self.angle, self.omega = {"ground": 0.0}, {"ground": 0.0}
        self.pivot, self.velocity = {"ground": np.zeros(2)}, {"ground": np.zeros(2)}
        self.joint: dict[str, Vector] = {}  # the point of the carrier at which a body hangs
        for body in BODIES:
            up, i = self.parent[body], BODIES.index(body)
            c, s = np.cos(self.angle[up]), np.sin(self.angle[up])
            self.joint[body] = self.pivot[up] + np.array([[c, -s], [s, c]]) @ self._local(f"{body}.pivot")
            self.pivot[body] = self.joint[body] + self.way[body]
            self.velocity[body] = self.velocity_at(up, self.joint[body]) + self.rate[body]
            self.angle[body], self.omega[body] = self.angle[up] + q[i], self.omega[up] + v[i]

    def velocity_at(self, body: str, point: Vector) -> Vector:
        """Velocity of the material point of a body."""
        return np.asarray(self.velocity[body] + self.omega[body] * _turn(point - self.pivot[body]))

    def _bushing(self, body: str, axis: int) -> float | None:
        """Force on a body in a direction of its joint; None where the joint is rigid."""
        a, name = self.action, "xy"[axis]
        if (body, name) not in self.given:
            return None
        way, rate = self.given[(body, name)]
        pin = f"{body}_pin"
        return float(a[f"{pin}.load.{name}"] - a[f"{pin}.stiffness"] * way - a[f"{pin}.damping"] * rate)

    def acceleration(self, q: Vector, v: Vector, force_n: float) -> Vector:
        """Accelerations of angles and give (n,), in the order of ``q``."""
        a, n = self.action, len(BODIES)
        self._place(q, v)
        centre = {b: self._point(b, f"{b}.center_of_mass") for b in BODIES}
        rows, right = np.zeros((5 * n, 5 * n)), np.zeros(5 * n)
        # unknown: acceleration of each pivot, angular acceleration; then reactions of joints, 2 each
        column = {b: 3 * i for i, b in enumerate(BODIES)}

        def act(body: str, point: Vector, force: Vector) -> None:
            """A known force; moments about the centre of mass."""
            if body != "ground":
                at = column[body]
                right[at : at + 2] += force
                right[at + 2] += _turn(point - centre[body]) @ force

        def torque(body: str, size: float) -> None:
            if body != "ground":
                right[column[body] + 2] += size

        for i, body in enumerate(BODIES):
            m, inertia, _ = self.mass[body]
            at, up, arm = column[body], self.parent[body], centre[body] - self.pivot[body]
            rows[at : at + 2, at : at + 2] = m * np.eye(2)
            rows[at : at + 2, at + 2] = m * _turn(arm)
            right[at : at + 2] += m * (self.omega[body] ** 2 * arm - np.array([0.0, a["gravity.g"]]))
            rows[at + 2, at + 2] = inertia
            rubs = self._curve(v[i], a["friction_threshold.omega_t"], f"{body}.joint_friction")
            if body in ("jack", "repetition"):
                s = f"{body}_spring"
                turned = a[f"{s}.torque"] - a[f"{s}.stiffness"] * (q[i] - a[f"{s}.angle"])
                right[at + 2] += turned  # on the lever alone: the set gives generalised torques
                torque(up, -turned)
            torque(body, -rubs)
            torque(up, rubs)
            for axis in (0, 1):
                unknown, e = 3 * n + 2 * i + axis, np.eye(2)[axis]
                known = self._bushing(body, axis)
                if known is not None:
                    rows[unknown, unknown] = 1.0
                    right[unknown] = known
                else:
                    rows[unknown, at : at + 2] = e
                    if up != "ground":
                        hang = self.joint[body] - self.pivot[up]
                        rows[unknown, column[up] : column[up] + 2] = -e
                        rows[unknown, column[up] + 2] = -e @ _turn(hang)
                        right[unknown] = -(self.omega[up] ** 2) * (e @ hang)
                rows[at : at + 2, unknown] -= e
                rows[at + 2, unknown] -= _turn(self.pivot[body] - centre[body]) @ e
                if up != "ground":
                    rows[column[up] : column[up] + 2, unknown] += e
                    rows[column[up] + 2, unknown] += _turn(self.joint[body] - centre[up]) @ e
        act("key", self._point("key", "drive.point"), np.array([0.0, -force_n]))
        for name in self.contacts:
            size, rub, normal, point = self._pressed(name)
            force = size * normal + rub * _turn(normal)
            act(self.action.structure[f"{name}.first.body"], point, force)
            act(self.action.structure[f"{name}.second.body"], point, -force)
        return self._of_coordinates(np.asarray(np.linalg.solve(rows, right), dtype=float), column)

    def _pressed(self, name: str) -> tuple[float, float, Vector, Vector]:
        """Normal force, friction force, normal and point of action of a contact at the placed state."""
        a = self.action
        x, normal, centre, first, second = self.gap(name)
        point = centre - (a[f"{name}.first.radius"] - x / 2) * normal
        if x <= 0.0:
            return 0.0, 0.0, normal, point
        speed = self.velocity_at(first, point) - self.velocity_at(second, point)
        ka, kb, kc, damping = (a[f"{name}.normal.{k}"] for k in ("a", "b", "c", "D"))
        size = max(0.0, ka * x**3 + kb * x**2 + kc * x) * max(0.0, 1 - damping * float(normal @ speed))
        rub = self._curve(float(_turn(normal) @ speed), a["friction_threshold.v_t"], f"{name}.friction")
        return size, -size * rub, normal, point

    def _of_coordinates(self, found: Vector, column: dict[str, int]) -> Vector:
        """Accelerations of joints' angles and of what joints give from those of free bodies."""
        out: list[float] = []
        gave: dict[tuple[str, str], float] = {}
        for body in BODIES:
            at, up = column[body], self.parent[body]
            here, spin = found[at : at + 2], found[at + 2]
            if up == "ground":
                carrier, turns = np.zeros(2), 0.0
            else:
                hang = self.joint[body] - self.pivot[up]
                turns = found[column[up] + 2]
                carrier = found[column[up] : column[up] + 2] + turns * _turn(hang) - self.omega[up] ** 2 * hang
            out.append(spin - turns)
            gave |= {(body, name): x for name, x in zip("xy", here - carrier, strict=True)}
        return np.array([*out, *(gave[pin] for pin in self.pins)])
