"""Hardware of the virtual device that tasks have reserved."""

from __future__ import annotations

from rig.simulated import daqmx
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product import Inventory
from rig.simulated.status import Code, DaqStatusError


class Reservations:
    """Resources of one device and the tasks that have reserved them."""

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self._reserved: dict[str, str] = {}

    def needed_resources(self, task: SimulatedTask) -> list[str]:
        """Return the names of the hardware that a task takes for itself, reserving nothing; refuse a task with a
        terminal that must be set and is not, or whose clock or trigger comes from a device no cable joins."""
        owner = self._inventory.owner_of(task.channels[0].physical.name) if task.channels else self._inventory
        source = task.clock.source if task.clock is not None else ""
        for route in filter(None, (source, task.triggers.start, task.triggers.arm_start)):
            origin = self._inventory.owner_of(route) if route.startswith("/") else self._inventory
            if not self._inventory.are_linked(origin, owner):  # no cable carries it here
                detail = f"Task: {task.name}: {route} of {origin.name} to {owner.name}"
                raise DaqStatusError(Code.TRIG_LINE_NOT_FOUND_ROUTING, detail)
        if task.type == "DO":
            needed = [self._inventory.line(line).resource for line in task.lines]
        else:
            needed = [channel.physical.resource for channel in task.channels]
        multiplexed = task.type == "AI" and not owner.product.chassis  # one converter, also on demand
        if (task.clock is not None and task.type in ("AI", "AO")) or multiplexed:
            needed.append(f"{task.type} timing engine")
        if (
            task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) != daqmx.NO_TRIGGER
            and not task.triggers.arm_start
        ):
            raise DaqStatusError(
                Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING,
                f"Task: {task.name}: arm start trigger without a source",
            )
        for channel in task.channels:
            if task.type == "CI" and "decoding_type" in channel.settings:
                for terminal in (daqmx.CI_ENCODER_A_INPUT_TERM, daqmx.CI_ENCODER_B_INPUT_TERM):
                    self._inventory.terminal(task.setting("Chan", channel.name, terminal, ""))
            if task.type == "CO" and (named := task.setting("Chan", channel.name, daqmx.CO_PULSE_TERM, "")):
                relative = self._inventory.own_name(self._inventory.terminal(named, output=True))
                # on the 9401 a terminal and a line of the same number are one pin
                needed.append("pin4." + relative[-1] if relative.startswith("Mod4") else "PFI " + relative)
        return needed if owner is self._inventory else [f"{owner.name}: {resource}" for resource in needed]

    def reserve(self, task: SimulatedTask) -> None:
        """Reserve all the hardware that a task needs; where another task holds a part of it reserve nothing and raise
        the driver's status."""
        needed = self.needed_resources(task)
        for resource in needed:
            holder = self._reserved.get(resource)
            if holder not in (None, task.name):
                raise DaqStatusError(Code.PAL_RESOURCE_RESERVED, f"Resource: {resource}, held by task {holder}")
        self._reserved.update(dict.fromkeys(needed, task.name))

    def is_reserved(self, resource: str) -> bool:
        return resource in self._reserved

    def release(self, task: SimulatedTask) -> None:
        self._reserved = {key: holder for key, holder in self._reserved.items() if holder != task.name}
