"""Pulse trains and edges on terminals: what a counter puts out, and what a counter that counts edges sees.

Place in the data flow: counter outputs, the A signals of the scales and the camera's exposure signal → edges on a
terminal → the count that an edge counter latches. A terminal where nothing is connected has no edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.task import SimulatedTask

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

CO_FREQ, CO_DELAY, CO_DUTY = 0x1178, 0x299, 0x1176


@dataclass(frozen=True)
class PulseTrain:
    """Rising edges at ``first_s + k / rate_hz``, ``count`` of them (may be infinite); high for ``high_s`` each."""

    rate_hz: float
    first_s: float
    count: float
    high_s: float
    before: int = 0
    """Edges that had passed before ``first_s``."""

    def passed(self, time_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return how many rising edges have passed by each time."""
        edges = np.floor((time_s - self.first_s) * self.rate_hz + 1e-9) + 1
        return np.asarray(np.clip(self.before + np.maximum(edges, 0), 0, self.count), dtype=np.int64)

    def next_after(self, time_s: float) -> float:
        """Return when the next rising edge comes; infinite when there is none."""
        passed = int(self.passed(np.array([time_s]))[0])
        return self.first_s + (passed - self.before) / self.rate_hz if passed < self.count else float("inf")

    def until(self, time_s: float) -> NDArray[np.float64]:
        """Return the times of the rising edges up to ``time_s``."""
        return self.first_s + np.arange(int(self.passed(np.array([time_s]))[0])) / self.rate_hz

    @property
    def end_s(self) -> float:
        """When the last pulse has ended."""
        last = self.count - 1 - self.before
        return self.first_s + last / self.rate_hz + self.high_s if np.isfinite(self.count) else float("inf")


def pulse_train(task: SimulatedTask) -> PulseTrain:
    """Return the pulses a counter output puts out from the moment it became live."""
    name = task.channels[0].name
    rate = task.setting("Chan", name, CO_FREQ, 1.0)
    first = task.since_s + task.setting("Chan", name, CO_DELAY, 0.0) if task.next_pulse_s is None else task.next_pulse_s
    count = float("inf") if task.pulses is None else float(task.pulses)
    return PulseTrain(rate, first, count, task.setting("Chan", name, CO_DUTY, 0.5) / rate, task.pulses_before)


def _output_on(device: SimulatedDevice, terminal: str) -> SimulatedTask | None:
    from rig.simulated.device.timing_engines import output_terminals

    terminal = device.exports.get(terminal, terminal)
    for task in device.tasks.values():
        if task.type == "CO" and task.live and terminal in output_terminals(device, task):
            return task
    return None


def driver_of(device: SimulatedDevice, terminal: str) -> PulseTrain | None:
    """Return the pulses on a terminal, relative to the device; None when nothing pulses there."""
    task = _output_on(device, terminal)
    if task is not None:
        return pulse_train(task)
    return device.bench.exposures if terminal == device.wiring.exposure else None


def highs_of(
    device: SimulatedDevice, terminal: str, train: PulseTrain, number: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return how long each of these pulses (n,) on a terminal is high, s."""
    task = _output_on(device, terminal)
    if task is None or task.pulse_highs_s is None:
        return np.full(number.size, train.high_s)
    return task.pulse_highs_s[number % task.pulse_highs_s.size]


def edges_until(device: SimulatedDevice, terminal: str, edge: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many rising edges have passed on a terminal by each edge of the bench."""
    if (train := driver_of(device, terminal)) is not None:
        time_s = edge / device.bench.rate_hz
        passed = train.passed(time_s)
        return device.faults.exposures(device.trial, time_s, passed) if train is device.bench.exposures else passed
    for body, (a_terminal, _) in enumerate(device.wiring.encoders):
        if terminal == a_terminal:
            return device.bench.a_edges(body, edge)
    return np.zeros(edge.size, dtype=np.int64)
