"""The watchdog timer of the virtual device: what the outputs do when the program that commands them falls silent.

Place in the data flow: the service hands in the client's calls; the device looks at the timer with every call and every
passage of time. Which outputs a watchdog reaches is a property of the product: analog and digital ones on a cDAQ-9189,
only digital lines on an X Series card. An expired watchdog holds the outputs until it is cleared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.simulated import status
from rig.simulated.device.task import SimulatedTask
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

LOW, HIGH = 10214, 10192
VOLTAGE_OUTPUT = 10322
RESET_TIMER, CLEAR_EXPIRATION = 0, 1
SHORTEST_S, LONGEST_S = 1e-3, 34.0


class Watchdog:
    """One watchdog timer task."""

    def __init__(self, device: SimulatedDevice, name: str, timeout_s: float) -> None:
        if not device.inventory.product.watchdog_reach:
            raise DaqStatusError(status.WATCHDOG_NOT_SUPPORTED, f"Task: {name}")
        if not SHORTEST_S <= timeout_s <= LONGEST_S:
            raise DaqStatusError(status.WATCHDOG_TIMEOUT_OUT_OF_RANGE, f"Timeout: {timeout_s:g} s")
        self.name = name
        self.timeout_s = timeout_s
        self.running = self.expired = False
        self.volts: dict[str, float] = {}
        self.lines: dict[str, bool] = {}
        self._device = device
        self._kicked_s = 0.0

    def set_volts(self, channel: str, volts: float, output_type: int) -> None:
        """Say what an analog output does on expiry."""
        if "voltage_out" not in self._device.inventory.product.watchdog_reach:
            raise DaqStatusError(status.WATCHDOG_NOT_SUPPORTED, f"Physical Channel: {channel} is analog")
        physical = self._device.inventory.channel(channel, "voltage_out")
        if output_type != VOLTAGE_OUTPUT or abs(volts) > self._device.inventory.product.ao_range_v:
            raise DaqStatusError(status.INVALID_VALUE, f"Expiration state of {channel}: {volts:g}")
        self.volts[physical.name] = volts

    def set_line(self, line: str, level: int) -> None:
        """Say what a digital line does on expiry."""
        if level not in (LOW, HIGH):
            raise DaqStatusError(status.INVALID_VALUE, f"Expiration state of {line}: {level}")
        self.lines[self._device.inventory.channel(line, "line").name] = level == HIGH

    def start(self) -> None:
        """Start the timer; on a chassis no other task may hold anything then."""
        others = [task.name for task in self._device.tasks.values() if task.state != "unreserved"]
        if others and "voltage_out" in self._device.inventory.product.watchdog_reach:
            raise DaqStatusError(status.WATCHDOG_WHILE_OTHERS_RESERVED, f"Task: {self.name}, reserved: {others[0]}")
        self.running, self._kicked_s = True, self._device.bench.clock.elapsed_s

    def control(self, action: int) -> None:
        """Reset the timer, or clear an expiration."""
        if action == CLEAR_EXPIRATION:
            self.expired, self.running = False, False
        elif action != RESET_TIMER:
            raise DaqStatusError(status.INVALID_VALUE, f"Watchdog action {action}")
        elif self.expired:
            raise DaqStatusError(status.CANNOT_RESET_EXPIRED_WATCHDOG, f"Task: {self.name}")
        else:
            self._kicked_s = self._device.bench.clock.elapsed_s

    def look(self) -> None:
        """Expire when the timer has run out: outputs go to their states and generations end."""
        if not self.running or self.expired or self._device.bench.clock.elapsed_s - self._kicked_s <= self.timeout_s:
            return
        self.expired = True
        self._device.output_v.update(self.volts)
        self._device.lines.update(self.lines)
        for task in self._device.tasks.values():
            if task.type in ("AO", "DO") and any(self.holds(channel.physical.name) for channel in task.channels):
                task.live = False

    def holds(self, channel: str) -> bool:
        """Whether an output stands at its expiration state and cannot be written."""
        return self.expired and (channel in self.volts or channel in self.lines)


class Watchdogs:
    """The watchdog timers of a device, by the names of their tasks."""

    def __init__(self, device: SimulatedDevice) -> None:
        self._device = device
        self._timers: dict[str, Watchdog] = {}

    def create(self, name: str, timeout_s: float) -> SimulatedTask:
        """Make a watchdog timer task."""
        timer = Watchdog(self._device, name, timeout_s)
        task = self._device.create_task(name)
        self._timers[task.name] = timer
        return task

    def timer(self, name: str) -> Watchdog:
        """Return the timer of a task."""
        if name not in self._timers:
            raise DaqStatusError(status.NOT_A_WATCHDOG, f"Task: {name!r}")
        return self._timers[name]

    @property
    def expired(self) -> bool:
        """Whether any timer has run out."""
        return any(timer.expired for timer in self._timers.values())

    def look(self) -> None:
        """Let every timer that has run out expire."""
        for timer in self._timers.values():
            timer.look()

    def started(self, task: SimulatedTask) -> bool:
        """Start the task's timer; False when the task is of another kind."""
        if task.name not in self._timers:
            return False
        self._timers[task.name].start()
        task.state = "running"
        return True

    def stopped(self, task: SimulatedTask) -> None:
        """Stop the task's timer, if it is one."""
        if task.name in self._timers:
            self._timers[task.name].running = False

    def forget(self, name: str) -> None:
        """Remove the timer of a task that is cleared."""
        self._timers.pop(name, None)

    def refuse_if_held(self, task: SimulatedTask) -> None:
        """Refuse writing to an output that an expired timer holds."""
        for channel in task.channels:
            if any(timer.holds(channel.physical.name) for timer in self._timers.values()):
                raise DaqStatusError(status.WRITE_AFTER_WATCHDOG, f"Physical Channel: {channel.physical.name}")
