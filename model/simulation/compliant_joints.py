"""Compliant joints of a run: their motion at the output times, and the force of their bushings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.kernels import layout as L
from model.scene.build import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CompliantJointMotion:
    """Displacements of compliant joints at the output times."""

    directions: tuple[str, ...]  # (g,) such as ``hammer_pin_x``: which joint, to the right (x) or up (y)
    way_m: Array  # (m, g) how far the pivot of the body is from its place in the set
    speed_m_per_s: Array  # (m, g)
    force_n: Array  # (m, g) force of the bushing on the body

    def joint_motion(self, body: str) -> tuple[Array, Array]:
        """Displacement and speed (m, 2) of the joint of ``body``, m and m/s, right and up; zero where rigid."""
        way, speed = np.zeros((len(self.way_m), 2)), np.zeros((len(self.way_m), 2))
        for k, axis in enumerate("xy"):
            if f"{body}_pin_{axis}" in self.directions:
                i = self.directions.index(f"{body}_pin_{axis}")
                way[:, k], speed[:, k] = self.way_m[:, i], self.speed_m_per_s[:, i]
        return way, speed

    def columns(self) -> dict[str, Array]:
        """Columns by name: displacements, m, then forces, N."""
        out = {f"{name}_m": self.way_m[:, i] for i, name in enumerate(self.directions)}
        return out | {f"{name}_n": self.force_n[:, i] for i, name in enumerate(self.directions)}


def pin_motion(scene: Scene, rows: Array) -> tuple[Array, Array]:
    """Displacements (m, g), m, and speeds (m, g), m/s, of compliant joint directions, from rows (m, z)."""
    first, count = len(scene.tables.memory), len(scene.pins)
    return (
        np.ascontiguousarray(rows[:, first : first + count]),
        np.ascontiguousarray(rows[:, first + count : first + 2 * count]),
    )


def bushing_parameters(scene: Scene) -> Array:
    """Stiffness, damping and load (g, 3) of the directions."""
    at = int(scene.tables.offset[8])
    return scene.vector[at : at + L.PIN_SIZE * len(scene.pins)].reshape(-1, L.PIN_SIZE)


def compliant_joint_motion(scene: Scene, rows: Array) -> CompliantJointMotion | None:
    """Displacement (m), speed (m/s) and force (N) of a scene's compliant joint directions, from rows (m, z) of internal
    variables; None where joints are rigid."""
    if not scene.pins:
        return None
    way, speed = pin_motion(scene, rows)
    number = bushing_parameters(scene)
    force = number[:, L.PIN_LOAD] - number[:, L.PIN_K] * way - number[:, L.PIN_C] * speed
    return CompliantJointMotion(scene.coordinates[len(scene.bodies) :], way, speed, force)
