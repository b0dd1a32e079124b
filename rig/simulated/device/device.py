"""The virtual device: tasks, reservations, and the sample clock that moves the plant.

Place in the data flow: the RPC service calls it as a client would call the driver; it calls the plant and
the sensors. It is stricter than kind: what the product refuses is refused with the driver's status code.
Sample k of AI and CI is latched at edge k; AO sample k is put out at edge k and held. Time moves only when
a read asks for samples that do not exist yet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.bench.clock import Clock
from rig.simulated.bench.plant_protocol import Plant
from rig.simulated.bench.sensors import SensorSet
from rig.simulated.bench.wiring import Wiring
from rig.simulated.device import triggers as starting
from rig.simulated.device import wait as waiting
from rig.simulated.device.bench_time import BenchTime
from rig.simulated.device.fault_injection import FaultPlan
from rig.simulated.device.pulse_trains import pulse_train
from rig.simulated.device.reservations import Reservations
from rig.simulated.device.sample_clock import latch, put_out
from rig.simulated.device.task import Channel, SampleClock, SimulatedTask, TaskType
from rig.simulated.device.watchdog import Watchdogs
from rig.simulated.messages import ATTACH_TO_EXISTING, INITIALIZE_NEW
from rig.simulated.product.capabilities import Kind
from rig.simulated.product.inventory import Inventory, channel_names
from rig.simulated.status import DaqStatusError, NotImplementedByDevice, SessionRefused

MOST_ON_DEMAND = 100_000
WRITE_TIMEOUT_S = 10.0


class SimulatedDevice:
    """One device with its sensors, motor and plant.

    Parameters
    ----------
    inventory : Inventory
        Product under the name it has in the system.
    plant : Plant
        Mechanics; takes the rate of the sample clock that runs.
    sensors : SensorSet
        Load cell and scales.
    wiring : Wiring
        What is wired where.
    clock : Clock
        Told how much time passes.
    """

    def __init__(self, inventory: Inventory, plant: Plant, sensors: SensorSet, wiring: Wiring, clock: Clock) -> None:
        self.inventory = inventory
        self.bench = BenchTime(plant, sensors, clock)
        self.wiring = wiring
        self.tasks: dict[str, SimulatedTask] = {}
        self.output_v: dict[str, float] = {}
        """Volts each analog output holds, by full channel name; a stopped output holds its last value."""
        self.lines: dict[str, bool] = {}
        self.line_history: dict[str, NDArray[np.float64]] = {}
        """Levels before the edges that passed last, and after the last one, of lines that a clock moves."""
        self.trial = 0
        self.watchdogs = Watchdogs(self)
        self.faults = FaultPlan()
        self.exports: dict[str, str] = {}
        """Terminals that carry another terminal's signal."""
        self.between: Callable[[], None] = lambda: None
        """Called between stretches of time, so that other clients get a turn."""
        self.reservations = Reservations(inventory)

    def task(self, name: str) -> SimulatedTask:
        """Return a task by name."""
        if name not in self.tasks:
            raise DaqStatusError(status.INVALID_TASK, f"Task: {name!r}")
        return self.tasks[name]

    def attached(self, name: str, behavior: int) -> SimulatedTask | None:
        """Return the task a client attaches to, or None for a new one, as NI's server decides; may refuse."""
        if behavior == INITIALIZE_NEW and name in self.tasks:
            raise SessionRefused("ALREADY_EXISTS", f"Cannot initialize '{name}' when a session already exists.")
        if behavior == ATTACH_TO_EXISTING and name not in self.tasks:
            detail = f"Cannot attach to '{name}' because a session has not been initialized."
            raise SessionRefused("FAILED_PRECONDITION", detail)
        return self.tasks.get(name)

    def create_task(self, name: str) -> SimulatedTask:
        """Make an empty task; an empty name gets a free one."""
        name = name or next(f"_unnamedTask<{i}>" for i in range(10**6) if f"_unnamedTask<{i}>" not in self.tasks)
        if name in self.tasks:
            raise DaqStatusError(status.DUPLICATE_TASK, f"Task: {name}")
        self.tasks[name] = SimulatedTask(name)
        return self.tasks[name]

    def clear_task(self, name: str) -> None:
        """Stop, release and forget a task."""
        task = self.task(name)
        self.stop(task)
        self.release(task)
        for terminal in task.exported:
            self.exports.pop(terminal, None)
        del self.tasks[name]
        self.watchdogs.forget(name)

    def add_channels(
        self, task: SimulatedTask, type_: TaskType, kind: Kind, physical: str, name: str, **settings: Any
    ) -> None:
        """Add the comma-separated physical channels to a task; digital ones come from :meth:`add_lines`."""
        names = channel_names(physical)
        for index, part in enumerate(names):
            channel = self.inventory.channel(part, kind)
            given = name if len(names) == 1 else f"{name}{index}"
            task.add_channel(type_, Channel(given if name else channel.name, channel, dict(settings)))

    def add_lines(self, task: SimulatedTask, type_: TaskType, lines: str, name: str, *, one_channel: bool) -> None:
        """Add digital lines or whole ports to a task, as one channel or one per line."""
        found = self.inventory.lines(lines)
        groups = [found] if one_channel else [[line] for line in found]
        for index, group in enumerate(groups):
            given = name if len(groups) == 1 else f"{name}{index}"
            port = group[0].name.rsplit("/", 1)[0]
            several = port if lines.strip().lower() == port.lower() else group[0].name + "..."
            own = several if len(group) > 1 else group[0].name
            task.add_channel(type_, Channel(given if name else own, group[0], {"lines": [line.name for line in group]}))

    def configure_clock(self, task: SimulatedTask, rate_hz: float, source: str, mode: int, samples: int) -> None:
        """Set a task's sample clock after coercing its rate and checking its route."""
        if not task.channels:
            raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
        if task.state == "running":
            raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
        if not rate_hz > 0 or samples < 1:
            raise DaqStatusError(status.INVALID_VALUE, f"Rate {rate_hz:g}, samples per channel {samples}")
        terminal = self.inventory.terminal(source) if source and source != "OnboardClock" else ""
        if task.type == "CI" and not terminal:
            raise DaqStatusError(-200303, "External sample clock source must be specified for this measurement.")
        if task.type == "CO":
            raise NotImplementedByDevice("sample clock of a CO task")
        static = any(channel.physical.kind == "static_line" for channel in task.channels)
        if static or (task.type in ("DI", "DO") and not self.inventory.product.clocked_lines):
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: these lines are static")
        rate_hz = self.inventory.coerced_rate(rate_hz, task.channels[0].physical.kind, len(task.channels))
        task.clock, task.changes, task.implicit = SampleClock(rate_hz, terminal, mode, samples), frozenset(), False

    def commit(self, task: SimulatedTask) -> None:
        """Take the task's resources; refuses what another task holds."""
        if not task.channels:
            raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
        self.reservations.take(task)
        if task.state == "unreserved":
            task.state = "committed"

    def release(self, task: SimulatedTask) -> None:
        """Give the task's resources back."""
        self.reservations.give_back(task)
        task.state, task.committed = "unreserved", False

    def start(self, task: SimulatedTask) -> None:
        """Start a task; the start of one with a clock of its own is the start trigger of those that wait for it."""
        starting.start(self, task)

    def stop(self, task: SimulatedTask) -> None:
        """Stop a task; an output keeps the value it has."""
        if task.state != "running":
            return
        task.live = False
        self.watchdogs.stopped(task)
        if task.committed:
            task.state = "committed"
        else:
            self.release(task)

    def reset(self) -> None:
        """Forget all tasks and put the outputs where they are after power-up."""
        for name in list(self.tasks):
            self.clear_task(name)
        self.output_v = dict.fromkeys(self.output_v, 0.0)
        self.lines = dict.fromkeys(self.lines, False)
        self.exports.clear()

    def drive_enabled(self) -> bool:
        """Whether the motor drive follows the analog output."""
        line = self.wiring.drive_enable
        return line is None or self.lines.get(self.inventory.full_name(line), False)

    def advance(self, n: int) -> None:
        """Let at most n edges of the bench pass; time stands still when no task has anything left to do."""
        waiting.advance(self, n)

    def pulse_edges_s(self, counter: str) -> NDArray[np.float64]:
        """Rising edges a counter has put out since its trigger, s; none when it does not run."""
        for task in self.tasks.values():
            if task.type == "CO" and task.live and any(c.physical.name == counter for c in task.channels):
                return pulse_train(task).until(self.bench.edge / self.bench.rate_hz)
        return np.empty(0)

    @property
    def edge(self) -> int:
        """Edges of the bench since the last trigger."""
        return self.bench.edge

    def read(self, task: SimulatedTask, n: int, timeout_s: float) -> NDArray[np.float64]:
        """Return up to n samples per channel, shape (m, channels), letting time pass until they exist.

        Fewer come when the timeout ends first. Raises DaqStatusError when samples were overwritten or will never come.
        """
        if task.clock is None and task.state != "running":  # started for this read alone
            self.start(task)
            try:
                return self.read(task, n, timeout_s)
            finally:
                self.stop(task)
        if task.state != "running":
            self.start(task)
        if task.clock is None or task.buffer is None:
            if n > MOST_ON_DEMAND:
                raise NotImplementedByDevice(f"{n} readings on demand at once")
            try:
                return np.concatenate([latch(self, task, *self.bench.present()) for _ in range(max(n, 1))])
            except DaqStatusError as error:
                if error.code == status.SAMPLES_NOT_YET_AVAILABLE:
                    waiting.in_vain(self, task, timeout_s)
                raise
        if n < 0:
            waiting.catch_up(self, task)
            n = task.all_there_is
        missing = n - task.buffer.available
        if task.ref_trigger and task.to_do > 0:
            missing = max(missing, 1)
        if missing > task.remaining() and not task.retriggerable:
            raise DaqStatusError(status.PAST_THE_END, f"Task: {task.name}", samples_read=0)
        if missing > 0:
            waiting.for_samples(self, task, missing, timeout_s)
        if task.ref_trigger and task.to_do > 0:
            return np.empty((0, len(task.channels)))
        return task.buffer.take(min(n, task.buffer.available))

    def write(
        self, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool, timeout_s: float = WRITE_TIMEOUT_S
    ) -> None:
        """Take samples for an analog output, V, shape (n, channels)."""
        if task.type != "AO":
            raise DaqStatusError(status.WRONG_OUTPUT_TYPE, f"Task: {task.name} is {task.type}")
        for column, channel in enumerate(task.channels):
            low, high = channel.settings["min_val"], channel.settings["max_val"]
            inside = (values[:, column] >= low) & (values[:, column] <= high)  # NaN is not inside
            if not np.all(inside):
                detail = f"Channel: {channel.name}, limits {low:g} to {high:g} V"
                raise DaqStatusError(status.INVALID_AO_DATA, detail)
        self.accept(task, values, auto_start, timeout_s)

    def accept(
        self, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool, timeout_s: float = WRITE_TIMEOUT_S
    ) -> None:
        """Take samples for an output, shape (n, channels or lines): buffered, or put out at once without a clock."""
        self.watchdogs.refuse_if_held(task)
        if task.clock is None:
            self._at_once(task, auto_start)
            put_out(self, task, values[-1])
        elif task.state != "running":
            task.output = values.copy()
            if auto_start:
                self.start(task)
        elif task.error:
            raise DaqStatusError(task.error, f"Task: {task.name}")
        elif task.regenerates or task.output is None:
            task.output = values.copy()
        else:
            waiting.for_room(self, task, values, timeout_s)

    def write_lines(self, task: SimulatedTask, states: list[bool], auto_start: bool) -> None:
        """Set digital lines at once."""
        lines = sum(len(channel.settings.get("lines", ())) for channel in task.channels)
        if task.type != "DO" or len(states) != lines:
            raise DaqStatusError(status.WRONG_OUTPUT_TYPE, f"Task: {task.name}, {len(states)} lines")
        self.accept(task, np.array([states], dtype=np.float64), auto_start)

    def _at_once(self, task: SimulatedTask, auto_start: bool) -> None:
        if task.state == "running":
            return
        if not auto_start:
            raise DaqStatusError(status.NOT_STARTED, f"Task: {task.name}")
        self.commit(task)
        if not task.committed:
            self.release(task)
