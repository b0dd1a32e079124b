"""Where the two surfaces of a contact are at a state of the action, whether or not the contact has any stiffness.

Geometry alone, from an `Action` and its five angles; points and directions are complex numbers in the world frame,
x right, y up. Raises nothing: every contact of an action has a gap.
"""

from __future__ import annotations

import cmath
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from model.parameters.action import BODIES, Action


class Gap(NamedTuple):
    """Penetration (m, negative where open), normal from second to first surface, centre of the first circle (m)."""

    penetration_m: float
    normal: complex
    center: complex


def _vector(action: Action, path: str) -> complex:
    return complex(action[f"{path}.x"], action[f"{path}.y"])


def contact_gap(action: Action, contact: str, angle_rad: ArrayLike) -> Gap:
    """Gap of a contact at the angles (5,) rad."""
    frames = {"ground": (0j, 0.0)}  # pivot and angle of each body from ground
    for body, angle in zip(BODIES, np.asarray(angle_rad, dtype=float), strict=True):
        pivot, turned = frames[action.structure[f"{body}.parent"]]
        frames[body] = pivot + cmath.rect(1.0, turned) * _vector(action, f"{body}.pivot"), turned + float(angle)

    def place(side: str) -> tuple[complex, float]:
        pivot, turned = frames[action.structure[f"{contact}.{side}.body"]]
        return pivot + cmath.rect(1.0, turned) * _vector(action, f"{contact}.{side}"), turned

    (center, _), (base, turned) = place("first"), place("second")
    apart, radius = center - base, action[f"{contact}.first.radius"]

    def along(direction: complex) -> float:
        return (apart * direction.conjugate()).real

    shape = action.structure[f"{contact}.second.shape"]
    if shape == "line":
        normal = _vector(action, f"{contact}.second.normal")
        normal *= cmath.rect(1.0, turned) / abs(normal)
        return Gap(radius - along(normal), normal, center)
    radius += action[f"{contact}.second.radius"]
    if shape == "hybrid":  # an arc that goes on as its tangents
        start, end = (cmath.rect(1.0, turned + action[f"{contact}.second.arc_{k}"]) for k in ("start", "end"))
        beyond = [e for e, tangent in ((start, -1j * start), (end, 1j * end)) if along(tangent) > 0.0]
        if beyond:
            normal = max(beyond, key=along)
            return Gap(radius - along(normal), normal, center)
    return Gap(radius - abs(apart), apart / abs(apart), center)
