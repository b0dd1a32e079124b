"""The state of the virtual device: tasks, reservations, outputs, faults, watchdogs, and the bench it is wired to.

Everything else in the device is a function that takes this state: :mod:`rig.simulated.signals` (what is on which
terminal), :mod:`rig.simulated.timing` (how time passes) and :mod:`rig.simulated.driver` (what a client may ask).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.bench.bench_time import BenchTime
from rig.simulated.bench.wiring import Wiring
from rig.simulated.device.fault_injection import FaultPlan
from rig.simulated.device.reservations import Reservations
from rig.simulated.device.scales import CustomScale
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product.inventory import Inventory
from rig.simulated.status import DaqStatusError


@dataclass(eq=False)
class WatchdogTimer:
    """The timer of a watchdog timer task, and the expiration states of the outputs it reaches."""

    name: str
    timeout_s: float
    device: str = ""
    """Name of its device; the main one's may be left out."""
    volts: dict[str, float] = field(default_factory=dict)
    """By full name of the analog output."""
    lines: dict[str, bool | None] = field(default_factory=dict)
    """By full name of the line; None leaves it as it is."""
    levels: dict[str, int] = field(default_factory=dict)
    """The expiration states of the lines as the client gave them."""
    settings: dict[int, str | int] = field(default_factory=dict)
    """Further properties by the driver's number, of an expiration by a trigger."""
    running: bool = False
    expired: bool = False
    reset_at_s: float = 0.0
    """Time on the bench's clock of the start or last reset, s."""

    def controls(self, channel: str) -> bool:
        """Whether an output stands at its expiration state and cannot be written."""
        return self.expired and (channel in self.volts or channel in self.lines)


@dataclass(eq=False)
class DeviceState:
    """One device under its name in the system, with its wiring and the bench behind the terminals."""

    inventory: Inventory
    bench: BenchTime
    wiring: Wiring
    faults: FaultPlan = field(default_factory=FaultPlan)
    trial: int = 0
    tasks: dict[str, SimulatedTask] = field(default_factory=dict)
    watchdogs: dict[str, WatchdogTimer] = field(default_factory=dict)
    """By the name of their task."""
    handed_out: int = 0
    """Samples per channel that the task read farthest has handed out since the trial began."""
    call_delay_s: float = 0.0
    """Bench time that each call of a client takes on its way, s."""
    locked: bool = False
    """A watchdog timer has expired on a product that then does nothing until it is reset."""
    output_v: dict[str, float] = field(default_factory=dict)
    """Volts each analog output is at, by full channel name; a stopped output stays at its last value."""
    lines: dict[str, bool] = field(default_factory=dict)
    """Levels of the digital lines that were written, by full name."""
    line_history: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Levels before the edges that passed last, and after the last one, of lines with a sample clock."""
    scales: dict[str, CustomScale] = field(default_factory=dict)
    """Custom scales by name in lower case."""
    exports: dict[str, str] = field(default_factory=dict)
    """Terminals that carry another terminal's signal."""
    timebase: Inventory | None = None
    """The device whose clock the bench's edges follow in this trial."""
    let_clients_call: Callable[[], None] = lambda: None
    """Called between stretches of time within one call, so that other clients get a turn."""
    settle_settings: Callable[[DeviceState, SimulatedTask], None] = lambda device, task: None
    """Takes over what a client has set of a task's triggers and logging, before it is verified."""
    reservations: Reservations = field(init=False)

    def __post_init__(self) -> None:
        self.reservations = Reservations(self.inventory)

    @property
    def edge(self) -> int:
        """Edges of the bench since the trial began."""
        return self.bench.edge

    def carried(self, terminal: str) -> str:
        """Return the terminal whose signal a terminal carries, over a wire between devices or an export."""
        for _ in range(4):
            on_wire = self.wiring.wires.get(terminal, terminal)
            origin = self.exports.get(on_wire, on_wire)
            if origin == terminal:
                break
            terminal = origin
        return terminal

    @property
    def motor(self) -> str:
        """Full name of the analog output the motor is wired to."""
        return self.inventory.full_name(self.wiring.motor)

    def drive_enabled(self) -> bool:
        """Whether the motor drive follows the analog output."""
        line = self.wiring.drive_enable
        return line is None or self.lines.get(self.inventory.full_name(line), False)


def verify(device: DeviceState, task: SimulatedTask) -> None:
    """Refuse settings that cannot be together, and those that the virtual device cannot act on."""
    if not task.channels:
        raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
    kinds = {*task.unsimulated, *task.triggers.analog_kinds}
    if kinds & {"start trigger", "reference trigger"} and task.timing.clock is None:
        raise DaqStatusError(status.TRIGGER_ON_DEMAND, f"Task: {task.name}")
    device.settle_settings(device, task)
    for (category, _, number), value in task.properties.items():
        if category == "ExportedSignal" and isinstance(value, str) and value:
            try:
                device.inventory.terminal(value, output=True)
            except DaqStatusError:
                raise DaqStatusError(status.NO_SUCH_TARGET, f"Property: 0x{number:04X}: {value!r}") from None
    if task.unsimulated:
        settings = ", ".join(f"{name} = {value}" for name, value in task.unsimulated.items())
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: not simulated: {settings}")


def commit(device: DeviceState, task: SimulatedTask) -> None:
    """Reserve the task's resources; refuses what another task has reserved."""
    verify(device, task)
    device.reservations.reserve(task)
    if task.state == "unreserved":
        task.state = "committed"


def release(device: DeviceState, task: SimulatedTask) -> None:
    """Release the task's resources."""
    device.reservations.release(task)
    task.state, task.committed = "unreserved", False
