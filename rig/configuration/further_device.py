"""Further devices of a rig, ``[[devices]]``: cards or chassis beside the one whose AI clock everything follows."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from rig.configuration.channels import Table, Text


class FurtherDevice(Table):
    """A card or chassis beside the main one, and how it gets the main one's sample clock.

    ``link`` "RTSI": both are on one RTSI cable, registered in NI MAX; the driver routes clock and trigger. "lines": the
    main device puts its sample clock out on ``clock_from``, a wire takes it to ``clock_to`` of this one. A device that
    runs on its own timebase is not offered: two of them part by up to 50 us in a second.
    """

    product: Literal["cDAQ-9189", "PCIe-6363", "PCI-6034E", "PCI-6602", "PCI-6733"]
    name: Text
    link: Literal["RTSI", "lines"]
    clock_from: Text | None = None
    clock_to: Text | None = None

    @model_validator(mode="after")
    def _wired(self) -> FurtherDevice:
        wires = [self.clock_from, self.clock_to]
        if self.link == "lines" and None in wires:
            raise ValueError(f"{self.name}: link = 'lines' needs clock_from and clock_to, the ends of the wire")
        if self.link == "RTSI" and wires != [None, None]:
            raise ValueError(f"{self.name}: link = 'RTSI' has no clock_from and clock_to; the driver finds the lines")
        if self.link == "RTSI" and self.product.startswith("cDAQ"):
            raise ValueError(f"{self.name}: a {self.product} has no RTSI; allowed link = 'lines'")
        return self

    def owns(self, channel: str) -> bool:
        """Whether a channel or terminal is this device's, or one of its modules'."""
        first = channel.removeprefix("/").split("/", 1)[0].lower()
        return first == self.name.lower() or (
            self.product.startswith("cDAQ") and first.startswith(self.name.lower() + "mod")
        )
