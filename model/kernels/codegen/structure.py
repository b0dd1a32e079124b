"""Structure of a scene as the emitters read it: plain lists, offsets, and which matrix entries can be filled.

In: the integer tables of a scene; no parameter value. ``LoneContact`` is one contact seen apart from its scene.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.giving import Chain, carried, chain_of, plain_chain
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
        self._chains = [
            plain_chain([(int(b), int(s)) for b, s in zip(chain[: row[3]], side[: row[3]], strict=True)])
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
        self.axis = dict.fromkeys(self.guided, 1)  # direction of each guide
        self.own = self.free  # coordinates that the step loop knows; directions in which joints give follow them
        self.pin = {self.n + k: int(body) for k, (body, _) in enumerate(tables.pin)}
        self.pinned = {body for body in self.pin.values() if self.parent[body] >= 0 and self.guide(body) < 0}
        if self.pin:
            pins = list(self.pin.items())
            self._chains = [
                chain_of(chain, {1: row[0], -1: row[1]}, self.parent, pins, self.pinned)
                for chain, row in zip(self._chains, self.contact, strict=True)
            ]
            self.axis |= {self.n + k: int(axis) for k, (_, axis) in enumerate(tables.pin)}
            self.guided |= set(self.pin)
            self.n = self.free = self.n + len(self.pin)
        self.chain = [[(e.coordinate, e.side) for e in chain] for chain in self._chains]
        # cosines and joint friction of all bodies of a run in one vector; members in lanes fill theirs with members
        self.bundles = lanes == 1 and lanes_pay()

    def pivot(self, c: int, k: int) -> tuple[str, str]:
        """World coordinates of the point about which turn ``k`` of the chain of contact ``c`` turns."""
        about = self._chains[c][k].about
        return f"x{about}", f"y{about}"

    def chain_terms(self, c: int) -> Chain:
        """The chain of contact ``c`` in full."""
        return self._chains[c]

    def carries(self, c: int, j: int, k: int) -> bool:
        """Whether coordinate ``j`` of a chain moves the point about which its turn ``k`` turns."""
        return carried(self._chains[c][j], self._chains[c][k], self.parent, self.pin)

    def vertical(self, body: int) -> int:
        """The coordinate, lift or give, that moves a body from the ground straight up, or -1."""
        own = [g for g, b in self.pin.items() if b == body and self.axis[g] == 1]
        return own[0] if own else self.guide(body)

    def pin_number(self, g: int, k: int) -> str:
        """Text of number ``k`` of the direction ``g`` in which a joint gives."""
        return f"p[{self.offset[8] + L.PIN_SIZE * (g - self.own) + k}]"

    def pins_of(self, body: int) -> list[int]:
        """Directions in which the joint of ``body`` gives."""
        return [g for g, b in self.pin.items() if b == body]

    def carried_by(self, g: int) -> list[int]:
        """Bodies that move with the direction ``g`` of a joint that gives."""
        body = self.pin[g]
        return [body, *(i for i in self.children(body) if i not in self.guided)]

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
        return f"w[{W.P_STIFF + W.WIDE * i + j}]" if self.pin else f"w[{W.STIFF + W.WIDTH * i + j}]"

    def damping(self, i: int, j: int) -> str:
        """Text of the entry of D."""
        return f"w[{W.P_DAMP + W.WIDE * i + j}]" if self.pin else f"w[{W.DAMP + W.WIDTH * i + j}]"

    def factor(self, i: int, j: int) -> str:
        """Text of the entry of the matrix of a step."""
        return f"w[{W.P_LU + W.WIDE * i + j}]" if self.pin else f"m{i}_{j}"

    def acceleration(self, i: int) -> int:
        """Place of the acceleration of coordinate ``i`` at the start of a step."""
        return W.P_ACC + i if self.pin else W.ACC + i

    def first_memory(self) -> int:
        """Place of the string's states among all that is remembered."""
        return len(self.memory) + 2 * len(self.pin)

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
            ends = [i for i in (a, b, self.vertical(b)) if i >= 0]
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
        for e in s.chain_terms(c):
            if e.about not in here:
                here[e.about] = len(self.bodies)
                self.bodies.append(e.about)
        self._about = [here[e.about] for e in s.chain_terms(c)]
        self._carries = [[s.carries(c, j, k) for k in range(len(s.chain[c]))] for j in range(len(s.chain[c]))]
        self.contact = [(here.get(a, -1), here.get(b, -1), shape, length)]
        self.chain = [[(here[i], side) for i, side in s.chain[c]]]
        self.guided = {here[i] for i in s.guided if i in here}
        self.axis = {here[i]: axis for i, axis in s.axis.items() if i in here}
        self._wide = bool(s.pin)
        self._solved = [i < s.free for i in self.bodies]
        self.joints = list(dict.fromkeys(i for i, _ in self.chain[0]))
        self.string = c in s.string
        self.remembers = [s.memory[m][1] for m in s.memories(c)]  # law of each of its memories

    def pivot(self, _: int, k: int) -> tuple[str, str]:
        """As `Structure.pivot`."""
        return f"x{self._about[k]}", f"y{self._about[k]}"

    def carries(self, _: int, j: int, k: int) -> bool:
        """As `Structure.carries`."""
        return self._carries[j][k]

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
        return self._entry(W.STIFF, W.P_STIFF, i, j)

    def damping(self, i: int, j: int) -> str:
        """Text of the entry of D."""
        return self._entry(W.DAMP, W.P_DAMP, i, j)

    def _entry(self, own: int, wide: int, i: int, j: int) -> str:
        start, width = (wide, W.WIDE) if self._wide else (own, W.WIDTH)
        return f"w[{start} + {width} * n{i} + n{j}]"
