"""Energy of a state and where power goes: kinetic, gravity, springs, felt; joint and contact friction, felt damping.

An independent check of the compiled equations, in plain NumPy straight from an `Action`, vectorised over time:
nothing of ``kernels`` is used, so that a wrong kernel cannot agree with itself. `energy_audit` integrates
these along a motion. Felt stores the integral of its static law where that presses
(docs/explanation/felt.md).
Source: thesis eqs. 2.4, 2.10, 2.12, A.3. A state that is not finite gives terms that are not finite.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import BODIES, KEY_LIFT, Action, InputError
from model.parameters.effects import PINS, RAIL, SHANK
from model.scene.effect_terms import ON_THE_HEAD, bending, parts_of_hammer, sink_m

Array = NDArray[np.float64]
_CONTACTS = tuple(f"contact{i:02d}" for i in range(1, 14))


def _rotate(angle: Array, vector: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], axis=-1)


def _turn(vector: Array) -> Array:
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def _dot(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _curve(action: Action, path: str, z: Array) -> Array:
    a, b1, b2 = (action[f"{path}.{k}"] for k in ("A", "B1", "B2"))
    return a * (np.tanh(z) + b1 * z / (1.0 + b2 * z**4))


class _Motion:
    """Angles, pivots and their velocities of all bodies, (m,) and (m, 2); mass, inertia, centre of mass of each."""

    def __init__(self, action: Action, q: Array, v: Array, effects: Sequence[str]) -> None:
        self.action = action
        self.coordinates = [*BODIES, *(c for e, c in ((RAIL, KEY_LIFT), ("shank", SHANK)) if e in effects)]
        self.q, self.v = ({c: x[:, i] for i, c in enumerate(self.coordinates)} for x in (q, v))
        self.mass = {
            b: (action[f"{b}.mass"], action[f"{b}.inertia"], self.local(f"{b}.center_of_mass")) for b in BODIES
        }
        if SHANK in self.coordinates:
            for part, (m, x, y, inertia) in zip(("hammer", SHANK), parts_of_hammer(action), strict=True):
                self.mass[part] = (m, inertia, np.array([x, y]))
        self._contacts: dict[str, tuple[Array, Array, Array]] = {}
        still = np.zeros(len(q))
        self.angle, self.omega = {"ground": still}, {"ground": still}
        self.pivot, self.velocity = {"ground": np.zeros((len(q), 2))}, {"ground": np.zeros((len(q), 2))}
        for body in self.mass:
            up = "hammer" if body == SHANK else action.structure[f"{body}.parent"]
            joint = self.local("shank.hinge" if body == SHANK else f"{body}.pivot")
            self.pivot[body], self.velocity[body] = self.fixed(up, joint)
            if body == "key" and KEY_LIFT in self.q:
                rise = np.array([0.0, 1.0])
                self.pivot[body] = self.pivot[body] + self.q[KEY_LIFT][:, None] * rise
                self.velocity[body] = self.velocity[body] + self.v[KEY_LIFT][:, None] * rise
            self.angle[body], self.omega[body] = self.angle[up] + self.q[body], self.omega[up] + self.v[body]

    def fixed(self, body: str, local: Array) -> tuple[Array, Array]:
        """Position and velocity (m, 2) of the point (2,) of a body's frame."""
        point = self.pivot[body] + _rotate(self.angle[body], local)
        return point, self.velocity_at(body, point)

    def carried(self, body: str, path: str) -> tuple[Array, Array]:
        """Position and velocity (m, 2) of the point ``path`` fixed to ``body``."""
        return self.fixed(body, self.local(path) - (self.local("shank.hinge") if body == SHANK else 0.0))

    def velocity_at(self, body: str, point: Array) -> Array:
        """Velocity (m, 2) of the material point of ``body`` that is at ``point``."""
        return self.velocity[body] + self.omega[body][:, None] * _turn(point - self.pivot[body])

    def local(self, path: str) -> Array:
        return np.array([self.action[f"{path}.x"], self.action[f"{path}.y"]])

    def contact(self, name: str) -> tuple[Array, Array, Array]:
        """Penetration (m), its rate and the sliding speed (m/s) of a contact, (m,) each."""
        if name not in self._contacts:
            self._contacts[name] = self._contact(name)
        return self._contacts[name]

    def _contact(self, name: str) -> tuple[Array, Array, Array]:
        a = self.action
        first, second = (
            SHANK if name in ON_THE_HEAD and SHANK in self.q and body == "hammer" else body
            for body in (a.structure[f"{name}.first.body"], a.structure[f"{name}.second.body"])
        )
        shape, r = a.structure[f"{name}.second.shape"], a[f"{name}.first.radius"]
        centre = self.carried(first, f"{name}.first")[0]
        u = centre - self.carried(second, f"{name}.second")[0]
        if shape == "line":
            normal = self.local(f"{name}.second.normal")
            normal = _rotate(self.angle[second], normal / np.hypot(*normal))
            x = r - _dot(u, normal)
        else:
            distance = np.hypot(u[:, 0], u[:, 1])
            normal = u / distance[:, None]
            if shape == "hybrid":
                start, end = (
                    _rotate(self.angle[second] + a[f"{name}.second.arc_{k}"], np.array([1.0, 0.0]))
                    for k in ("start", "end")
                )
                past_start, past_end = _dot(u, _turn(start)) < 0.0, _dot(u, _turn(end)) > 0.0
                on_start = past_start & (~past_end | (_dot(u, start) >= _dot(u, end)))
                normal = np.where(on_start[:, None], start, np.where(past_end[:, None], end, normal))
                distance = np.where(past_start | past_end, _dot(u, normal), distance)
            x = r + a[f"{name}.second.radius"] - distance
        point = centre - (r - 0.5 * x)[:, None] * normal
        relative = self.velocity_at(first, point) - self.velocity_at(second, point)
        return x, -_dot(relative, normal), _dot(relative, _turn(normal))


def _felt(action: Action, name: str) -> Array:
    return np.array([action[f"{name}.normal.{k}"] for k in ("a", "b", "c", "D")])


def felt_energy(a: float, b: float, c: float, x: Array) -> Array:
    """Energy (J) stored by felt compressed by ``x`` (m): the integral of max(0, a x^3 + b x^2 + c x)."""

    def integral(s: Array) -> Array:
        return ((a / 4.0 * s + b / 3.0) * s + c / 2.0) * s**2

    x = np.maximum(x, 0.0)
    inside = b * b - 4.0 * a * c
    if not (b < 0.0 and inside > 0.0):
        return integral(x)
    low = 2.0 * c / (-b + np.sqrt(inside))  # the law is negative between these two compressions
    out = integral(np.minimum(x, low))
    if a > 0.0:
        high = (-b + np.sqrt(inside)) / (2.0 * a)
        out += integral(np.maximum(x, high)) - integral(np.array(high))
    return out


def _stored(action: Action, motion: _Motion, q: Array) -> dict[str, Array]:
    kinetic, gravity, spring, felt, rail, shank = (np.zeros(len(q)) for _ in range(6))
    for body, (m, inertia, local) in motion.mass.items():
        centre, velocity = motion.fixed(body, local)
        kinetic += 0.5 * m * _dot(velocity, velocity) + 0.5 * inertia * motion.omega[body] ** 2
        gravity += m * action["gravity.g"] * centre[:, 1]
    for body in ("jack", "repetition"):
        torque, k, q0 = (action[f"{body}_spring.{key}"] for key in ("torque", "stiffness", "angle"))
        turn = q[:, BODIES.index(body)] - q0
        spring += 0.5 * k * turn**2 - torque * turn
    for name in _CONTACTS:
        a, b, c, _ = _felt(action, name)
        felt += felt_energy(a, b, c, motion.contact(name)[0])
    if KEY_LIFT in motion.q:
        a, b, c, _ = _felt(action, RAIL)
        rail = felt_energy(a, b, c, sink_m(action) - motion.q[KEY_LIFT])
    if SHANK in motion.q:
        shank = 0.5 * bending(action)[0] * motion.q[SHANK] ** 2
    return {"kinetic": kinetic, "gravity": gravity, "spring": spring, "felt": felt, "rail": rail, "shank": shank}


def _powers(action: Action, motion: _Motion, v: Array, force: Array) -> dict[str, Array]:
    joint, sliding, damping, rail, shank = (np.zeros(len(v)) for _ in range(5))
    for i, body in enumerate(BODIES):
        joint += v[:, i] * _curve(action, f"{body}.joint_friction", v[:, i] / action["friction_threshold.omega_t"])
    for name in _CONTACTS:
        x, rate, slide = motion.contact(name)
        a, b, c, d = _felt(action, name)
        static = np.maximum(0.0, ((a * x + b) * x + c) * np.maximum(x, 0.0))
        normal = static * np.maximum(0.0, 1.0 + d * rate)
        damping += (normal - static) * rate
        sliding += normal * slide * _curve(action, f"{name}.friction", slide / action["friction_threshold.v_t"])
    down = -motion.carried("key", "drive.point")[1][:, 1]
    if KEY_LIFT in motion.q:
        a, b, c, d = _felt(action, RAIL)
        x, rate = np.maximum(sink_m(action) - motion.q[KEY_LIFT], 0.0), -motion.v[KEY_LIFT]
        static = np.maximum(0.0, ((a * x + b) * x + c) * x)
        rail = static * (np.maximum(0.0, 1.0 + d * rate) - 1.0) * rate
        grip = action[f"{RAIL}.guide_friction.A"] * np.tanh(rate / action["friction_threshold.v_t"])
        rail = rail + grip * rate
    if SHANK in motion.q:
        shank = bending(action)[1] * motion.v[SHANK] ** 2
    lost = {"joint_friction": joint, "contact_friction": sliding, "felt_damping": damping, "rail": rail, "shank": shank}
    return {"input": force * down, **lost}


def energy_terms(
    action: Action,
    angle_rad: ArrayLike,
    speed_rad_per_s: ArrayLike,
    force_n: ArrayLike,
    effects: Sequence[str] = (),
) -> tuple[dict[str, Array], dict[str, Array]]:
    """What states (m, 5) store and exchange under forces (m,) on the key; (m, 6) or (m, 7) with ``effects``.

    Returns
    -------
    stored : energy (J), (m,) each: ``kinetic``, ``gravity``, ``spring``, ``felt``, ``rail`` (felt of the balance
        rail), ``shank`` (bending)
    powers : power (W), (m,) each: ``input`` of the force and, positive when lost, ``joint_friction``,
        ``contact_friction``, ``felt_damping``, ``rail`` (its felt and the friction on its pin), ``shank``
    """
    if giving := [e for e in effects if e in PINS]:
        raise InputError(f"energy terms: found joints that give ({', '.join(giving)}), allowed rigid joints")
    q, v = np.atleast_2d(np.asarray(angle_rad, float)), np.atleast_2d(np.asarray(speed_rad_per_s, float))
    with np.errstate(all="ignore"):  # a state far outside gives inf or nan, which the caller sees
        motion = _Motion(action, q, v, effects)
        return _stored(action, motion, q), _powers(action, motion, v, np.asarray(force_n, float))
