"""What joints give under way: their motion at the output times, the force of their bushings, how a run begins.

In: a scene with joints that give, and rows (m, z) of what its step loop remembers (`State.memory`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.kernels import layout as L
from model.kernels.trajectory.giving_joints import giving_contacts_along
from model.scene.build import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GivingMotion:
    """How far joints give at the output times.

    Attributes
    ----------
    directions : (g,) such as ``hammer_pin_x``: which joint, to the right (x) or up (y)
    way_m : (m, g) how far the pivot of the body is from its place in the set
    speed_m_per_s : (m, g)
    force_n : (m, g) force of the bushing on the body
    """

    directions: tuple[str, ...]
    way_m: Array
    speed_m_per_s: Array
    force_n: Array

    def of(self, body: str) -> tuple[Array, Array]:
        """Way and speed (m, 2) of the joint of ``body``, m and m/s, to the right and up; zero where it is rigid."""
        way, speed = np.zeros((len(self.way_m), 2)), np.zeros((len(self.way_m), 2))
        for k, axis in enumerate("xy"):
            if f"{body}_pin_{axis}" in self.directions:
                i = self.directions.index(f"{body}_pin_{axis}")
                way[:, k], speed[:, k] = self.way_m[:, i], self.speed_m_per_s[:, i]
        return way, speed

    def columns(self) -> dict[str, Array]:
        """Columns by name: ways, m, then forces, N."""
        out = {f"{name}_m": self.way_m[:, i] for i, name in enumerate(self.directions)}
        return out | {f"{name}_n": self.force_n[:, i] for i, name in enumerate(self.directions)}


def rows_of_pins(scene: Scene, rows: Array) -> tuple[Array, Array]:
    """Ways (m, g), m, and speeds (m, g), m/s, of the directions in which joints give, from rows (m, z)."""
    first, count = len(scene.tables.memory), len(scene.pins)
    return (
        np.ascontiguousarray(rows[:, first : first + count]),
        np.ascontiguousarray(rows[:, first + count : first + 2 * count]),
    )


def bushings(scene: Scene) -> Array:
    """Stiffness, damping and load (g, 3) of the directions."""
    at = int(scene.tables.offset[8])
    return scene.vector[at : at + L.PIN_SIZE * len(scene.pins)].reshape(-1, L.PIN_SIZE)


def giving_motion(scene: Scene, rows: Array) -> GivingMotion | None:
    """What the joints of a scene give; None where they are rigid."""
    if not scene.pins:
        return None
    way, speed = rows_of_pins(scene, rows)
    number = bushings(scene)
    force = number[:, L.PIN_LOAD] - number[:, L.PIN_K] * way - number[:, L.PIN_C] * speed
    return GivingMotion(tuple(f"{body}_pin_{axis}" for body, axis in scene.pins), way, speed, force)


def tip_forces(scene: Scene, angle_rad: Array, speed_rad_per_s: Array, rows: Array) -> Array:
    """Force (m, b) of the motor arm's tip on a key whose joint gives, N."""
    p, parent = scene.vector, scene.tables.parent
    out = np.zeros((len(angle_rad), len(scene.tables.probe)))
    give, rate = rows_of_pins(scene, rows)
    for k, (tip, key) in enumerate(scene.tables.probe.tolist()):
        o = int(scene.tables.offset[3]) + L.PROBE_SIZE * k
        law = p[o + 4 : o + 8]
        height, speed = np.zeros(len(angle_rad)), np.zeros(len(angle_rad))  # of the key over the tip
        for body, sign, x, y in ((tip, -1.0, p[o], p[o + 1]), (key, 1.0, p[o + 2], p[o + 3])):
            c, s = np.cos(angle_rad[:, body]), np.sin(angle_rad[:, body])
            height += sign * (p[L.GLOBALS + L.BODY_SIZE * body + L.PIVOT_Y] + s * x + c * y)
            speed += sign * (c * x - s * y) * speed_rad_per_s[:, body]
        carrier = int(parent[key])
        if carrier >= 0:
            height += p[L.GLOBALS + L.BODY_SIZE * carrier + L.PIVOT_Y] + angle_rad[:, carrier]
            speed += speed_rad_per_s[:, carrier]
        for g, (body, axis) in enumerate(scene.tables.pin.tolist()):
            if body == key and axis == 1:
                height, speed = height + give[:, g], speed + rate[:, g]
        x = np.maximum(height, 0.0)
        static = np.maximum(((law[0] * x + law[1]) * x + law[2]) * x, 0.0)
        out[:, k] = static * np.maximum(1.0 + law[3] * speed, 0.0)
    return out


def contacts_along(scene: Scene, angle_rad: Array, speed_rad_per_s: Array, rows: Array) -> tuple[Array, Array]:
    """Forces (m, c, 2), normal and friction, N, and depths with their rates (m, c, 2) where joints give."""
    force = np.zeros((len(angle_rad), len(scene.contacts), 2))
    depth = np.zeros_like(force)
    give, rate = rows_of_pins(scene, rows)
    q, v = np.ascontiguousarray(angle_rad), np.ascontiguousarray(speed_rad_per_s)
    giving_contacts_along(q, v, give, rate, scene.vector, scene.tables, force, depth)
    return force, depth
