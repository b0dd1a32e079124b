"""Structure of a scene from its integer tables: the tree of bodies, and which element acts where."""

from __future__ import annotations

from copy import copy

from model.compiler.expressions import Expression, read
from model.elements.laws.felt_law import Law
from model.elements.laws.known import law_numbered
from model.kernels import layout as L


def solved_contacts(tables: L.Tables) -> list[int]:
    """Contacts that push at least one free coordinate, or whose felt remembers."""
    moved = {*range(len(tables.parent) - int(tables.prescribed.sum())), *tables.pin[:, 0].tolist()}
    rows = zip(tables.chain, tables.contact, strict=True)
    remember = set(tables.memory.tolist())
    return [c for c, (chain, row) in enumerate(rows) if c in remember or moved & set(chain[: row[3]].tolist())]


class Structure:
    """Tables of a scene as plain Python.

    Attributes
    ----------
    n, free, own : coordinates in all; those that are solved for; those of them that the step loop knows. Directions in
        which joints give follow the bodies' coordinates and are states behind those that felt remembers.
    solved : the coordinates that are solved for; what is prescribed stands between bodies and directions
    led : of a key whose pivot can rise and whose front is prescribed: the coordinate in which it rises. Its own
        coordinate is then the angle at which it would have its front there if its pivot were at its place
    pin : body whose joint gives, by coordinate; ``axis``: 0 right or 1 up, of those and of guides
    memory : contact of each state that felt remembers
    place : contacts that a step solves for (`solved_contacts`), with their place in masks and rooms
    """

    def __init__(self, tables: L.Tables) -> None:
        self.parent = [int(i) for i in tables.parent]
        bodies = len(self.parent)
        self.bodies = range(bodies)
        self.spring = [int(i) for i in tables.spring]
        self.contact = [tuple(int(k) for k in row[:4]) for row in tables.contact]
        self._law = [(int(row[4]), int(row[5])) for row in tables.contact]
        self.chain = [[int(b) for b in row[: of[3]]] for row, of in zip(tables.chain, tables.contact, strict=True)]
        self.drive = [tuple(int(k) for k in row) for row in tables.drive]
        self.probe = [tuple(int(k) for k in row) for row in tables.probe]
        self.damper = [int(i) for i in tables.damper]
        self.rail = [int(c) for c in tables.rail]
        self.string = [int(c) for c in tables.string]
        self.memory = [int(c) for c in tables.memory]
        self.offset = [int(k) for k in tables.offset]
        self.place = {c: k for k, c in enumerate(solved_contacts(tables))}
        self.guided = {i for i, w in enumerate(self.parent) if w == L.GUIDED}
        self.pin = {bodies + k: int(body) for k, (body, _) in enumerate(tables.pin)}
        self.axis = dict.fromkeys(self.guided, 1) | {bodies + k: int(axis) for k, (_, axis) in enumerate(tables.pin)}
        self.own = bodies - int(tables.prescribed.sum())
        self.n = bodies + len(self.pin)
        self.solved = [*range(self.own), *self.pin]
        self.free = len(self.solved)
        self.led = {
            i: rise
            for i in range(self.own, bodies)
            for rise in [g for g in self.axis if self.axis[g] == 1 and (self.parent[i] == g or self.pin.get(g) == i)]
        }

    def all_solved(self) -> Structure:
        """Copy in which prescribed coordinates count as solved for, too."""
        out = copy(self)
        out.own, out.solved, out.free = len(self.bodies), list(range(self.n)), self.n
        return out

    def order(self) -> list[int]:
        """Bodies, each after its parent."""
        out: list[int] = []
        for i, w in enumerate(self.parent):
            out += [k for k in (w, i) if k >= 0 and k not in out]
        return out

    def memories(self, c: int) -> list[int]:
        """Indices of the internal variables of contact ``c``."""
        return [k for k, contact in enumerate(self.memory) if contact == c]

    def law(self, c: int) -> Law:
        """Law of the felt of contact ``c``."""
        return law_numbered(self._law[c][0])

    def law_numbers(self, c: int) -> tuple[Expression, ...]:
        """Parameters of the law of contact ``c``."""
        first = self.offset[6] + sum(count for _, count in self._law[:c])
        return tuple(read("p", first + k) for k in range(self._law[c][1]))

    def first_of_string(self) -> int:
        """Index of the string's first state among all internal variables."""
        return len(self.memory) + 2 * len(self.pin)

    def pin_places(self, row: int) -> dict[int, tuple[int, int]]:
        """Indices of displacement and speed of each compliant joint direction, in internal variables from ``row``."""
        first, count = row + len(self.memory), len(self.pin)
        return {g: (first + k, first + count + k) for k, g in enumerate(self.pin)}

    def number(self, block: int, size: int, which: int, k: int) -> Expression:
        """Number ``k`` of element ``which`` of a block of the parameter vector."""
        return read("p", self.offset[block] + size * which + k)

    def body(self, i: int, k: int) -> Expression:
        """Number ``k`` (`layout`) of body ``i`` in the parameter vector."""
        return read("p", L.GLOBALS + L.BODY_SIZE * i + k)
