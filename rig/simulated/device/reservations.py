"""Which task has reserved which hardware: counters, converters, timing engines, pins; no other task gets it then."""

from __future__ import annotations

from rig.simulated import daqmx, status
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product.inventory import Inventory
from rig.simulated.status import DaqStatusError


class Reservations:
    """Resources of one device and the tasks that have reserved them."""

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self._reserved: dict[str, str] = {}
        self._directions: dict[str, dict[str, bool]] = {}

    def needed(self, task: SimulatedTask) -> list[str]:
        """Return the hardware a task needs for itself; refuses a task whose required terminals are not set."""
        digital = task.type in ("DI", "DO")
        owner = self._inventory.of(task.channels[0].physical.name) if task.channels else self._inventory
        self._check_routes(task, owner)
        needed = [] if digital else [channel.physical.resource for channel in task.channels]
        if task.type == "DO":  # inputs may share a line, outputs may not
            needed = [self._inventory.line(line).resource for line in task.lines]
        multiplexed = task.type == "AI" and not owner.product.chassis  # one converter, also on demand
        if (task.timing.clock is not None and (digital or task.type in ("AI", "AO"))) or multiplexed:
            needed.append(f"{task.type} timing engine")
        if (
            task.setting("Trig", "", daqmx.ARM_START_TRIG_TYPE, daqmx.NO_TRIGGER) != daqmx.NO_TRIGGER
            and not task.triggers.arm_start
        ):
            raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Task: {task.name}: arm start trigger without a source")
        for channel in task.channels:
            if channel.settings.get("two_counters"):
                number = int(channel.physical.resource.removeprefix("ctr"))
                needed.append(f"ctr{number ^ 1}")  # the paired counter makes the time base
            if task.type == "CI" and "decoding_type" in channel.settings:
                for terminal in (daqmx.CI_ENCODER_A_INPUT_TERM, daqmx.CI_ENCODER_B_INPUT_TERM):
                    self._inventory.terminal(task.setting("Chan", channel.name, terminal, ""))
            if task.type == "CO" and (named := task.setting("Chan", channel.name, daqmx.CO_PULSE_TERM, "")):
                relative = self._inventory.own_name(self._inventory.terminal(named, output=True))
                # on the 9401 a terminal and a line of the same number are one pin
                needed.append("pin4." + relative[-1] if relative.startswith("Mod4") else "PFI " + relative)
        return needed if owner is self._inventory else [f"{owner.name}: {resource}" for resource in needed]

    def _check_routes(self, task: SimulatedTask, owner: Inventory) -> None:
        """Refuse a clock or trigger of another device that no cable carries to this one."""
        source = task.timing.clock.source if task.timing.clock is not None else ""
        for terminal in filter(
            None, (source, task.triggers.start, task.triggers.arm_start, task.triggers.reference, task.triggers.pause)
        ):
            origin = self._inventory.of(terminal) if terminal.startswith("/") else self._inventory
            if not self._inventory.linked(origin, owner):
                raise DaqStatusError(
                    status.NO_TRIGGER_LINES, f"Task: {task.name}: {terminal} of {origin.name} to {owner.name}"
                )

    def directions(self, task: SimulatedTask) -> dict[str, bool]:
        """Return whether the task drives each group of lines it uses, where all lines of a group have one direction.

        The NI 9401 has two groups of four lines; a terminal and a line of the same number are one pin. A counter's
        inputs are left out: it may count what another puts out on the pin.
        """
        pins = {
            self._inventory.line(line).resource: task.type == "DO"
            for channel in task.channels
            for line in channel.settings.get("lines", ())
        }
        for channel in task.channels:
            if value := task.setting("Chan", channel.name, daqmx.CO_PULSE_TERM, ""):
                if self._inventory.of(value) is not self._inventory:
                    continue
                module, _, pin = self._inventory.terminal(value).partition("/PFI")
                pins[f"{module.replace('Mod', 'pin')}.{pin}"] = True
        groups = self._inventory.product.lines_in_group
        found = {}
        for pin, is_output in pins.items():
            stem, _, number = pin.partition(".")
            if stem in groups:
                found[f"{stem} group {int(number) // groups[stem]}"] = is_output
        return found

    def reserve(self, task: SimulatedTask) -> None:
        """Reserve all a task needs, or nothing."""
        needed, directions = self.needed(task), self.directions(task)
        for resource in needed:
            holder = self._reserved.get(resource)
            if holder not in (None, task.name):
                raise DaqStatusError(status.RESOURCE_RESERVED, f"Resource: {resource}, held by task {holder}")
        for name, others in self._directions.items():
            for group, is_output in directions.items():
                if name != task.name and others.get(group, is_output) != is_output:
                    raise DaqStatusError(status.LINE_DIRECTION_CONFLICT, f"Task: {task.name}, {group}, task {name}")
        self._reserved.update(dict.fromkeys(needed, task.name))
        self._directions[task.name] = directions

    def is_reserved(self, resource: str) -> bool:
        """Whether a task has reserved a resource."""
        return resource in self._reserved

    def release(self, task: SimulatedTask) -> None:
        """Release all a task has reserved."""
        self._reserved = {key: holder for key, holder in self._reserved.items() if holder != task.name}
        self._directions.pop(task.name, None)
