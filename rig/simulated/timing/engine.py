"""Timing engines of the virtual device: which task's clock ticks when, counted in edges of the bench.

Time passes in edges of the bench; an engine says which of its ticks fall on which edge. The engine that began the
trial ticks at every edge; another with a rate of its own takes the nearest edge before each of its ticks. A task that
takes its clock from a terminal ticks with the engine behind that terminal; on a terminal where nothing is connected
nothing ticks.

Start and arm start triggers: what waits for one, what begins to tick when it comes.

Whenever time has passed the triggers are checked. A task with a sample clock of its own sends a start trigger as it
begins; counter outputs, the camera's exposures and the encoders' A signals trigger by the edges on their terminals.
Where nothing is connected no trigger ever comes.

A counter output on a sample clock: each of its ticks loads the next pulses written, which begin with the next pulse.

The first ones are loaded when the task starts; a buffer that is used up begins again. Where no clock comes the first
pulses go on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Comparator, SimulatedTask
from rig.simulated.signals import edges_now, input_terminal, output_terminals, pulse_train, pulses_on

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


def load_pulses(device: DeviceState, task: SimulatedTask, edge: int, n: int) -> None:
    """Load what the clock's ticks on the next n edges of the bench call for."""
    engine, pulses = engine_of(device, task), task.pulses
    if engine is None:
        return
    first = max(engine.passed(edge), task.progress.first_tick)
    for at in engine.edges(first, max(engine.passed(edge + n), first)):
        train, now_s = pulse_train(task), float(at) / device.bench.rate_hz
        pulses.passed, pulses.next_s = train.passed_at(now_s), train.next_after(now_s)
        load(task, pulses.loaded + 1)


def load(task: SimulatedTask, number: int) -> None:
    """Load the pulses of sample ``number`` of the buffer."""
    pulses = task.pulses
    if pulses.written is None:
        return
    pulses.loaded = number
    high_s, low_s = pulses.written[number % pulses.written.shape[0]]
    name = task.channels[0].name
    task.properties["Chan", name, daqmx.CO_PULSE_FREQ] = float(1 / (high_s + low_s))
    task.properties["Chan", name, daqmx.CO_PULSE_DUTY_CYC] = float(high_s / (high_s + low_s))


def await_trigger(device: DeviceState, task: SimulatedTask) -> None:
    """Let a task wait for the next edge on its trigger's terminal."""
    progress = task.progress
    progress.live = progress.triggered = False
    if (shape := task.triggers.analog_start) is None:
        progress.trigger_edges = edges_now(device, task.triggers.begin)
        return
    alone = not any(_passes_time(other) for other in device.tasks.values() if other is not task)
    if alone and progress.comparator is None:
        _begin_trial(device, task)
    progress.comparator = Comparator(shape)


def _makes_time_pass(task: SimulatedTask) -> bool:
    return task.timing.own_clock or task.type == "CO"


def watches(task: SimulatedTask) -> bool:
    """Whether a task compares its input with the level of its analog start trigger: time passes meanwhile."""
    progress = task.progress
    return task.state == "running" and not progress.live and task.triggers.analog_start is not None


def _passes_time(task: SimulatedTask) -> bool:
    return watches(task) or (task.progress.live and _makes_time_pass(task))


def go_live(device: DeviceState, task: SimulatedTask) -> None:
    """Let a task's clock tick from here on, and those of the tasks that waited for it."""
    if _makes_time_pass(task) and not any(_passes_time(t) for t in device.tasks.values()):
        _begin_trial(device, task)
    if (reference := task.triggers.analog_reference) is not None:
        task.progress.comparator, task.progress.crossings = Comparator(reference), 0
    progress = task.progress
    progress.live, progress.live_since_s = True, device.bench.now_s
    progress.samples_before_trigger = task.total_samples
    engine = None if task.timing.own_clock else engine_of(device, task)
    progress.first_tick = engine.passed(device.bench.edge) if engine else 0
    if task.type == "CO":
        load(task, 0)
        task.pulses.passed, task.pulses.next_s, task.pulses.drift = 0, None, drift(device, task)
        task.pulses.end_s = pulse_train(task).end_s
    if task.measures == daqmx.EDGES:
        progress.initial_edges = edges_now(device, input_terminal(device, task, task.channels[0]))
    if task.timing.own_clock:
        owner = device.inventory.of(task.channels[0].physical.name)
        trigger = device.inventory.known_as(owner, f"{str(task.type).lower()}/StartTrigger")
        for other in _waiting(device):
            if device.carried(other.triggers.begin) == trigger:
                go_live(device, other)


def _begin_trial(device: DeviceState, task: SimulatedTask) -> None:
    bench, clock = device.bench, task.timing.clock
    rate_hz = clock.rate_hz if clock is not None else bench.rate_hz
    device.trial += 1
    device.handed_out = 0
    device.timebase = device.inventory.of(task.channels[0].physical.name)
    delay_s = device.timebase.input_delay_s(task.channels[0].physical.kind, rate_hz)
    written = [t.output.samples for t in device.tasks.values() if t.type == "AO" and t.output.samples is not None]
    bench.begin(
        device.trial, rate_hz, delay_s,
        by_operator=bool(written) and not any(v.any() for v in written), by_pianist=not written,
    )  # fmt: skip
    for other in _waiting(device):
        other.progress.trigger_edges = 0


def _waiting(device: DeviceState) -> list[SimulatedTask]:
    tasks = device.tasks.values()
    return [task for task in tasks if task.state == "running" and not task.progress.live and task.triggers.begin]


def edges_to_trigger(device: DeviceState) -> float:
    """Return how many edges of the bench pass before the next trigger a task waits for; infinite for none."""
    bench, nearest = device.bench, float("inf")
    if any(watches(task) for task in device.tasks.values()):
        return 1.0  # when the input crosses the level is known only afterwards
    for task in _waiting(device):
        terminal = task.triggers.begin
        train = pulses_on(device, terminal)
        if train is not None:
            at_s = train.next_after(bench.now_s)
            nearest = min(nearest, max(np.ceil(at_s * bench.rate_hz - 1e-6) - bench.edge, 1.0))
        elif any(terminal == a_terminal for a_terminal, _ in device.wiring.encoders):
            nearest = 1.0  # when an encoder moves on is known only afterwards
    return nearest


def check_triggers(device: DeviceState) -> None:
    """Start what waited for an edge that has come; a finished retriggerable task waits for the next one."""
    for task in _waiting(device):
        if edges_now(device, task.triggers.begin) > task.progress.trigger_edges:
            go_live(device, task)
    for task in list(device.tasks.values()):
        if watches(task) and task.progress.triggered:
            go_live(device, task)
    for task in device.tasks.values():
        if task.progress.live and task.retriggerable and task.samples_remaining <= 0:
            await_trigger(device, task)
