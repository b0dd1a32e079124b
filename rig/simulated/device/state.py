"""The state of the virtual device: tasks, outputs, watchdog timers, planted faults, and the bench it is wired to.

Faults are what goes wrong in a lab, on demand, by time or by call. The service asks the plan before each call; passing
time lets it change what stands at the sensors' terminals.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rig.simulated.bench.bench_time import BenchTime
from rig.simulated.bench.plant_protocol import ENCODED_BODIES
from rig.simulated.bench.wiring import Wiring
from rig.simulated.device.faults import CAMERA, CELL, LASTING, SCALE, SENSORS, STATUS, Fault
from rig.simulated.device.reservations import Reservations
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product import Inventory
from rig.simulated.status import Code, DaqStatusError, ServerGone

DROPPED_FRAMES = 5  # by the fault of that name: choice
LOST_COUNTS = 300  # as above
OPEN_MV_PER_V = 1e4  # beyond any range
SILENT_NOISE_MV_PER_V = 3e-4  # of the amplifier alone: choice


class FaultPlan:
    """The faults of a bench, and which of them have struck."""

    def __init__(self, faults: tuple[Fault, ...] = ()) -> None:
        self.faults = faults
        self._calls: Counter[str] = Counter()
        self._struck: set[Fault] = set()
        self._held: dict[Fault, float] = {}

    def raise_due(self, call: str, device: DeviceState, timeout_s: float = 0.0) -> None:
        """Count a driver call by its name and raise the error of a planted fault that is due now or lasts; do nothing
        without one. Sensor faults by call begin here; a fault ``timeout`` first lets ``timeout_s`` pass on the bench.
        """
        self._calls[call] += 1
        for index, fault in enumerate(self.faults):
            if fault in self._struck:
                if fault.kind in LASTING:
                    self._raise_fault(fault, call)
            elif fault.kind in SENSORS and fault.call and self._is_due(fault, call, device):
                faults = list(self.faults)
                faults[index] = replace(fault, call="", number=0, trial=device.trial, at_s=device.bench.now_s)
                self.faults = tuple(faults)
            elif fault.kind not in SENSORS and self._is_due(fault, call, device):
                if fault.kind == "underrun":
                    for task in device.tasks.values():
                        task.progress.live &= task.type != "AO"  # the output keeps the volts it has
                elif fault.kind == "timeout":
                    device.bench.clock.advance(max(timeout_s, 0.0))  # nothing ticks: the outputs keep their values
                self._struck.add(fault)
                self._raise_fault(fault, call)

    def _is_due(self, fault: Fault, call: str, device: DeviceState) -> bool:
        if fault.call:
            return call == fault.call and self._calls[call] >= fault.number
        late = device.trial == fault.trial and device.bench.edge >= fault.at_s * device.bench.rate_hz
        return late and (call.startswith("Read") or fault.kind not in ("overwrite", "timeout"))

    def _raise_fault(self, fault: Fault, call: str) -> None:
        if fault.kind == "server-gone":
            raise ServerGone("planted")
        if fault.kind == "underrun" and call != "IsTaskDone":
            return  # the driver reports it to a client that asks about the output task
        raise DaqStatusError(STATUS[fault.kind], "planted", samples_read=0 if call.startswith("Read") else None)

    def drop_exposures(self, trial: int, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of exposures (n,) by each time (n,), s, of trial number ``trial``, less what planted faults drop: from
        a fault's time on ``count`` (n,) stands still for five exposures and stays five lower."""
        for fault in self.faults:
            if fault.kind in CAMERA and trial == fault.trial:
                at = self._held.get(fault)
                if at is None and (time_s >= fault.at_s).any():
                    at = self._held[fault] = float(count[time_s >= fault.at_s][0])
                if at is not None:
                    late = np.maximum(np.minimum(count, int(at)), count - DROPPED_FRAMES)
                    count = np.where(time_s >= fault.at_s, late, count)
        return count

    def apply_sensor_faults(
        self, trial: int, time_s: NDArray[np.float64], cell: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return cell output (n,), mV/V, and X4 counts (n, 4) of key, whippen, hammer, second head at times (n,), s, of
        trial number ``trial`` as faulty sensors give them from the fault's time on; the arrays given are not changed.
        """
        for fault in self.faults:
            after = time_s >= fault.at_s
            if trial != fault.trial or fault.kind not in (*CELL, *SCALE) or not after.any():
                continue
            cell, counts = cell.copy(), counts.copy()
            if fault.kind == "bridge-open":
                cell[after] = OPEN_MV_PER_V
            elif fault.kind == "saturated":
                cell[after] = self._held.setdefault(fault, float(cell[after][0]))
            elif fault.kind == "silent":
                noise = np.random.default_rng(int(time_s[0] * 1e6)).standard_normal(int(after.sum()))
                cell[after] = SILENT_NOISE_MV_PER_V * noise
            else:
                column = ENCODED_BODIES.index(fault.body)
                if fault.kind == "stuck":
                    counts[after, column] = int(self._held.setdefault(fault, float(counts[after, column][0])))
                else:
                    counts[after, column] -= LOST_COUNTS
        return cell, counts


@dataclass(eq=False)
class WatchdogTimer:
    """The timer of a watchdog timer task, and the expiration states of the outputs it reaches."""

    name: str
    timeout_s: float
    device: str = ""
    """Name of its device; the main one's may be left out."""
    volts: dict[str, float] = field(default_factory=dict)
    """By full name of the analog output."""
    levels: dict[str, int] = field(default_factory=dict)
    """The expiration states of the lines as the client gave them, by full name."""
    running: bool = False
    expired: bool = False
    reset_at_s: float = 0.0
    """Time on the bench's clock of the start or last reset, s."""

    def controls(self, channel: str) -> bool:
        """Whether an output stands at its expiration state and cannot be written."""
        return self.expired and (channel in self.volts or channel in self.levels)


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
    exports: dict[str, str] = field(default_factory=dict)
    """Terminals that carry another terminal's signal."""
    timebase: Inventory | None = None
    """The device whose clock the bench's edges follow in this trial."""
    let_clients_call: Callable[[], None] = lambda: None
    """Called between stretches of time within one call, so that other clients get a turn."""
    reservations: Reservations = field(init=False)

    def __post_init__(self) -> None:
        self.reservations = Reservations(self.inventory)

    def source_terminal(self, terminal: str) -> str:
        """Return the terminal whose signal a terminal carries, over a wire between devices or an export; the terminal
        itself where neither ends on it."""
        for _ in range(4):
            on_wire = self.wiring.wires.get(terminal, terminal)
            origin = self.exports.get(on_wire, on_wire)
            if origin == terminal:
                break
            terminal = origin
        return terminal

    @property
    def motor(self) -> str:
        return self.inventory.full_name(self.wiring.motor)

    def drive_enabled(self) -> bool:
        line = self.wiring.drive_enable
        return line is None or self.lines.get(self.inventory.full_name(line), False)


def commit(device: DeviceState, task: SimulatedTask) -> None:
    """Reserve the task's resources; refuses what another task has reserved."""
    if not task.channels:
        raise DaqStatusError(Code.CAN_NOT_PERFORM_OP_WHEN_NO_CHANS_IN_TASK, f"Task: {task.name}")
    device.reservations.reserve(task)
    if task.state == "unreserved":
        task.state = "committed"


def release(device: DeviceState, task: SimulatedTask) -> None:
    device.reservations.release(task)
    task.state, task.committed = "unreserved", False
