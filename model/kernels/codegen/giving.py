"""Chains of contacts where joints give: which coordinates move one surface against the other, and about which points.

A joint that gives lets the pivot of its body move to the right and up in the world, by two more coordinates. A body
that carries such a joint turns it about its own pivot displaced by what the joint gives, for the displacement does not
turn along. Source lines of such bodies are in ``giving_bodies``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

SEEN_FROM = 100
"""Added to a body: the point about which its carrier turns it."""


class Term(NamedTuple):
    """A coordinate of a chain: +1 where it moves A, -1 where B; the point about which it turns; how its reach is known.

    ``reach`` is its place among the reaches in p, or -1 for a direction in which a joint gives, or -2 for a turn that
    moves both surfaces, one of them on a joint that gives.
    """

    coordinate: int
    side: int
    about: int
    reach: int


Chain = list[Term]
GIVES, TURNS_BOTH = -1, -2


def plain_chain(pairs: list[tuple[int, int]]) -> Chain:
    """The chain of a contact between bodies on rigid joints."""
    return [Term(b, side, b, k) for k, (b, side) in enumerate(pairs)]


def chain_of(
    plain: Chain, ends: dict[int, int], parent: list[int], pins: list[tuple[int, int]], pinned: Iterable[int]
) -> Chain:
    """The chain where joints give.

    ``ends`` are the bodies A and B by their side, ``pins`` directions with the body of their joint, ``pinned`` the
    bodies with such a joint that another one turns.
    """
    a, b = ends[1], ends[-1]

    def line(body: int) -> list[int]:
        return [] if body < 0 else [body, *([parent[body]] if parent[body] >= 0 else [])]

    def about(end: int, i: int) -> int:
        return SEEN_FROM + end if i != end and parent[end] == i and end in pinned else i

    out = [e._replace(about=about(ends[e.side], e.coordinate)) for e in plain]
    on_a, on_b = line(a), line(b)
    turning = {e.coordinate for e in plain}
    for i in (i for i in on_a if i in on_b and i not in turning):
        if about(a, i) != about(b, i):
            out += [Term(i, side, about(end, i), TURNS_BOTH) for side, end in ends.items()]
    for side, mine, other in ((1, on_a, on_b), (-1, on_b, on_a)):
        out += [Term(g, side, g, GIVES) for g, body in pins if body in mine and body not in other]
    return out


def carried(moves: Term, turns: Term, parent: list[int], pin: dict[int, int]) -> bool:
    """Whether the coordinate of ``moves`` moves the point about which ``turns`` turns, on the same side."""
    if moves.side != turns.side:
        return False
    point, g = turns.about, moves.coordinate
    seen = point >= SEEN_FROM
    body = point - SEEN_FROM if seen else point
    if g in pin:
        return pin[g] == body or (body < len(parent) and parent[body] == pin[g])
    return not seen and body < len(parent) and parent[body] == g
