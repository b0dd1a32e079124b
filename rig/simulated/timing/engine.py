"""Timing engines of the virtual device: which task's clock ticks when, counted in edges of the bench.

Time passes in edges of the bench; an engine says which of its ticks fall on which edge. The engine that began the
trial ticks at every edge; another with a rate of its own takes the nearest edge before each of its ticks. A task that
takes its clock from a terminal ticks with the engine behind that terminal; on a terminal where nothing is connected
nothing ticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.pulses import input_terminal, output_terminals, pulse_train, pulses_on

_TOLERANCE_EDGES = 1e-6
"""By so much a tick may miss an edge through rounding."""


@dataclass(frozen=True)
class Engine:
    """Ticks ``first_s + k / rate_hz``, at most ``limit`` of them, on edges of the bench at ``bench_hz``."""

    rate_hz: float
    first_s: float
    bench_hz: float
    limit: float = float("inf")

    def passed(self, edge: int) -> int:
        """Return the number of ticks before the bench's edge number ``edge``."""
        ticks = math.ceil((edge - self.first_s * self.bench_hz - _TOLERANCE_EDGES) * (self.rate_hz / self.bench_hz))
        return int(min(max(ticks, 0), self.limit))

    def edges(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the bench's edge on which each of the ticks ``first`` … ``last - 1`` falls."""
        at = self.first_s * self.bench_hz + np.arange(first, last) * (self.bench_hz / self.rate_hz)
        return np.floor(at + _TOLERANCE_EDGES).astype(np.int64)

    def edge_after(self, ticks: int) -> int:
        """Return the number of edges by which ``ticks`` ticks have passed."""
        return int(self.edges(ticks - 1, ticks)[0]) + 1 if ticks > 0 else 0


def engine_of(device: DeviceState, task: SimulatedTask) -> Engine | None:
    """Return the engine that clocks a task; None when nothing ticks for it."""
    clock = task.timing.clock
    if clock is None or task.timing.change_lines:
        return None
    if task.timing.implicit:
        return _engine_of_pulses(device, task)
    if task.timing.own_clock:
        if not task.progress.live:
            return None
        counted = task.timing.finite and not task.triggers.referenced and not task.triggers.pause
        limit = clock.samples if counted else float("inf")
        return Engine(clock.rate_hz * drift(device, task), task.progress.live_since_s, device.bench.rate_hz, limit)
    return _engine_behind(device, clock.source, {task.name})


def drift(device: DeviceState, task: SimulatedTask) -> float:
    """Return the rate of a device's own timebase over that of the device that began the trial."""
    if device.timebase is None:
        return 1.0
    own = device.inventory.of(task.channels[0].physical.name)
    return (1.0 + own.clock_error) / (1.0 + device.timebase.clock_error)


def _engine_of_pulses(device: DeviceState, task: SimulatedTask) -> Engine | None:
    """Return the engine of a counter that takes one sample from each pulse: it ticks with the edge that ends it."""
    train = pulses_on(device, input_terminal(device, task, task.channels[0]))
    clock, since_s = task.timing.clock, task.progress.live_since_s
    if train is None or not task.progress.live or clock is None:
        return None
    first_s = train.next_after(since_s) + 1 / train.rate_hz
    pulses = train.count - train.passed_at(since_s) - 1
    limit = min(pulses, clock.samples) if task.timing.finite else pulses
    return Engine(train.rate_hz, first_s, device.bench.rate_hz, limit) if limit > 0 else None


def _engine_behind(device: DeviceState, terminal: str, seen: set[str]) -> Engine | None:
    """Return the engine whose ticks a terminal carries; ``seen`` names the tasks on the way, against loops."""
    terminal = device.carried(terminal)
    owner = device.inventory.of(terminal) if terminal.startswith("/") else device.inventory
    stem, _, signal = device.inventory.own_name(terminal).partition("/")
    others = [task for task in device.tasks.values() if task.name not in seen and task.progress.live]
    if signal == "SampleClock":
        for task in others:
            timing = task.timing
            own = task.channels and device.inventory.of(task.channels[0].physical.name) is owner
            if own and task.type == stem.upper() and timing.clock is not None and not timing.change_lines:
                if timing.own_clock:
                    return engine_of(device, task)
                return _engine_behind(device, timing.clock.source, {*seen, task.name})
        return None
    for task in others:
        if task.type == "CO" and terminal in output_terminals(device, task):
            train = pulse_train(task)
            return Engine(train.rate_hz, train.first_s, device.bench.rate_hz, train.count)
    return None
