"""Side view of the action from the model's own geometry: contact surfaces, pivots and the bodies that connect them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.inside.body_poses import SeenMotion
from model.kernels import layout as L
from model.scene.build import Scene
from model.simulation.loads_and_losses import Inside

Array = NDArray[np.float64]

WHOLE_CIRCLE_M = 0.008  # circles up to this radius are drawn whole
MARGIN_RAD, MARGIN_M = 0.25, 0.004  # drawn beyond what the motion meets
CORNERS = 33  # of a drawn circle or arc: off by half a per cent of the radius
NEAR_M = 0.006  # a surface counts as met while its gap is below this
GROUND = "ground"


@dataclass(frozen=True)
class Shape:
    """A curve of a body: (k, 2) points in its frame, m."""

    points: Array
    contact: str


@dataclass(frozen=True)
class SideView:
    """Curves to draw, by body (including ``ground``)."""

    surfaces: dict[str, list[Shape]]  # curves of contact surfaces
    sticks: dict[str, Array]  # pairs of points (k, 2, 2) that make the stick figure; none for the ground


def side_view(inside: Inside | SeenMotion) -> SideView:
    """Curves of contact surfaces, by body (also ``ground``), and stick figures as pairs of points (k, 2, 2), both in
    the frame of each body, m, near where the motion touches them."""
    scene = inside.scene
    bodies = (*inside.bodies, GROUND)
    surfaces: dict[str, list[Shape]] = {body: [] for body in bodies}
    marks: dict[str, list[Array]] = {body: [np.zeros(2)] for body in inside.bodies}
    for c, name in enumerate(inside.contacts):
        for k, surface in enumerate(_surfaces(scene, c)):
            body = bodies[int(scene.tables.contact[c, k])]  # -1, the ground, is the last
            met = _to_body_frame(inside, body, inside.point_m[:, c])[_rows_near_contact(inside, c)]
            curve = surface.curve(met)
            surfaces[body].append(Shape(curve, name))
            if body != GROUND:
                marks[body].append(curve.mean(axis=0) if surface.is_closed else curve[len(curve) // 2])
    for i, parent in enumerate(scene.tables.parent):
        if parent >= 0:
            o = L.GLOBALS + L.BODY_SIZE * i
            marks[inside.bodies[parent]].append(scene.vector[o + L.PIVOT_X : o + L.PIVOT_Y + 1])
    o = int(scene.tables.offset[2])
    for kind, i in scene.tables.drive:
        if kind == L.FORCE_DOWN:
            marks[inside.bodies[i]].append(scene.vector[o + L.DRIVE_X : o + L.DRIVE_Y + 1])
        o += L.DRIVE_SIZE
    o = int(scene.tables.offset[3])
    for upper, lower in scene.tables.probe:
        marks[inside.bodies[upper]].append(scene.vector[o : o + 2])
        marks[inside.bodies[lower]].append(scene.vector[o + 2 : o + 4])
        o += L.PROBE_SIZE
    return SideView(surfaces, {body: _shortest_tree(np.array(points)) for body, points in marks.items()})


def _rows_near_contact(inside: Inside | SeenMotion, c: int) -> NDArray[np.bool_]:
    """Mask (m,) of output times at which the surfaces of the c-th contact are near; if never, of the nearest."""
    depth = inside.penetration_m[:, c]
    near = depth > -NEAR_M
    return near if near.any() else depth == depth.max()


def _to_body_frame(inside: Inside | SeenMotion, body: str, point: Array) -> Array:
    """World points (m, 2), m, in the frame of ``body`` as it is posed at each of the m times."""
    if body == GROUND:
        return point
    pose = inside.pose[:, inside.bodies.index(body)]
    away = point - pose[:, :2]
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.stack([c * away[:, 0] + s * away[:, 1], -s * away[:, 0] + c * away[:, 1]], axis=1)


@dataclass(frozen=True)
class _Surface:
    """A circle, line or arc with tangents in its body's frame: base point, radius, normal or both ends (rad)."""

    base: Array
    radius: float
    normal: Array | None = None
    ends: tuple[float, float] | None = None

    @property
    def is_closed(self) -> bool:
        return self.normal is None and self.radius <= WHOLE_CIRCLE_M

    def curve(self, met: Array) -> Array:
        """Points (j, 2), m, of the surface near the touched points ``met`` (k, 2), m."""
        if self.normal is not None:
            along = np.array([-self.normal[1], self.normal[0]])
            ways = (met - self.base) @ along
            line: Array = (
                self.base + np.array([[ways.min() - MARGIN_M], [ways.mean()], [ways.max() + MARGIN_M]]) * along
            )
            return line
        angle = np.linspace(0.0, 2.0 * np.pi, CORNERS)
        if not self.is_closed:
            direction = np.unwrap(np.arctan2(met[:, 1] - self.base[1], met[:, 0] - self.base[0]))
            angle = np.linspace(direction.min() - MARGIN_RAD, direction.max() + MARGIN_RAD, CORNERS)
        within = angle if self.ends is None else np.clip(angle, *self.ends)  # tangents beyond an arc's ends
        over = self.radius * np.tan(np.clip(angle - within, -1.0, 1.0))
        out = np.stack([np.cos(within), np.sin(within)], axis=1)
        along = np.stack([-np.sin(within), np.cos(within)], axis=1)
        points: Array = self.base + self.radius * out + over[:, None] * along
        return points


def _surfaces(scene: Scene, c: int) -> tuple[_Surface, _Surface]:
    """Surfaces of contact ``c``, of its first and its second body (`tables.contact`), each in that body's frame, m."""
    p = scene.vector[int(scene.tables.offset[1]) + L.CONTACT_SIZE * c :]
    first = _Surface(p[L.A_X : L.A_Y + 1], float(p[L.A_R]))
    base, radius, shape = p[L.B_X : L.B_Y + 1], float(p[L.B_R]), scene.tables.contact[c, 2]
    if shape == L.LINE:
        return first, _Surface(base, 0.0, normal=p[L.N_X : L.N_Y + 1])
    if shape == L.HYBRID:
        start, end = np.unwrap([np.arctan2(p[L.N_Y], p[L.N_X]), np.arctan2(p[L.E_Y], p[L.E_X])])
        return first, _Surface(base, radius, ends=(float(start), float(end)))
    return first, _Surface(base, radius)


def _shortest_tree(points: Array) -> Array:
    """Shortest tree through points (k, 2) as pairs (k - 1, 2, 2), grown from the first."""
    joined, left = [0], list(range(1, len(points)))
    pairs: list[Sequence[Array]] = []
    while left:
        away = np.hypot(*(points[joined][:, None] - points[left][None]).transpose(2, 0, 1))
        i, k = np.unravel_index(int(np.argmin(away)), away.shape)
        pairs.append((points[joined[i]], points[left[k]]))
        joined.append(left.pop(int(k)))
    return np.array(pairs).reshape(-1, 2, 2)
