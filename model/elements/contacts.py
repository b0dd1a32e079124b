"""Contacts of two surfaces: a circle on body A against a circle, a line, or an arc with tangents on body B.

The gap's normal points from B to A. Force acts at mid-penetration; the felt's law is Hunt and Crossley's, Stulov's or
one with hysteresis, friction opposes sliding (thesis Section 2.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from model.compiler.expressions import ZERO, Expression, Given, largest, law, make, root, smaller, total, where
from model.compiler.programs import Add, If, Put, Statement, name
from model.elements import felts
from model.elements.kinematics import Kinematics, Vector, apart, dot
from model.elements.structure import Structure
from model.kernels import layout as L


def _chosen(on_start: Expression, on_end: Expression, start: Any, end: Any, arc: Any) -> Expression:
    return where(on_start, start, where(on_end, end, arc))


@law
def circle_gap(given: Given, reach: Expression) -> tuple[Expression, ...]:
    """Depth (m) and normal of two circles; (ux, uy) between centres, radii add up to ``reach``."""
    ux, uy = given
    distance = root(ux * ux + uy * uy)
    inverse = where(distance > 0.0, 1.0 / distance, 0.0)
    return reach - distance, ux * inverse, uy * inverse


def _sides(given: Given) -> tuple[Expression, ...]:
    """Whether the tangent at an arc's start, or at its end, is the nearest; the distances from both."""
    ux, uy, sx, sy, ex, ey = given
    before, behind = ux * sy - uy * sx > 0.0, ex * uy - ey * ux > 0.0
    from_start, from_end = ux * sx + uy * sy, ux * ex + uy * ey
    on_start = before & (~behind | (from_start >= from_end))
    return on_start, behind & ~on_start, from_start, from_end


@law
def hybrid_gap(given: Given, reach: Expression) -> tuple[Expression, ...]:
    """The same against an arc from direction s to e whose tangents run on at both ends."""
    ux, uy, sx, sy, ex, ey = given
    on_start, on_end, from_start, from_end = _sides(given)
    x, nx, ny = circle_gap((ux, uy), reach)
    ends = ((reach - from_start, reach - from_end, x), (sx, ex, nx), (sy, ey, ny))
    return tuple(_chosen(on_start, on_end, *row) for row in ends)


@dataclass
class Contact:
    """Contact ``c`` of a scene at a state."""

    s: Structure
    k: Kinematics
    c: int

    def number(self, k: int) -> Expression:
        """Number ``k`` of the contact."""
        return self.s.number(1, L.CONTACT_SIZE, self.c, k)

    @property
    def curve(self) -> felts.Curve:
        """Numbers of the felt's loading curve."""
        return self.number(L.K_A), self.number(L.K_B), self.number(L.K_C)

    @cached_property
    def _between(self) -> tuple[Vector, Given, Expression]:
        """Centre of A; way from B's centre, then the directions of B's surface; the reach."""
        a, b, _, _ = self.s.contact[self.c]
        n = self.number
        centre = self.k.at(a, n(L.A_X), n(L.A_Y))
        other = self.k.at(b, n(L.B_X), n(L.B_Y))
        start, end = self.k.along(b, n(L.N_X), n(L.N_Y)), self.k.along(b, n(L.E_X), n(L.E_Y))
        return centre, (centre[0] - other[0], centre[1] - other[1], *start, *end), n(L.A_R) + n(L.B_R)

    @cached_property
    def gap(self) -> tuple[Expression, Vector]:
        """Depth, m, negative where open, and the normal."""
        shape = self.s.contact[self.c][2]
        _, given, reach = self._between
        if shape == L.LINE:
            ux, uy, nx, ny, *_ = given
            return self.number(L.A_R) - (ux * nx + uy * ny), (nx, ny)
        x, nx, ny = circle_gap(given[:2], reach) if shape == L.CIRCLE else hybrid_gap(given, reach)
        return x, (nx, ny)

    @cached_property
    def touches(self) -> Expression:
        """Whether the surfaces meet, with no root where they do not."""
        shape = self.s.contact[self.c][2]
        _, given, reach = self._between
        near = given[0] * given[0] + given[1] * given[1] < reach * reach
        if shape == L.LINE:
            return self.gap[0] > 0.0
        if shape == L.CIRCLE:
            return near
        on_start, on_end, from_start, from_end = _sides(given)
        on_arc = ~(on_start | on_end) & near
        return (on_start & (from_start < reach)) | (on_end & (from_end < reach)) | on_arc

    def beside_the_arc(self) -> Expression:
        """Whether a tangent of a hybrid surface is nearer than its arc."""
        on_start, on_end, *_ = _sides(self._between[1])
        return on_start | on_end

    def room(self) -> Expression:
        """How far the surfaces can come closer before they may touch, m; 0 where they do.

        Behind an arc's centre the rule that picks arc or tangent jumps across the extensions of its end radii.
        """
        x, _ = self.gap
        if self.s.contact[self.c][2] != L.HYBRID:
            return largest(-x, 0.0)
        ux, uy, sx, sy, ex, ey = self._between[1]
        distance = root(ux * ux + uy * uy)
        jumps = [
            where(out < 0.0, abs(across), distance)
            for out, across in ((ux * sx + uy * sy, uy * sx - ux * sy), (ux * ex + uy * ey, ex * uy - ey * ux))
        ]
        return largest(smaller(-x, smaller(*jumps)), 0.0)

    def point(self, depth: Expression) -> Vector:
        """World position at which the force acts."""
        centre, (_, (nx, ny)) = self._between[0], self.gap
        r = self.number(L.A_R) - 0.5 * depth
        return centre[0] - r * nx, centre[1] - r * ny

    def _apart(self, x: Expression, y: Expression) -> dict[int, Vector]:
        a, b, _, _ = self.s.contact[self.c]
        return apart(self.k.ways(a, x, y), self.k.ways(b, x, y))

    @cached_property
    def ways(self) -> dict[int, Vector]:
        """Velocity of A against B at mid-penetration per unit speed of each coordinate that changes it."""
        return self._apart(*self.point(self.gap[0]))

    @cached_property
    def closing(self) -> tuple[Expression, Expression]:
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
        return {k: dot(way, self.gap[1]) for k, way in self._apart(*self._between[0]).items()}

    def coefficient(self) -> Expression:
        """Friction coefficient at the sliding speed."""
        laws = (self.number(k) for k in (L.MU_A, L.MU_B1, L.MU_B2))
        out: Expression = self.k.friction((self.closing[1],), self.k.per_slide, *laws)
        return out

    # the felt ------------------------------------------------------------------------------------------------------

    @cached_property
    def laws(self) -> list[tuple[int, int, Expression, Expression, Expression]]:
        """Of each memory: number, law, state, share, and reach or time."""
        s = self.s
        out = []
        for m in s.memories(self.c):
            share, reach = (s.number(6, L.MEMORY_SIZE, m, k) for k in (L.SHARE, L.REACH_OR_TIME))
            out.append((m, s.memory[m][1], self.k.state.z[m], share, reach))
        return out

    @cached_property
    def felt(self) -> tuple[Expression, Expression]:
        """Whether the felt presses where the surfaces meet, and its force, N."""
        x, rate = self.gap[0], self.closing[0]
        if not self.laws:
            pressing, force = felts.hunt_crossley((x, rate), self.curve, self.number(L.DAMP))
        elif self.laws[0][1] == L.STULOV:
            (_, _, h, epsilon, tau) = self.laws[0]
            pressing, force, _ = felts.stulov((x, h), self.curve, epsilon, tau)
        else:
            memories, shares = ([row[k] for row in self.laws] for k in (2, 3))
            force = felts.hysteresis((x, *memories), shares, self.curve)
            pressing = felts.loading(x, self.curve) > 0.0
        return pressing, force

    def _forgotten(self) -> list[Statement]:
        """Rates of the memories of felt that nothing presses."""
        return [
            Put(name(f"fade{m}"), felts.stulov_alone((h,), share, tau) if kind == L.STULOV else ZERO)
            for m, kind, h, share, tau in self.laws
        ]

    def _remembered(self) -> list[Statement]:
        """Rates of the memories of felt that is pressed."""
        x, rate = self.gap[0], self.closing[0]
        out: list[Statement] = []
        for m, kind, z, share, reach in self.laws:
            if kind == L.STULOV:
                follows = felts.stulov((x, z), self.curve, share, reach)[2]
                out.append(If(self.felt[0], [Put(name(f"fade{m}"), follows)]))
            else:
                out.append(Put(name(f"fade{m}"), felts.hysteresis_rate((x, rate, z), reach)))
        return out

    def world(self, force: Expression, coefficient: Expression) -> Vector:
        """Force on A in the world, N, of a normal force and its friction."""
        _, (nx, ny) = self.gap
        rub = coefficient * force
        return force * nx + rub * ny, force * ny - rub * nx

    def push(self, force: Expression, coefficient: Expression) -> dict[int, Expression]:
        """Generalised forces of a normal force and its friction."""
        world = self.world(force, coefficient)
        return {k: dot(way, world) for k, way in self.ways.items() if k < self.s.free}

    def pressed(self) -> list[Statement]:
        """What happens where the surfaces meet: forces, and rates of memories."""
        pressing, force = self.felt
        rubbing, smooth = (
            [Add(name(f"f{k}"), e) for k, e in self.push(force, mu).items()] for mu in (self.coefficient(), ZERO)
        )
        rubs = make("differs", self.number(L.MU_A), ZERO)  # most contacts have no friction
        pushed: list[Statement] = list(rubbing) if self.k.everywhere else [If(rubs, list(rubbing), list(smooth))]
        return [*self._remembered(), If(pressing, pushed)]

    def forces(self) -> list[Statement]:
        """Generalised forces, and the rate of each memory as ``fade``."""
        return [*self._forgotten(), If(self.touches, self.pressed())]

    def stiffness(self) -> Expression:
        """Force per depth that a first touch brings at once, N/m."""
        if self.laws and self.laws[0][1] == L.STULOV:
            return self.number(L.K_C) / (1.0 - self.laws[0][3])
        return self.number(L.K_C)

    def energy(self, label: str = "") -> list[Statement]:
        """What the felt stores, J; what felt and friction lose, W; to names that end with ``label``."""
        pressing, force = self.felt
        x, (rate, slide) = self.gap[0], self.closing
        loss = name(("rail" if self.c in self.s.rail else "felt") + label)
        rub = If(pressing, [Add(name("friction" + label), self.coefficient() * force * slide)])
        if not self.laws:
            pressed = where(pressing, force, 0.0)
            lost = (pressed - largest(felts.loading(x, self.curve), 0.0)) * rate
            return [If(self.touches, [Add(name("energy" + label), felts.stored(x, self.curve)), Add(loss, lost), rub])]
        if self.laws[0][1] == L.STULOV:
            m, _, h, epsilon, tau = self.laws[0]
            depth = where(self.touches, x, 0.0)
            return [*felts.stulov_energy(f"{m}", label, depth, h, self.curve, epsilon, tau), If(self.touches, [rub])]
        left = felts.share_left([row[3] for row in self.laws])
        f = largest(felts.loading(x, self.curve), 0.0)
        stored, lost = left * felts.stored(x, self.curve), ZERO
        for _, _, z, share, reach in self.laws:
            stored = stored + left * (0.5 * share * reach * x * f * z * z)
            steep = felts.steepness(x, self.curve)
            lost = lost + left * share * z * z * (f * abs(rate) - 0.5 * reach * (f + x * steep) * rate)
        return [If(self.touches, [Add(name("energy" + label), stored), Add(name("felt" + label), lost), rub])]


def speeds_up(turns: dict[int, Expression], ease: list[Expression]) -> Expression:
    """The largest acceleration of one coordinate that a unit force along a direction gives."""
    found = [abs(turn) * ease[k] for k, turn in turns.items() if k < len(ease)]
    return largest(*found) if found else ZERO


def change(turns: dict[int, Expression], rates: list[Expression]) -> Expression:
    """What goes along with speeds or accelerations of all coordinates."""
    return total(turn * rates[k] for k, turn in turns.items())
