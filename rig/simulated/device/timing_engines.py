"""Timing engines of the virtual device: which task's clock ticks when, counted in edges of the bench.

Place in the data flow: the device moves the bench by edges; an engine says which of its ticks fall on which edge. The
engine that began the trial ticks at every edge; another with a rate of its own takes the nearest edge before each
of its ticks. A task that takes its clock from a terminal ticks with the engine behind that terminal; on a terminal
where nothing is connected nothing ticks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.input_readings import edge_terminal
from rig.simulated.device.pulse_trains import driver_of, pulse_train
from rig.simulated.device.task import FINITE, SimulatedTask

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

_LITTLE = 1e-6
CO_TERM = 0x18E1


@dataclass(frozen=True)
class Engine:
    """Ticks ``first_s + k / rate_hz``, at most ``limit`` of them, on edges of the bench at ``bench_hz``."""

    rate_hz: float
    first_s: float
    bench_hz: float
    limit: float = float("inf")

    def passed(self, edge: int) -> int:
        """Return the number of ticks before the bench's edge number ``edge``."""
        ticks = math.ceil((edge - self.first_s * self.bench_hz - _LITTLE) * (self.rate_hz / self.bench_hz))
        return int(min(max(ticks, 0), self.limit))

    def edges(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the bench's edge on which each of the ticks ``first`` … ``last - 1`` falls."""
        at = self.first_s * self.bench_hz + np.arange(first, last) * (self.bench_hz / self.rate_hz)
        return np.floor(at + _LITTLE).astype(np.int64)

    def edge_after(self, ticks: int) -> int:
        """Return the number of edges by which ``ticks`` ticks have passed."""
        return int(self.edges(ticks - 1, ticks)[0]) + 1 if ticks > 0 else 0


def own_clock(task: SimulatedTask) -> bool:
    """Whether a task has a sample clock of its own."""
    return task.clock is not None and not task.clock.source and not task.changes and not task.implicit


def engine_of(device: SimulatedDevice, task: SimulatedTask) -> Engine | None:
    """Return the engine that clocks a task; None when nothing ticks for it."""
    if task.clock is None or task.changes:
        return None
    if task.implicit:
        return _behind_pulses(device, task)
    if own_clock(task):
        if not task.live:
            return None
        limit = task.clock.samples if task.clock.mode == FINITE and not task.ref_trigger else float("inf")
        return Engine(task.clock.rate_hz, task.since_s, device.bench.rate_hz, limit)
    return _behind(device, task.clock.source, {task.name})


def _behind_pulses(device: SimulatedDevice, task: SimulatedTask) -> Engine | None:
    """Return the engine of a counter that takes one sample from each pulse: with the edge that ends it."""
    train = driver_of(device, edge_terminal(device, task, task.channels[0]))
    if train is None or not task.live or task.clock is None:
        return None
    first_s = train.next_after(task.since_s) + 1 / train.rate_hz
    pulses = train.count - train.passed(np.array([task.since_s]))[0] - 1
    limit = min(pulses, task.clock.samples) if task.clock.mode == FINITE else pulses
    return Engine(train.rate_hz, first_s, device.bench.rate_hz, limit) if limit > 0 else None


def _behind(device: SimulatedDevice, terminal: str, seen: set[str]) -> Engine | None:
    terminal = device.exports.get(terminal, terminal)
    stem, _, signal = terminal.partition("/")
    if signal == "SampleClock":
        for task in _others(device, seen):
            if task.type == stem.upper() and task.clock is not None and not task.changes and task.live:
                if own_clock(task):
                    return engine_of(device, task)
                return _behind(device, task.clock.source, {*seen, task.name})
        return None
    for task in _others(device, seen):
        if task.type == "CO" and task.live and terminal in output_terminals(device, task):
            train = pulse_train(task)
            return Engine(train.rate_hz, train.first_s, device.bench.rate_hz, train.count)
    return None


def _others(device: SimulatedDevice, seen: set[str]) -> Iterable[SimulatedTask]:
    return [task for task in device.tasks.values() if task.name not in seen]


def output_terminals(device: SimulatedDevice, task: SimulatedTask) -> set[str]:
    """Return the terminals, relative to the device, that carry a counter output's pulses."""
    channel = task.channels[0]
    found = {f"Ctr{channel.physical.resource.removeprefix('ctr')}InternalOutput"}
    if named := task.setting("Chan", channel.name, CO_TERM, ""):
        found.add(device.inventory.terminal(named))
    elif default := device.inventory.counter_terminal(channel.physical, "out"):
        found.add(default)
    return found
