"""Structure of a scene as the emitters read it: plain lists, offsets, and which matrix entries can be filled.

In: the integer tables of a scene; no parameter value. ``LoneContact`` is one contact seen apart from its scene.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.lanes.width import lanes_pay


def solved_contacts(tables: L.Tables) -> list[int]:
    """Contacts that push at least one free coordinate."""
    free = len(tables.parent) - int(tables.prescribed.sum())
    rows = zip(tables.chain, tables.contact, strict=True)
    return [c for c, (chain, row) in enumerate(rows) if any(int(b) < free for b in chain[: row[3]])]


class Structure:
    """Tables of a scene as plain Python, with the offsets of its numbers; ``lanes`` of members side by side, or one."""

    def __init__(self, tables: L.Tables, lanes: int = 1) -> None:
        self.lanes = lanes
        self.parent = [int(i) for i in tables.parent]
        self.n = len(self.parent)
        self.spring = [int(i) for i in tables.spring]
        self.contact = [tuple(int(k) for k in row) for row in tables.contact]
        self.chain = [
            [(int(b), int(s)) for b, s in zip(chain[: row[3]], side[: row[3]], strict=True)]
            for chain, side, row in zip(tables.chain, tables.side, tables.contact, strict=True)
        ]
        self.drive = [tuple(int(k) for k in row) for row in tables.drive]
        self.probe = [tuple(int(k) for k in row) for row in tables.probe]
        self.offset = [int(k) for k in tables.offset]
        self.free = self.n - int(tables.prescribed.sum())  # coordinates that are solved for; prescribed ones follow
        # contacts that can push a free coordinate, by their place in masks and rooms; the others are left out
        self.place = {c: k for k, c in enumerate(solved_contacts(tables))}
        self.damper = [int(i) for i in tables.damper]
        self.rail = [int(c) for c in tables.rail]
        self.string = [int(c) for c in tables.string]
        self.memory = [(int(c), int(law)) for c, law in tables.memory]
        self.guided = {i for i, w in enumerate(self.parent) if w == L.GUIDED}
        # cosines and joint friction of all bodies of a run in one vector; members in lanes fill theirs with members
        self.bundles = lanes == 1 and lanes_pay()

    @property
    def wound(self) -> bool:
        """Whether an amplifier and a winding drive the scene."""
        return any(kind == L.AMPLIFIER for kind, _ in self.drive)

    def memories(self, c: int) -> list[int]:
        """Numbers of the states that contact ``c`` remembers."""
        return [k for k, (contact, _) in enumerate(self.memory) if contact == c]

    def memory_number(self, m: int, k: int) -> str:
        """Text of number ``k`` of memory ``m``."""
        return f"p[{self.offset[6] + L.MEMORY_SIZE * m + k}]"

    def order(self) -> list[int]:
        """Bodies, each after its parent."""
        out: list[int] = []
        for i, w in enumerate(self.parent):
            out += [k for k in (w, i) if k >= 0 and k not in out]
        return out

    def turning(self) -> list[int]:
        """Bodies that turn, each after its parent."""
        return [i for i in self.order() if i not in self.guided]

    def guide(self, body: int) -> int:
        """The vertical guide that carries ``body``, or -1."""
        return self.parent[body] if self.parent[body] in self.guided else -1

    def children(self, body: int) -> list[int]:
        """Bodies that hang from ``body``."""
        return [i for i, w in enumerate(self.parent) if w == body]

    def body(self, i: int, k: int) -> str:
        """Text of number ``k`` of body ``i``."""
        return f"p[{L.GLOBALS + L.BODY_SIZE * i + k}]"

    def contact_number(self, c: int, k: int) -> str:
        """Text of number ``k`` of contact ``c``."""
        return f"p[{self.offset[1] + L.CONTACT_SIZE * c + k}]"

    def stiffness(self, i: int, j: int) -> str:
        """Text of the entry of K, a place in the workspace.

        As variables they would run through the branches of all contacts: a tenth more time to compile, and not faster.
        """
        return f"w[{W.STIFF + W.WIDTH * i + j}]"

    def damping(self, i: int, j: int) -> str:
        """Text of the entry of D."""
        return f"w[{W.DAMP + W.WIDTH * i + j}]"

    def pattern(self) -> set[tuple[int, int]]:
        """Entries of K, D and M that can differ from zero; rows are free coordinates, columns also prescribed ones."""
        out = {(i, i) for i in range(self.free)}
        for i, w in enumerate(self.parent):
            if w >= 0:
                out |= {(i, w), (w, i)}
        for chain in self.chain:
            out |= {(i, j) for i, _ in chain for j, _ in chain if i < self.free}
        for kind, i in self.drive:
            if kind == L.AMPLIFIER:
                out |= {(i, i - 1), (i - 1, i)}
        for a, b in self.probe:
            ends = [i for i in (a, b, self.guide(b)) if i >= 0]
            out |= {(i, j) for i in ends for j in ends}
        return out

    def square(self) -> set[tuple[int, int]]:
        """Those of them between free coordinates."""
        return {(i, j) for i, j in self.pattern() if j < self.free}


class LoneContact:
    """One contact of a scene as the emitters read it: its bodies counted from 0, its offsets as arguments.

    What the text of a contact's function depends on, so that contacts alike share one function.
    """

    def __init__(self, s: Structure, c: int) -> None:
        a, b, shape, length = s.contact[c]
        self.lanes = s.lanes
        self.bodies: list[int] = []  # in the scene
        for i in (*(i for i, _ in s.chain[c]), a, b):
            if i >= 0 and i not in self.bodies:
                self.bodies.append(i)
        here = {i: k for k, i in enumerate(self.bodies)}
        self.contact = [(here.get(a, -1), here.get(b, -1), shape, length)]
        self.chain = [[(here[i], side) for i, side in s.chain[c]]]
        self.parent = [here.get(s.parent[i], -1) for i in self.bodies]
        self.guided = {here[i] for i in s.guided if i in here}
        self._solved = [i < s.free for i in self.bodies]
        self.joints = [i for i, _ in self.chain[0]]
        self.string = c in s.string
        self.remembers = [s.memory[m][1] for m in s.memories(c)]  # law of each of its memories

    def solved(self, body: int) -> bool:
        """Whether the coordinate of ``body`` is solved for."""
        return self._solved[body]

    def contact_number(self, _: int, k: int) -> str:
        """Text of number ``k`` of the contact."""
        return f"p[o + {k}]"

    def at(self, _: int, where: int) -> str:
        """Text of the contact's place in a row of the workspace."""
        return f"at + {where}"

    def stiffness(self, i: int, j: int) -> str:
        """Text of the entry of K; the coordinates' numbers in the scene are arguments."""
        return f"w[{W.STIFF} + {W.WIDTH} * n{i} + n{j}]"

    def damping(self, i: int, j: int) -> str:
        """Text of the entry of D."""
        return f"w[{W.DAMP} + {W.WIDTH} * n{i} + n{j}]"
