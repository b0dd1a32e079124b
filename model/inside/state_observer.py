"""Contact forces, accelerations and joint forces at single states of a scene.

World frame: x right, y up.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.codegen import observable_columns as C
from model.codegen.evaluate_observables import bodies_at, contacts_at, tips_at
from model.errors import InputError
from model.scene.build import Scene

Array = NDArray[np.float64]


class Observer:
    """Evaluates states of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def evaluate(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, memory: ArrayLike | None = None) -> ObservedStates:
        """Observed contacts, tips and bodies at angles ``q`` (m, n), rad, speeds ``v`` (m, n), rad/s, and inputs ``u``
        (m,); ``memory`` (m, z): internal variables, needed where the scene has any.

        Raises
        ------
        InputError : arrays of other shapes, or a scene that remembers without its rows
        """
        angle, speed = as_numbers(q, "states: angles", 2), as_numbers(v, "states: speeds", 2)
        value = as_numbers(u, "states: input", 1)
        if len(value) != len(angle):
            raise InputError(f"states: found {len(angle)} angles and {len(value)} inputs, allowed as many")
        rows = None if memory is None else as_numbers(memory, "states: memories", 2)
        return ObservedStates(self.scene, (angle, speed), value, rows)


class ObservedStates:
    """Contacts, motion of the bodies and forces of the joints at states (m, n) under inputs (m,).

    Attributes
    ----------
    contact : (m, c, 11) per contact, columns `NORMAL` to `RATE` of `model.codegen.observable_columns`
    tip : (m, b, 3) force of each one-sided tip, N, power lost in it, W, its depth, m
    body : (m, n, 16) columns `PIVOT_X` to `HELD` there
    """

    def __init__(self, scene: Scene, states: tuple[Array, Array], value: Array, memory: Array | None) -> None:
        tables, p = scene.tables, scene.vector
        self._given = tables, p, states, memory, value
        self.contact, self.tip = contacts_at(tables, p, *states, memory), tips_at(tables, p, *states, memory)

    @cached_property
    def body(self) -> Array:
        """Columns of the bodies (m, n, 16), computed at first use."""
        return bodies_at(*self._given)

    @property
    def turning(self) -> Array:
        """Angular acceleration from ground (m, n), rad/s^2."""
        return self.body[:, :, C.TURNED]

    @property
    def velocity(self) -> Array:
        """Of the centres of mass (m, n, 2), m/s."""
        return self.body[:, :, C.VX : C.VY + 1]

    @property
    def acceleration(self) -> Array:
        """Of the centres of mass (m, n, 2), m/s^2."""
        return self.body[:, :, C.AX : C.AY + 1]

    def poses(self) -> Array:
        """Pivot x, y (m) and orientation from ground (rad) of each body, (m, n, 3)."""
        return self.body[:, :, C.PIVOT_X : C.ANGLE + 1]

    def joint_forces(self) -> Array:
        """Force (m, n, 2) on each body in the joint that carries it, N.

        Friction, springs and damping of a joint are torques and do not enter.
        """
        return self.body[:, :, C.JOINT_X : C.JOINT_Y + 1]
