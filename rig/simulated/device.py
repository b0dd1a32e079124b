"""The virtual device: tasks, reservations, and the sample clock that moves the plant.

Place in the data flow: the RPC service calls it as a client would call the driver; it calls the plant and
the sensors. It is stricter than kind: what the product refuses is refused with the driver's status code.
Sample k of AI and CI is latched at edge k; AO sample k is put out at edge k and held. Time moves only when
a read asks for samples that do not exist yet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.bench_time import BenchTime
from rig.simulated.clock import Clock
from rig.simulated.contract import Plant
from rig.simulated.faults import FaultPlan
from rig.simulated.products import Inventory, Kind, channel_names
from rig.simulated.readings import encoder_reading, force_reading
from rig.simulated.reservations import Reservations
from rig.simulated.sensors import SensorSet
from rig.simulated.status import DaqStatusError, NotImplementedByDevice
from rig.simulated.tasks import FINITE, Buffer, Channel, SampleClock, SimulatedTask, TaskType
from rig.simulated.watchdog import Watchdogs
from rig.simulated.wiring import Wiring

AO_CLOCK = "ao/SampleClock"
CO_FREQ, CO_DELAY = 0x1178, 0x299
INPUTS = ("AI", "CI")


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
        self.trial = 0
        self.watchdogs = Watchdogs(self)
        self.faults = FaultPlan()
        self._reservations = Reservations(inventory)
        self._master: SimulatedTask | None = None

    def task(self, name: str) -> SimulatedTask:
        """Return a task by name."""
        if name not in self.tasks:
            raise DaqStatusError(status.INVALID_TASK, f"Task: {name!r}")
        return self.tasks[name]

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
        del self.tasks[name]
        self.watchdogs.forget(name)

    def add_channels(
        self, task: SimulatedTask, type_: TaskType, kind: Kind, physical: str, name: str, **settings: Any
    ) -> None:
        """Add the comma-separated physical channels to a task."""
        names = channel_names(physical)
        for index, part in enumerate(names):
            channel = self.inventory.channel(part, kind)
            given = name if len(names) == 1 else f"{name}{index}"
            task.add_channel(type_, Channel(given if name else channel.name, channel, settings))

    def configure_clock(self, task: SimulatedTask, rate_hz: float, source: str, mode: int, samples: int) -> None:
        """Set a task's sample clock after coercing its rate and checking its route."""
        if not task.channels:
            raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
        if task.state == "running":
            raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
        if not rate_hz > 0 or samples < 1:
            raise DaqStatusError(status.INVALID_VALUE, f"Rate {rate_hz:g}, samples per channel {samples}")
        terminal = self.inventory.terminal(source) if source and source != "OnboardClock" else ""
        if task.type == "AI":
            rate_hz = self.inventory.coerced_ai_rate(rate_hz, task.channels[0].physical.kind)
        elif task.type == "CI" and not terminal:
            raise DaqStatusError(-200303, "External sample clock source must be specified for this measurement.")
        elif task.type not in ("CI", "AO"):
            raise NotImplementedByDevice(f"sample clock of a {task.type} task")
        elif task.type == "AO" and rate_hz > self.inventory.product.ao_max_rate_hz:
            raise DaqStatusError(status.RATE_TOO_HIGH, f"Requested {rate_hz:g}")
        task.clock = SampleClock(rate_hz, terminal, mode, samples)

    def commit(self, task: SimulatedTask) -> None:
        """Take the task's resources; refuses what another task holds."""
        if not task.channels:
            raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
        self._reservations.take(task)
        if task.state == "unreserved":
            task.state = "committed"

    def release(self, task: SimulatedTask) -> None:
        """Give the task's resources back."""
        self._reservations.give_back(task)
        task.state, task.committed = "unreserved", False

    def start(self, task: SimulatedTask) -> None:
        """Start a task; starting AI is the start trigger of everything armed."""
        if task.state == "running":
            raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
        if self.watchdogs.started(task):
            return
        if task.type == "AO" and task.output is None and task.clock is not None:
            raise DaqStatusError(status.NO_DATA_WRITTEN, f"Task: {task.name}")
        self.commit(task)
        task.state, task.generated = "running", 0
        if task.type in INPUTS:
            task.buffer = Buffer(task.buffer_size, len(task.channels))
        own_clock = task.clock is not None and not task.clock.source
        if task.clock is not None and own_clock and not task.start_trigger:
            self._trigger(task, task.clock)
        elif own_clock:
            raise NotImplementedByDevice(f"{task.name} with a clock of its own and a start trigger")
        else:
            # a trigger that is waited for must still come; one that has passed never comes again
            task.live = not (task.start_trigger or task.arm_trigger)

    def _trigger(self, master: SimulatedTask, clock: SampleClock) -> None:
        if self._master is not None:
            raise NotImplementedByDevice(f"{master.name} on a clock of its own beside {self._master.name}")
        self._master, self.trial = master, self.trial + 1
        delay_s = self.inventory.input_delay_s(master.channels[0].physical.kind, clock.rate_hz)
        self.bench.begin(self.trial, clock.rate_hz, delay_s)
        trigger = f"{str(master.type).lower()}/StartTrigger"
        for task in self.tasks.values():
            if task is master or (task.state == "running" and trigger in (task.start_trigger, task.arm_trigger)):
                task.live = True

    def _ticking(self) -> set[str]:
        """Sample clock terminals that carry the running clock; "" is the master's own."""
        if self._master is None:
            return set()
        ticking = {"", f"{str(self._master.type).lower()}/SampleClock"}
        if any(
            t.type == "AO" and t.live and t.clock is not None and t.clock.source in ticking for t in self.tasks.values()
        ):
            ticking.add(AO_CLOCK)
        return ticking

    def stop(self, task: SimulatedTask) -> None:
        """Stop a task; an output keeps the value it has."""
        if task.state != "running":
            return
        task.live = False
        self.watchdogs.stopped(task)
        if task is self._master:
            self._master = None
        if task.committed:
            task.state = "committed"
        else:
            self.release(task)

    def drive_enabled(self) -> bool:
        """Whether the motor drive follows the analog output."""
        line = self.wiring.drive_enable
        return line is None or self.lines.get(self.inventory.full_name(line), False)

    def advance(self, n: int) -> None:
        """Let at most n edges of the running sample clock pass: outputs, plant, inputs, in this order."""
        if self._master is None:
            return
        n = int(min(n, self._master.remaining()))
        if n <= 0:
            return
        ticking = self._ticking()
        clocked = [t for t in self.tasks.values() if t.live and t.clock is not None and t.clock.source in ticking]
        motor = self.inventory.full_name(self.wiring.motor)
        command = np.full(n, self.output_v.get(motor, 0.0))
        for task in clocked:
            rows = task.next_output(n) if task.type == "AO" else np.empty((0, 0))
            for column, channel in enumerate(task.channels if rows.shape[0] else []):
                self.output_v[channel.physical.name] = float(rows[-1, column])
                if channel.physical.name == motor:
                    command[: rows.shape[0]] = rows[:, column]
                    command[rows.shape[0] :] = rows[-1, column]
        at_s = (self.bench.edge + np.arange(n)) / self.bench.rate_hz
        cell, quarter = self.bench.step(command if self.drive_enabled() else np.zeros(n))
        cell, quarter = self.faults.change(self.trial, at_s, cell, quarter)
        for task in clocked:
            if task.buffer is not None:
                task.buffer.put(self._latch(task, cell, quarter)[: max(int(min(task.remaining(), n)), 0)])

    def pulse_edges_s(self, counter: str) -> NDArray[np.float64]:
        """Rising edges a counter has put out since the start trigger, s; none when it does not run."""
        for task in self.tasks.values():
            channel = next((c for c in task.channels if c.physical.name == counter), None)
            if task.type == "CO" and task.live and channel is not None:
                rate = task.setting("Chan", channel.name, CO_FREQ, 0.0)
                first = task.setting("Chan", channel.name, CO_DELAY, 0.0)
                passed = int(np.floor((self.bench.edge / self.bench.rate_hz - first) * rate + 1e-9)) + 1
                return first + np.arange(max(passed, 0)) / rate
        return np.empty(0)

    @property
    def edge(self) -> int:
        """Edges of the sample clock since the last start trigger."""
        return self.bench.edge

    def _latch(self, task: SimulatedTask, cell: NDArray[np.float64], quarter: NDArray[np.int64]) -> NDArray[np.float64]:
        if task.type == "AI":
            return np.column_stack([force_reading(self, channel, cell) for channel in task.channels])
        return np.column_stack([encoder_reading(self, task, channel, quarter) for channel in task.channels])

    def read(self, task: SimulatedTask, n: int, timeout_s: float) -> NDArray[np.float64]:
        """Return up to n samples per channel, shape (m, channels), letting time pass until they exist.

        Fewer come when the timeout ends first. Raises DaqStatusError when samples were overwritten or will never come.
        """
        if task.state != "running":
            self.start(task)
        if task.clock is None or task.buffer is None:
            present = [self._latch(task, *self.bench.present()) for _ in range(max(n, 1))]
            return np.concatenate(present)
        if n < 0:
            n = task.buffer.available if task.clock.mode != FINITE else task.clock.samples - task.buffer.read
        missing = n - task.buffer.available
        if missing > task.remaining():
            raise DaqStatusError(status.PAST_THE_END, f"Task: {task.name}", samples_read=0)
        if missing > 0:
            allowed = missing if timeout_s < 0 else min(missing, int(timeout_s * self.bench.rate_hz + 1e-9))
            if task.live and task.clock.source in self._ticking():
                self.advance(int(min(allowed, task.remaining())))
            elif timeout_s > 0:
                self.bench.clock.advance(timeout_s)
        return task.buffer.take(min(n, task.buffer.available))

    def write(self, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool) -> None:
        """Take samples for an analog output, shape (n, channels): buffered, or at once without a clock."""
        if task.type != "AO":
            raise DaqStatusError(status.WRONG_OUTPUT_TYPE, f"Task: {task.name} is {task.type}")
        for column, channel in enumerate(task.channels):
            low, high = channel.settings["min_val"], channel.settings["max_val"]
            inside = (values[:, column] >= low) & (values[:, column] <= high)  # NaN is not inside
            if not np.all(inside):
                detail = f"Channel: {channel.name}, limits {low:g} to {high:g} V"
                raise DaqStatusError(status.INVALID_AO_DATA, detail)
        self.watchdogs.refuse_if_held(task)
        if task.clock is not None:
            if task.state == "running":
                raise NotImplementedByDevice("writing to a running generation")
            task.output = values.copy()
            if auto_start:
                self.start(task)
            return
        self._at_once(task, auto_start)
        self.output_v.update({c.physical.name: float(values[-1, i]) for i, c in enumerate(task.channels)})

    def write_lines(self, task: SimulatedTask, states: list[bool], auto_start: bool) -> None:
        """Set digital lines at once."""
        if task.type != "DO" or len(states) != len(task.channels):
            raise DaqStatusError(status.WRONG_OUTPUT_TYPE, f"Task: {task.name}, {len(states)} lines")
        self.watchdogs.refuse_if_held(task)
        self._at_once(task, auto_start)
        self.lines.update({c.physical.name: state for c, state in zip(task.channels, states, strict=True)})

    def _at_once(self, task: SimulatedTask, auto_start: bool) -> None:
        if task.state == "running":
            return
        if not auto_start:
            raise DaqStatusError(status.NOT_STARTED, f"Task: {task.name}")
        self.commit(task)
        if not task.committed:
            self.release(task)
