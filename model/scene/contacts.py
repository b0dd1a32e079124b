"""Contacts of a scene: their parameters, the coordinates that move one surface against the other, bounds on their gaps.

Used by `model.scene.build`. A tree of joints is given by ``parent`` (index of each body's parent; `GROUND` or `GUIDED`
where it has none) and ``pivot`` (position of each joint in the parent's frame).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from model.elements.laws.known import LAWS
from model.kernels import layout as L
from model.parameters.action import Action
from model.parameters.effects import RAIL, SHANK
from model.scene.effect_terms import LARGEST_LIFT, ON_THE_HEAD, rail_contact

SHAPES = {"circle": L.CIRCLE, "line": L.LINE, "hybrid": L.HYBRID}


class Contact(NamedTuple):
    """A circle of body ``first`` on a surface of body ``second``, and its numbers up to `L.REACH`."""

    first: str
    second: str
    shape: int
    numbers: list[float]


def read_contact(action: Action, name: str, has_flexible_shank: bool) -> Contact:
    """A contact of the action, or the balance rail's; with a flexible shank, what lies on the head belongs to the
    shank's body and frame."""
    if name == RAIL:
        return Contact("key", "ground", L.LINE, rail_contact(action))
    first, second = (action.structure[f"{name}.{side}.body"] for side in ("first", "second"))
    numbers = _contact_numbers(action, name)
    if has_flexible_shank and name in ON_THE_HEAD:
        at = L.A_X if first == "hammer" else L.B_X
        numbers[at] -= action["shank.hinge.x"]
        numbers[at + 1] -= action["shank.hinge.y"]
        first, second = (SHANK if body == "hammer" else body for body in (first, second))
    return Contact(first, second, SHAPES[action.structure[f"{name}.second.shape"]], numbers)


def _contact_numbers(action: Action, name: str) -> list[float]:
    """Parameters of a contact in the order of the kernels: first circle, second surface, felt, friction."""
    first, second = f"{name}.first", f"{name}.second"
    shape = action.structure[f"{second}.shape"]
    numbers = [action[f"{first}.{k}"] for k in ("x", "y", "radius")] + [action[f"{second}.{k}"] for k in ("x", "y")]
    if shape == "line":
        nx, ny = action[f"{second}.normal.x"], action[f"{second}.normal.y"]
        length = math.hypot(nx, ny)  # printed with three digits: back to unit length
        numbers += [0.0, nx / length, ny / length, 0.0, 0.0]
    elif shape == "hybrid":
        start, end = action[f"{second}.arc_start"], action[f"{second}.arc_end"]
        numbers += [action[f"{second}.radius"], math.cos(start), math.sin(start), math.cos(end), math.sin(end)]
    else:
        numbers += [action[f"{second}.radius"], 0.0, 0.0, 0.0, 0.0]
    numbers += [action[f"{name}.normal.{k}"] for k in ("a", "b", "c", "D")]
    numbers += [action[f"{name}.friction.{k}"] for k in ("A", "B1", "B2")]
    return numbers


def law_of_contact(action: Action, name: str, numbers: list[float]) -> tuple[int, list[float]]:
    """Number of internal variables of contact ``name`` and its law's packed numbers; sets the damping D in ``numbers``,
    those of the contact, to 0 for laws without it."""
    law = LAWS[action.law(name)]
    values = {k: action[f"{name}.{law.name}.{k}"] for k in law.numbers}
    if not law.damped:
        numbers[L.DAMP] = 0.0
    a, b, c = numbers[L.K_A : L.K_C + 1]
    count, packed = law.pack_numbers(name, values, (a, b, c))
    return count, list(packed)


def _ancestry(parent: list[int], body: int) -> list[int]:
    out = []
    while body >= 0:
        out.append(body)
        body = parent[body]
    return out


def chain_of(parent: list[int], a: int, b: int) -> list[int]:
    """Coordinates that move body ``a`` against ``b``; joints common to both drop out."""
    on_a, on_b = _ancestry(parent, a), _ancestry(parent, b)
    return [i for i in on_a if i not in on_b] + [i for i in on_b if i not in on_a]


def reach_of(parent: list[int], pivot: list[complex], a: int, point: complex, b: int) -> float:
    """Largest distance (m) the point of body ``a`` can have from the pivot of ``b``, at any angles.

    A gap is a distance between a point on A and a surface on B, so it changes by at most this per radian of joint
    ``b``; by 1 m per metre of a guide.
    """
    if parent[b] == L.GUIDED:
        return 1.0
    up_a, up_b = _ancestry(parent, a), _ancestry(parent, b)
    on_a = [i for i in up_a if i not in up_b]
    on_b = [i for i in up_b if i not in up_a]
    if b in up_a:
        return abs(point) + sum(abs(pivot[i]) for i in up_a[: up_a.index(b)])
    # both chains end in the frame of the nearest common body, where their fixed points are compared
    here, length = point, LARGEST_LIFT if any(parent[i] == L.GUIDED for i in (*on_a, *on_b)) else 0.0
    for i in on_a:
        length += abs(here)
        here = pivot[i]
    there = pivot[on_b[-1]]
    return length + abs(here - there) + sum(abs(pivot[i]) for i in on_b[:-1])
