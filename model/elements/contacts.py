"""Contacts of two surfaces: a circle on body A against a circle, a line, or an arc with tangents on body B.

The gap's normal points from B to A. Force acts at mid-penetration; the felt follows a law of `model.elements.laws`,
friction opposes sliding (thesis Section 2.2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from model.compiler.expressions import (
    ZERO,
    Arguments,
    Expression,
    differentiate_once,
    intern,
    maximum,
    minimum,
    root,
    subexpressions,
    total,
    where,
)
from model.compiler.programs import Accumulate, Assign, If, Statement, variable
from model.elements.kinematics import Kinematics, Vector, dot, relative_velocities
from model.elements.laws.curve import Curve
from model.elements.laws.felt_law import Felt, Law, checked_force, evaluate_law
from model.elements.structure import Structure
from model.kernels import layout as L


def _select_by_side(on_start: Expression, on_end: Expression, start: Any, end: Any, arc: Any) -> Expression:
    return where(on_start, start, where(on_end, end, arc))


@differentiate_once
def circle_gap(given: Arguments, reach: Expression) -> tuple[Expression, ...]:
    """Depth (m) and normal of two circles; (ux, uy) between centres, radii add up to ``reach``."""
    ux, uy = given
    distance = root(ux * ux + uy * uy)
    inverse = where(distance > 0.0, 1.0 / distance, 0.0)
    return reach - distance, ux * inverse, uy * inverse


def _find_nearest_tangent(given: Arguments) -> tuple[Expression, ...]:
    """Whether the tangent at an arc's start, or at its end, is the nearest; the distances from both."""
    ux, uy, sx, sy, ex, ey = given
    before, behind = ux * sy - uy * sx > 0.0, ex * uy - ey * ux > 0.0
    from_start, from_end = ux * sx + uy * sy, ux * ex + uy * ey
    on_start = before & (~behind | (from_start >= from_end))
    return on_start, behind & ~on_start, from_start, from_end


@differentiate_once
def hybrid_gap(given: Arguments, reach: Expression) -> tuple[Expression, ...]:
    """Gap and normal against an arc from direction s to e whose tangents run on at both ends."""
    ux, uy, sx, sy, ex, ey = given
    on_start, on_end, from_start, from_end = _find_nearest_tangent(given)
    x, nx, ny = circle_gap((ux, uy), reach)
    ends = ((reach - from_start, reach - from_end, x), (sx, ex, nx), (sy, ey, ny))
    return tuple(_select_by_side(on_start, on_end, *row) for row in ends)


@dataclass
class Contact:
    """Contact ``c`` of a scene at a state."""

    s: Structure
    k: Kinematics
    c: int

    def number(self, k: int) -> Expression:
        return self.s.number(1, L.CONTACT_SIZE, self.c, k)

    @property
    def curve(self) -> Curve:
        """Numbers of the felt's loading curve."""
        return self.number(L.K_A), self.number(L.K_B), self.number(L.K_C)

    @cached_property
    def _relative_geometry(self) -> tuple[Vector, Arguments, Expression]:
        """World centre of A's circle; (ux, uy) from B's base point to it with B's direction vectors (a line's normal;
        an arc's start and end) turned to the world; sum of the radii, m."""
        a, b, _, _ = self.s.contact[self.c]
        n = self.number
        centre = self.k.to_world_point(a, n(L.A_X), n(L.A_Y))
        other = self.k.to_world_point(b, n(L.B_X), n(L.B_Y))
        start, end = self.k.to_world_vector(b, n(L.N_X), n(L.N_Y)), self.k.to_world_vector(b, n(L.E_X), n(L.E_Y))
        return centre, (centre[0] - other[0], centre[1] - other[1], *start, *end), n(L.A_R) + n(L.B_R)

    @cached_property
    def gap(self) -> tuple[Expression, Vector]:
        """Depth, m, positive where the surfaces overlap, negative where open, and the unit normal (x, y) in the world,
        which points from B to A."""
        shape = self.s.contact[self.c][2]
        _, given, reach = self._relative_geometry
        if shape == L.LINE:
            ux, uy, nx, ny, *_ = given
            return self.number(L.A_R) - (ux * nx + uy * ny), (nx, ny)
        x, nx, ny = circle_gap(given[:2], reach) if shape == L.CIRCLE else hybrid_gap(given, reach)
        return x, (nx, ny)

    @cached_property
    def touches(self) -> Expression:
        """Condition that the surfaces overlap, without a square root."""
        shape = self.s.contact[self.c][2]
        _, given, reach = self._relative_geometry
        near = given[0] * given[0] + given[1] * given[1] < reach * reach
        if shape == L.LINE:
            return self.gap[0] > 0.0
        if shape == L.CIRCLE:
            return near
        on_start, on_end, from_start, from_end = _find_nearest_tangent(given)
        on_arc = ~(on_start | on_end) & near
        return (on_start & (from_start < reach)) | (on_end & (from_end < reach)) | on_arc

    def is_off_arc(self) -> Expression:
        """Whether a tangent of a hybrid surface is nearer than its arc."""
        on_start, on_end, *_ = _find_nearest_tangent(self._relative_geometry[1])
        return on_start | on_end

    def clearance(self) -> Expression:
        """Distance (m) by which the surfaces can approach before they can touch; 0 in contact.

        Behind an arc's centre the rule that picks arc or tangent jumps across the extensions of its end radii.
        """
        x, _ = self.gap
        if self.s.contact[self.c][2] != L.HYBRID:
            return maximum(-x, 0.0)
        ux, uy, sx, sy, ex, ey = self._relative_geometry[1]
        distance = root(ux * ux + uy * uy)
        jumps = [
            where(out < 0.0, abs(across), distance)
            for out, across in ((ux * sx + uy * sy, uy * sx - ux * sy), (ux * ex + uy * ey, ex * uy - ey * ux))
        ]
        return maximum(minimum(-x, minimum(*jumps)), 0.0)

    def point(self, depth: Expression) -> Vector:
        """World position at which the force acts."""
        centre, (_, (nx, ny)) = self._relative_geometry[0], self.gap
        r = self.number(L.A_R) - 0.5 * depth
        return centre[0] - r * nx, centre[1] - r * ny

    def _point_velocity(self, x: Expression, y: Expression) -> dict[int, Vector]:
        a, b, _, _ = self.s.contact[self.c]
        return relative_velocities(self.k.ways(a, x, y), self.k.ways(b, x, y))

    @cached_property
    def ways(self) -> dict[int, Vector]:
        """Velocity of A against B at mid-penetration per unit speed of each coordinate that changes it."""
        return self._point_velocity(*self.point(self.gap[0]))

    @cached_property
    def relative_speeds(self) -> tuple[Expression, Expression]:
        """Rate of the depth and sliding speed, m/s."""
        (vx, vy), (_, (nx, ny)) = self.k.velocity(self.ways), self.gap
        return -(vx * nx + vy * ny), vy * nx - vx * ny

    def turns(self) -> dict[int, Expression]:
        """Change of the gap per unit speed of each coordinate, at mid-penetration."""
        return {k: dot(way, self.gap[1]) for k, way in self.ways.items()}

    def slides(self) -> dict[int, Expression]:
        """Sliding speed per unit speed of each coordinate."""
        _, (nx, ny) = self.gap
        return {k: way[1] * nx - way[0] * ny for k, way in self.ways.items()}

    def open_turns(self) -> dict[int, Expression]:
        """Change of an open gap per unit speed of each coordinate."""
        return {k: dot(way, self.gap[1]) for k, way in self._point_velocity(*self._relative_geometry[0]).items()}

    def coefficient(self) -> Expression:
        """Friction coefficient at the sliding speed."""
        laws = (self.number(k) for k in (L.MU_A, L.MU_B1, L.MU_B2))
        out: Expression = self.k.friction((self.relative_speeds[1],), self.k.per_slide, *laws)
        return out

    # the felt ------------------------------------------------------------------------------------------------------

    @property
    def memories(self) -> list[int]:
        """Indices of the internal variables of this contact's felt."""
        return self.s.memories(self.c)

    @property
    def law(self) -> Law:
        return self.s.law(self.c)

    def pressed_by(self, depth: Expression, rate: Expression) -> Felt:
        z = tuple(self.k.state.z[m] for m in self.memories)
        return Felt(depth, rate, z, self.curve, self.number(L.DAMP), self.s.law_numbers(self.c))

    @cached_property
    def felt(self) -> tuple[Expression, Expression]:
        """Whether the felt presses where the surfaces meet, and its force, N."""
        return checked_force(self.law, self.pressed_by(self.gap[0], self.relative_speeds[0]))

    def _rates(self, of: Callable[[Felt], Sequence[Expression]]) -> list[Statement]:
        """Rates of its memories, as the law says of felt that presses or of felt that does not."""
        if not self.memories:
            return []
        rates = evaluate_law(of, self.pressed_by(self.gap[0], self.relative_speeds[0]))
        return [Assign(variable(f"fade{m}"), rate) for m, rate in zip(self.memories, rates, strict=True)]

    def branch_conditions(self) -> list[Expression]:
        """Conditions of all branches (`where`) that the felt's law takes, in the order in which they were made."""
        felt = self.pressed_by(self.gap[0], self.relative_speeds[0])
        said = [
            *evaluate_law(self.law.force, felt),
            *evaluate_law(self.law.rates, felt),
            *evaluate_law(self.law.recovery_rates, felt),
        ]
        found = {one.args[0] for one in subexpressions(said, [felt.depth, felt.rate]) if one.op == "where"}
        return sorted(found, key=lambda one: one.order)

    def world(self, force: Expression, coefficient: Expression) -> Vector:
        """Force on A in the world, N, of a normal force and its friction."""
        _, (nx, ny) = self.gap
        rub = coefficient * force
        return force * nx + rub * ny, force * ny - rub * nx

    def push(self, force: Expression, coefficient: Expression) -> dict[int, Expression]:
        """Generalised forces of a normal force and its friction."""
        world = self.world(force, coefficient)
        return {k: dot(way, world) for k, way in self.ways.items() if k in self.s.solved}

    def contact_statements(self) -> list[Statement]:
        """Statements for surfaces in contact: normal and friction forces, added to the generalised forces ``f0``, …,
        where felt presses, and rates of internal variables."""
        pressing, force = self.felt
        rubbing, smooth = (
            [Accumulate(variable(f"f{k}"), e) for k, e in self.push(force, mu).items()]
            for mu in (self.coefficient(), ZERO)
        )
        rubs = intern("differs", self.number(L.MU_A), ZERO)  # most contacts have no friction
        pushed: list[Statement] = list(rubbing) if self.k.everywhere else [If(rubs, list(rubbing), list(smooth))]
        return [If(pressing, [*self._rates(self.law.rates), *pushed])]

    def forces(self) -> list[Statement]:
        """Generalised forces, and the rate of each memory as ``fade``."""
        return [*self._rates(self.law.recovery_rates), If(self.touches, self.contact_statements())]

    def stiffness(self, rate: Expression) -> Expression:
        """Force per depth that a first touch at a rate (m/s) brings at once, N/m."""
        return self.law.stiffness(self.pressed_by(ZERO, rate))

    def energy(self, label: str = "") -> list[Statement]:
        """Statements that add stored energy (J) to ``energy`` and powers lost (W) to ``felt`` (``rail`` for the rail's
        felt) and ``friction``, variables whose names end with ``label``."""
        lasting = bool(self.memories) and self.law.anew is None
        x, (rate, slide) = self.gap[0], self.relative_speeds
        felt = self.pressed_by(where(self.touches, x, 0.0) if lasting else x, rate)
        before, stored, lost = self.law.energy(felt, f"{self.c}{label}")
        loss = variable(("rail" if self.c in self.s.rail else "felt") + label)
        own = [*before, Accumulate(variable("energy" + label), stored), Accumulate(loss, lost)]
        pressing, force = self.felt
        rub = If(pressing, [Accumulate(variable("friction" + label), self.coefficient() * force * slide)])
        return [*own, If(self.touches, [rub])] if lasting else [If(self.touches, [*own, rub])]


def largest_acceleration(turns: dict[int, Expression], inverse_inertia: dict[int, Expression]) -> Expression:
    """The largest acceleration of one coordinate that a unit force along a direction gives."""
    found = [abs(turn) * inverse_inertia[k] for k, turn in turns.items() if k in inverse_inertia]
    return maximum(*found) if found else ZERO


def rate_along(turns: dict[int, Expression], rates: list[Expression]) -> Expression:
    """Sum of ``turns`` times ``rates`` over all coordinates: the rate along a direction."""
    return total(turn * rates[k] for k, turn in turns.items())
