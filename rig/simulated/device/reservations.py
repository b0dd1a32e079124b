"""Who holds which hardware: counters, converters, timing engines, pins. What one task holds another is refused."""

from __future__ import annotations

from rig.simulated import status
from rig.simulated.device.input_readings import A_TERMINAL, B_TERMINAL
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product.inventory import Inventory
from rig.simulated.status import DaqStatusError

CO_TERMINAL = 0x18E1
ARM_TYPE, NO_TRIGGER = 0x1414, 10230


class Reservations:
    """Resources of one device and the tasks that hold them."""

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self._holders: dict[str, str] = {}
        self._directions: dict[str, dict[str, bool]] = {}

    def needed(self, task: SimulatedTask) -> list[str]:
        """Return the hardware a task needs for itself; refuses terminals that it should have been told."""
        needed = [channel.physical.resource for channel in task.channels if task.type not in ("DI", "DO")]
        if task.type in ("DI", "DO"):
            lines = [line for channel in task.channels for line in channel.settings["lines"]]
            # inputs may share a line, outputs may not
            needed = [self._inventory.line(line).resource for line in lines] if task.type == "DO" else []
        multiplexed = task.type == "AI" and not self._inventory.product.modules  # one converter, also on demand
        if (task.clock is not None and task.type in ("AI", "AO", "DI", "DO")) or multiplexed:
            needed.append(f"{task.type} timing engine")
        if task.setting("Trig", "", ARM_TYPE, NO_TRIGGER) != NO_TRIGGER and not task.arm_trigger:
            raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Task: {task.name}: arm start trigger without a source")
        for channel in task.channels:
            if channel.settings.get("two_counters"):
                number = int(channel.physical.resource.removeprefix("ctr"))
                needed.append(f"ctr{number ^ 1}")  # the paired counter makes the time base
            if task.type == "CI" and "decoding_type" in channel.settings:
                for attribute in (A_TERMINAL, B_TERMINAL):
                    self._inventory.terminal(task.setting("Chan", channel.name, attribute, ""))
            if task.type == "CO" and (terminal := task.setting("Chan", channel.name, CO_TERMINAL, "")):
                relative = self._inventory.terminal(terminal, output=True)
                # on the 9401 a terminal and a line of the same number are one pin
                needed.append("pin4." + relative[-1] if relative.startswith("Mod4") else "PFI " + relative)
        return needed

    def directions(self, task: SimulatedTask) -> dict[str, bool]:
        """Return whether the task makes outputs of the groups of lines it uses, where a group has one direction.

        The NI 9401 has two groups of four lines; a terminal and a line of the same number are one pin. A counter's
        inputs are left out: it may count what another puts out on the pin.
        """
        pins = {
            self._inventory.line(line).resource: task.type == "DO"
            for channel in task.channels
            for line in channel.settings.get("lines", ())
        }
        for channel in task.channels:
            if value := task.setting("Chan", channel.name, CO_TERMINAL, ""):
                module, _, pin = self._inventory.terminal(value).partition("/PFI")
                pins[f"{module.replace('Mod', 'pin')}.{pin}"] = True
        groups = self._inventory.product.lines_in_group
        found = {}
        for pin, is_output in pins.items():
            stem, _, number = pin.partition(".")
            if stem in groups:
                found[f"{stem} group {int(number) // groups[stem]}"] = is_output
        return found

    def take(self, task: SimulatedTask) -> None:
        """Take all a task needs, or nothing."""
        needed, directions = self.needed(task), self.directions(task)
        for resource in needed:
            holder = self._holders.get(resource)
            if holder not in (None, task.name):
                raise DaqStatusError(status.RESOURCE_RESERVED, f"Resource: {resource}, held by task {holder}")
        for name, held in self._directions.items():
            for group, is_output in directions.items():
                if name != task.name and held.get(group, is_output) != is_output:
                    raise DaqStatusError(status.LINE_DIRECTION_CONFLICT, f"Task: {task.name}, {group}, task {name}")
        self._holders.update(dict.fromkeys(needed, task.name))
        self._directions[task.name] = directions

    def is_held(self, resource: str) -> bool:
        """Whether a task holds a resource."""
        return resource in self._holders

    def give_back(self, task: SimulatedTask) -> None:
        """Give back all a task holds."""
        self._holders = {key: holder for key, holder in self._holders.items() if holder != task.name}
        self._directions.pop(task.name, None)
