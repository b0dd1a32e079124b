"""All elements of a scene at a state: their forces and energies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from model.compiler.expressions import Expression, read, total
from model.compiler.programs import Statement
from model.elements.bodies import Bodies
from model.elements.contacts import Contact
from model.elements.drives import Drives
from model.elements.kinematics import Kinematics, State
from model.elements.springs import Spring, dampers, springs
from model.elements.strings import StringContact
from model.elements.structure import Structure
from model.elements.tips import Tip
from model.kernels import layout as L
from model.kernels import workspace as W


@dataclass
class Elements:
    """The elements of a structure at a state."""

    s: Structure
    state: State
    array: str = "w"
    """Array and row of memories that hold a string's modes at a single state."""
    row: int = W.AUDIT_Z
    everywhere: bool = False
    """Whether forces are to be differentiable by numbers that are 0, too."""

    @cached_property
    def k(self) -> Kinematics:
        """Poses of the bodies."""
        return Kinematics(self.s, self.state, self.everywhere)

    @cached_property
    def bodies(self) -> Bodies:
        return Bodies(self.s, self.k, read("p", L.GRAVITY))

    @cached_property
    def contacts(self) -> dict[int, Contact]:
        """Contacts that push a free coordinate."""
        return {c: self.contact(c) for c in self.s.place}

    def contact(self, c: int) -> Contact:
        """Contact ``c``, whatever it pushes."""
        if c in self.s.string:
            return StringContact(self.s, self.k, c, (self.array, self.row))
        return Contact(self.s, self.k, c)

    @cached_property
    def strings(self) -> list[StringContact]:
        """Contacts in which a string is struck, with their own equations."""
        return [contact for contact in self.contacts.values() if isinstance(contact, StringContact)]

    def string_seen(self) -> list[Statement]:
        strings = [self.contact(c) for c in self.s.string]
        return [line for one in strings if isinstance(one, StringContact) for line in one.string_state()]

    def damping_power(self, i: int) -> Expression:
        """Power that dampers and bushings of a joint take, W."""
        return total(e.dissipated_power for e in dampers(self.s, self.state) if self.s.pin.get(e.i, e.i) == i)

    @cached_property
    def tips(self) -> list[Tip]:
        return [Tip(self.s, self.k, which) for which in range(len(self.s.probe))]

    @cached_property
    def contactless_elements(self) -> list[Spring | Drives]:
        s = self.s
        return [*springs(s, self.state), Drives(s, self.k), *dampers(s, self.state)]

    def contactless_forces(self) -> list[Statement]:
        return self.bodies.forces() + [line for e in self.contactless_elements for line in e.forces()]

    def energy(self) -> list[Statement]:
        """Energies stored, powers put in and lost, of everything."""
        contacts = [self.contact(c) for c in range(len(self.s.contact))]
        every = [self.bodies, *self.contactless_elements, *contacts, *self.tips]
        return [line for e in every for line in e.energy()]
