"""Kinematics: poses and velocities of a tree of revolute joints, vertical guides and compliant pivots.

The pivot of a body whose joint gives is moved to the right and up in the world; that displacement does not turn with
what carries the joint (docs/explanation/effects.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from model.compiler.expressions import ONE, ZERO, Expression, cosine, read, root, sine, total, where
from model.elements.friction import friction
from model.elements.structure import Structure
from model.kernels import layout as L

Vector = tuple[Expression, Expression]


@dataclass
class State:
    """What forces are functions of: coordinates, their speeds, memories, the input.

    Parameters
    ----------
    q, v : of each coordinate: rad or m, and per s
    z : of each memory of felt
    u : input: N, N m, V, m or, where a coordinate is prescribed, s
    """

    q: list[Expression]
    v: list[Expression]
    z: list[Expression] = field(default_factory=list)
    u: Expression = ZERO


@dataclass(frozen=True)
class _Pose:
    """Where a body is: its pivot in the world, m, and how it is turned; how fast it turns."""

    pivot: Vector
    cosine: Expression
    sine: Expression
    turning: Expression
    """Angular speed against the ground, rad/s."""
    ways: dict[int, Vector | None]
    """For each coordinate that moves the body: the point about which it turns the body, or None where it shifts it."""
    rates: dict[int, Expression] = field(default_factory=dict)
    """How fast it turns the body, where that is not as fast as the coordinate itself changes."""
    drift: Expression = ZERO
    """Angular acceleration while no coordinate's speed changes, rad/s^2."""


class Kinematics:
    """Poses of a scene's bodies at a state.

    Parameters
    ----------
    everywhere : friction is to be differentiable by its numbers where they are 0, too
    """

    def __init__(self, s: Structure, state: State, everywhere: bool = False) -> None:
        self.s, self.state = s, state
        self.everywhere = everywhere
        self.friction = friction(everywhere)
        self.per_slide, self.per_turn = (ONE / read("p", k) for k in (L.V_T, L.OMEGA_T))
        self.pose: dict[int, _Pose] = {}
        for i in s.order():
            self.pose[i] = self._body_pose(i)

    def _body_pose(self, i: int) -> _Pose:
        """Pivot, orientation and speed of body ``i`` as expressions, and how each coordinate moves its points."""
        s, q, v = self.s, self.state.q, self.state.v
        w, at = s.parent[i], (s.body(i, L.PIVOT_X), s.body(i, L.PIVOT_Y))
        if i in s.guided:
            return _Pose((at[0], at[1] + q[i]), ONE, ZERO, ZERO, {i: None})
        ways: dict[int, Vector | None] = {}
        if w < 0:
            pivot, angle, speed = at, q[i], v[i]
        else:
            up, turned = self.pose[w], self.to_world_vector(w, *at)
            pivot = (up.pivot[0] + turned[0], up.pivot[1] + turned[1])
            fixed = w in s.guided
            angle, speed = (q[i], v[i]) if fixed else (q[i] + q[w], v[i] + v[w])
            ways = dict(up.ways)
        given = [(q[g], ZERO) if s.axis[g] == 0 else (ZERO, q[g]) for g, body in s.pin.items() if body == i]
        moved = total(d[0] for d in given), total(d[1] for d in given)
        # what carries the joint turns the body about its own pivot moved by what the joint gives
        ways = {k: c and (c[0] + moved[0], c[1] + moved[1]) for k, c in ways.items()}
        pivot = (pivot[0] + moved[0], pivot[1] + moved[1])
        ways |= {g: None for g, body in s.pin.items() if body == i} | {i: pivot}
        if i in s.led:
            return self._lifted_key_pose(i, pivot, ways)
        return _Pose(pivot, cosine(angle), sine(angle), speed, ways)

    def _lifted_key_pose(self, i: int, pivot: Vector, ways: dict[int, Vector | None]) -> _Pose:
        """Pose of a key that can rise, whose coordinate is the angle which a key that cannot would need for the same
        height of its front; adds to ``ways`` how the rise moves its points.

        The front is ``wanted`` above the pivot's place, ``up`` above the pivot, ``across`` beside it: with the rise r
        up = wanted - r, and the key turns at (wanted' - r') / across. A rise turns it about the point under the front.
        """
        s, q, v, rise = self.s, self.state.q, self.state.v, self.s.led[i]
        x, y = s.number(2, L.DRIVE_SIZE, 0, L.DRIVE_X), s.number(2, L.DRIVE_SIZE, 0, L.DRIVE_Y)
        c, sn, square = cosine(q[i]), sine(q[i]), x * x + y * y
        wanted, level = sn * x + c * y, c * x - sn * y
        up = wanted - q[rise]
        across = root(square - up * up) * where(x > 0.0, 1.0, -1.0)
        speed = (level * v[i] - v[rise]) / across
        drift = (up * speed * speed - wanted * v[i] * v[i]) / across
        turned = (across * x + up * y) / square, (up * x - across * y) / square
        ways |= {rise: (pivot[0] + across, pivot[1])}
        return _Pose(pivot, *turned, speed, ways, {rise: -(ONE / across), i: level / across}, drift)

    def rotations(self) -> list[Expression]:
        """Cosines of all bodies that turn."""
        return [pose.cosine for pose in self.pose.values() if pose.cosine is not ONE and not pose.rates]

    def to_world_vector(self, body: int, x: Expression, y: Expression) -> Vector:
        """World components of a vector (x, y) in a body's frame; body -1 is the ground."""
        if body < 0:
            return x, y
        pose = self.pose[body]
        return pose.cosine * x - pose.sine * y, pose.sine * x + pose.cosine * y

    def to_world_point(self, body: int, x: Expression, y: Expression) -> Vector:
        """World position of a point of a body's frame, m."""
        dx, dy = self.to_world_vector(body, x, y)
        return (dx, dy) if body < 0 else (self.pose[body].pivot[0] + dx, self.pose[body].pivot[1] + dy)

    def ways(self, body: int, x: Expression, y: Expression) -> dict[int, Vector]:
        """Velocity (x, y) of the point of ``body`` that is at world position (``x``, ``y``), m, per unit speed of each
        coordinate that moves it; empty for the ground."""
        out: dict[int, Vector] = {}
        for k, centre in (self.pose[body].ways if body >= 0 else {}).items():
            if centre is not None:
                rate = self.pose[body].rates.get(k, ONE)
                out[k] = rate * -(y - centre[1]), rate * (x - centre[0])
            else:
                out[k] = (ONE, ZERO) if self.s.axis[k] == 0 else (ZERO, ONE)
        return out

    def turns(self, body: int) -> dict[int, Expression]:
        """Coordinates that turn a body, and its angular speed per unit speed of each."""
        pose = self.pose[body]
        return {k: pose.rates.get(k, ONE) for k, centre in pose.ways.items() if centre is not None}

    def velocity(self, ways: dict[int, Vector]) -> Vector:
        """Velocity (m/s) of a point from its displacement per unit of each coordinate, ``ways``."""
        v = self.state.v
        return total(way[0] * v[k] for k, way in ways.items()), total(way[1] * v[k] for k, way in ways.items())


def relative_velocities(a: dict[int, Vector], b: dict[int, Vector]) -> dict[int, Vector]:
    """Velocity of point a relative to b per unit speed of each coordinate, from those of both; coordinates that do not
    part them are left out."""
    nothing = (ZERO, ZERO)
    out = {}
    for k in {**a, **b}:
        way = tuple(x - y for x, y in zip(a.get(k, nothing), b.get(k, nothing), strict=True))
        if way != nothing:
            out[k] = (way[0], way[1])
    return out


def dot(a: Vector, b: Vector) -> Expression:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1]
