"""Several devices in one system, each with its own channels, terminals and timebase; a cable carries clocks.

The first is the main one: its terminals are known by their own names, those of the others in full, with a slash.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rig.simulated.product.inventory import Inventory, PhysicalChannel, Pin


class SeveralDevices(Inventory):
    """The devices of a rig; ``linked_names`` are those on one RTSI cable."""

    def __init__(self, devices: Sequence[Inventory], linked_names: Collection[str]) -> None:
        super().__init__(devices[0].product, devices[0].name, devices[0].clock_error)
        self._others = tuple(devices[1:])
        self._linked = frozenset(linked_names)
        for other in self._others:
            self._channels |= other._channels

    def devices(self) -> dict[str, str]:
        """Return product types by name, of all devices and modules."""
        found = self.own_devices()
        for other in self._others:
            found |= other.own_devices()
        return found

    def of(self, name: str) -> Inventory:
        """Return the device that a channel, terminal or device of this name belongs to; else the main one."""
        first = name.removeprefix("/").split("/", 1)[0].lower()
        for other in self._others:
            if first in (known.lower() for known in other.own_devices()):
                return other
        return self

    def own_name(self, terminal: str) -> str:
        """Return a terminal relative to its device."""
        owner = self.of(terminal) if terminal.startswith("/") else self
        return terminal if owner is self else terminal[1 + len(owner.name) :].lstrip("/")

    def known_as(self, owner: Inventory, relative: str) -> str:
        """Return the name by which a terminal of a device is known here."""
        return relative if owner is self or relative.startswith("/") else "/" + owner.full_name(relative)

    def linked(self, one: Inventory, other: Inventory) -> bool:
        """Whether two devices share an RTSI cable."""
        return one is other or {one.name, other.name} <= self._linked

    def counter_terminal(self, channel: PhysicalChannel, pin: Pin) -> str:
        """Return a counter's default terminal; "" where it has none."""
        owner = self.of(channel.name)
        if owner is self:
            return super().counter_terminal(channel, pin)
        found = owner.counter_terminal(channel, pin)
        return self.known_as(owner, found) if found else ""

    def terminal(self, name: str, *, output: bool = False) -> str:
        """Check a terminal name; one that begins with a slash and another device is that device's."""
        owner = self.of(name) if "/" in name else self
        if owner is self:
            return super().terminal(name, output=output)
        return self.known_as(owner, owner.terminal("/" + name.removeprefix("/"), output=output))
