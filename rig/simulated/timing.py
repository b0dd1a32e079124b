"""How time passes on the virtual device: sample clocks, triggers, and waiting for samples. Time moves nowhere else.

Time passes in edges of the bench: outputs, plant, inputs, in this order. An engine says which of its ticks fall on
which edge. The engine that began the trial ticks at every edge; another with a rate of its own takes the nearest edge
before each of its ticks. A task that takes its clock from a terminal ticks with the engine behind that terminal; on a
terminal where nothing is connected nothing ticks. Sample k of AI and CI is latched at edge k; sample k of AO is
generated at edge k and stays until the next.

Whenever time has passed the triggers are checked. A task with a sample clock of its own sends a start trigger as it
begins; counter outputs, the camera's exposures and the encoders' A signals trigger by the edges on their terminals.

A wait for samples or for a timeout lets pass what it takes. Beyond that the rule is:
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.simulated.bench.clock import POLL_S
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.signals import (
    edges_now,
    encoder_counts,
    input_terminal,
    latch,
    output_terminals,
    pulse_train,
    pulses_on,
    set_outputs,
)

_TOLERANCE_EDGES = 1e-6  # that a tick may miss an edge by rounding


@dataclass(frozen=True)
class Engine:
    """Ticks ``first_s + k / rate_hz``, at most ``limit`` of them, on edges of the bench at ``bench_hz``."""

    rate_hz: float
    first_s: float
    bench_hz: float
    limit: float = float("inf")

    def count_ticks(self, edge: int) -> int:
        """Return the number of ticks before the bench's edge number ``edge``."""
        ticks = math.ceil((edge - self.first_s * self.bench_hz - _TOLERANCE_EDGES) * (self.rate_hz / self.bench_hz))
        return int(min(max(ticks, 0), self.limit))

    def edges(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the bench's edge on which each of the ticks ``first`` … ``last - 1`` falls."""
        at = self.first_s * self.bench_hz + np.arange(first, last) * (self.bench_hz / self.rate_hz)
        return np.floor(at + _TOLERANCE_EDGES).astype(np.int64)

    def edge_after(self, ticks: int) -> int:
        return int(self.edges(ticks - 1, ticks)[0]) + 1 if ticks > 0 else 0


def find_clock_engine(device: DeviceState, task: SimulatedTask) -> Engine | None:
    """Return the engine (rate, first tick, number of ticks) that clocks a task: its own clock while it is live, or what
    ticks on the terminal of its source; None without a sample clock or where nothing ticks there."""
    clock = task.clock
    if clock is None:
        return None
    if not task.has_own_clock:
        return _find_engine(device, clock.source, {task.name})
    if not task.progress.live:
        return None
    limit = clock.samples if task.is_finite else float("inf")
    return Engine(clock.rate_hz * drift(device, task), task.progress.live_since_s, device.bench.rate_hz, limit)


def drift(device: DeviceState, task: SimulatedTask) -> float:
    """Return the rate of a device's own timebase over that of the device that began the trial."""
    if device.timebase is None:
        return 1.0
    module = device.inventory.owner_of(task.channels[0].physical.name)
    return (1.0 + module.clock_error) / (1.0 + device.timebase.clock_error)


def _find_engine(device: DeviceState, terminal: str, visited: set[str]) -> Engine | None:
    """Return the engine (rate, first tick, number of ticks) whose ticks a terminal carries, None where none does;
    ``visited``: names of the tasks on the way, which are not followed again."""
    terminal = device.source_terminal(terminal)
    owner = device.inventory.owner_of(terminal) if terminal.startswith("/") else device.inventory
    stem, _, signal = device.inventory.own_name(terminal).partition("/")
    others = [task for task in device.tasks.values() if task.name not in visited and task.progress.live]
    if signal == "SampleClock":
        for task in others:
            is_same_owner = task.channels and device.inventory.owner_of(task.channels[0].physical.name) is owner
            if is_same_owner and task.type == stem.upper() and task.clock is not None:
                if task.has_own_clock:
                    return find_clock_engine(device, task)
                return _find_engine(device, task.clock.source, {*visited, task.name})
        return None
    for task in others:
        if task.type == "CO" and terminal in output_terminals(device, task):
            train = pulse_train(task)
            return Engine(train.rate_hz, train.first_s, device.bench.rate_hz, train.count)
    return None


def await_trigger(device: DeviceState, task: SimulatedTask) -> None:
    task.progress.trigger_edges = edges_now(device, task.triggers.begin)


def _makes_time_pass(task: SimulatedTask) -> bool:
    return task.has_own_clock or task.type == "CO"


def go_live(device: DeviceState, task: SimulatedTask) -> None:
    """Let a task sample or put out pulses from now on, and with it the tasks that wait for its start trigger; the first
    task that makes time pass begins a new trial of the bench, at rest."""
    if _makes_time_pass(task) and not any(t.progress.live and _makes_time_pass(t) for t in device.tasks.values()):
        _begin_trial(device, task)
    progress = task.progress
    progress.live, progress.live_since_s = True, device.bench.now_s
    engine = None if task.has_own_clock else find_clock_engine(device, task)
    progress.first_tick = engine.count_ticks(device.bench.edge) if engine else 0
    channel, clock = task.channels[0], task.clock
    owner, wired = device.inventory.owner_of(channel.physical.name), device.inventory.full_name(device.wiring.force)
    if task.type == "CO":
        task.pulses.drift = drift(device, task)
        task.pulses.end_s = pulse_train(task).end_s
    elif task.counts_edges:
        progress.initial_edges = edges_now(device, input_terminal(device, task))
    elif task.type == "CI":
        progress.initial_edges = int(encoder_counts(device, task, device.bench.quarter)[0])
    if clock is not None and (cell := next((c for c in task.channels if c.physical.name == wired), None)):
        device.bench.delay_force(owner.input_delay_s(cell.physical.kind, clock.rate_hz))
    if task.has_own_clock:
        trigger = device.inventory.known_as(owner, f"{str(task.type).lower()}/StartTrigger")
        for other in _waiting(device):
            if device.source_terminal(other.triggers.begin) == trigger:
                go_live(device, other)


def _begin_trial(device: DeviceState, task: SimulatedTask) -> None:
    """Begin the bench's next trial, at rest, at the rate of the task's sample clock, edges counted from 0. The virtual
    operator may act where the motor's samples are all 0 V, the virtual pianist where none were written."""
    bench, clock = device.bench, task.clock
    rate_hz = clock.rate_hz if clock is not None else bench.rate_hz
    device.trial += 1
    device.handed_out = 0
    device.timebase = device.inventory.owner_of(task.channels[0].physical.name)
    written = [t.output.samples for t in device.tasks.values() if t.type == "AO" and t.output.samples is not None]
    bench.begin(
        device.trial, rate_hz,
        by_operator=bool(written) and not any(v.any() for v in written), by_pianist=not written,
    )  # fmt: skip
    for other in device.tasks.values():  # what is live already counts and waits from the new trial's first edge on
        other.progress.trigger_edges = other.progress.initial_edges = 0
        other.progress.live_since_s = 0.0


def _waiting(device: DeviceState) -> list[SimulatedTask]:
    tasks = device.tasks.values()
    return [task for task in tasks if task.state == "running" and not task.progress.live and task.triggers.begin]


def edges_to_trigger(device: DeviceState) -> float:
    """Return how many edges of the bench pass before the next trigger a task waits for; infinite for none."""
    bench, nearest = device.bench, float("inf")
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
    for task in _waiting(device):
        if edges_now(device, task.triggers.begin) > task.progress.trigger_edges:
            go_live(device, task)


def advance_bench(device: DeviceState, n: int) -> None:
    """Advance the bench by ``n`` edges: generate the outputs of live tasks, move the plant (at 0 V while the drive is
    disabled), fill the buffers of live input tasks. Triggers and watchdogs are not looked at."""
    bench, edge = device.bench, device.bench.edge
    clocked = [
        (task, engine)
        for task in device.tasks.values()
        if task.progress.live and task.type != "CO" and (engine := find_clock_engine(device, task)) is not None
    ]
    volts = np.full(n + 1, device.output_v.get(device.motor, 0.0))  # just before the edges, then from each of them on
    command_v = volts[1:]
    for task, engine in clocked:
        if task.type == "AO":
            _generate(device, task, engine, command_v)
    at_s = (edge + np.arange(n)) / bench.rate_hz
    bench.set_motor_volts(volts)
    cell, quarter = bench.step(command_v if device.drive_enabled() else np.zeros(n))
    cell, quarter = device.faults.apply_sensor_faults(device.trial, at_s, cell, quarter)
    for task, engine in clocked:
        if task.buffer is None:
            continue
        first, last = _ticks(task, engine, edge, n)
        last = min(last, first + int(min(task.samples_remaining, last - first)))
        rows = np.clip(engine.edges(first, last) - edge, 0, n - 1)
        if rows.size:
            task.buffer.append(latch(device, task, cell[rows], quarter[rows], edge + rows))
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and bench.now_s >= task.pulses.end_s:
            task.pulses.finished = True


def _ticks(task: SimulatedTask, engine: Engine, edge: int, n: int) -> tuple[int, int]:
    """First tick of an engine in ``n`` edges from ``edge`` on, and the first after them; none before the task's."""
    first = task.progress.first_tick
    return max(engine.count_ticks(edge), first), max(engine.count_ticks(edge + n), first)


def _generate(device: DeviceState, task: SimulatedTask, engine: Engine, command_v: NDArray[np.float64]) -> None:
    """Put out a task's samples that fall on the next edges of the bench: those of the motor's channel go into
    ``command_v`` (n,), V, each from its edge on; the last row stays at the outputs."""
    edge, n = device.bench.edge, command_v.size
    first, last = _ticks(task, engine, edge, n)
    rows = task.generate(last - first)
    if not rows.shape[0]:
        return
    at = (engine.edges(first, last) - edge)[: rows.shape[0]]
    set_outputs(device, task, rows[-1])
    for column, channel in enumerate(task.channels):
        if channel.physical.name == device.motor:
            last_row = np.searchsorted(at, np.arange(n), side="right") - 1
            reached = last_row >= 0
            command_v[reached] = rows[last_row[reached], column]


STRETCH_S = 0.02  # of virtual time that passes at once: as long as a block
CALL_S = 1e-3  # of virtual time: a further question in a row, or a reading on demand without a sample clock
MOST_DUE_S = 0.5  # that passes by itself at once; a bench that cannot keep up with its clock falls behind it
ENDLESS = np.iinfo(np.int64).max


def edges_in(device: DeviceState, duration_s: float) -> int:
    """Return how many edges of the bench to let pass for a short time: at least one."""
    return max(int(duration_s * device.bench.rate_hz), 1)


def advance(device: DeviceState, n: int) -> int:
    """Let at most n edges of the bench pass, looking after triggers and watchdogs and giving other clients a turn;
    return how many did, fewer where no task that makes time pass has anything left to do."""
    left = n
    stretch = edges_in(device, STRETCH_S) if device.bench.clock.paced else n
    while left > 0:
        due = _edges_to_expiry(device)
        now = int(min(left, stretch, _edges_to_end(device), edges_to_trigger(device), due))
        if now <= 0:
            break
        advance_bench(device, now)
        check_triggers(device)
        left -= now
        if now == due:
            check_watchdogs(device)
        if left > 0:
            device.let_clients_call()
    return n - left


def _edges_to_expiry(device: DeviceState) -> float:
    """Number of edges until the next watchdog expires; infinite where none runs, and on a paced clock, where watchdogs
    are checked after every stretch."""
    clock = device.bench.clock
    left_s = [
        timer.timeout_s - (clock.elapsed_s - timer.reset_at_s)
        for timer in device.watchdogs.values()
        if timer.running and not timer.expired and not clock.paced
    ]
    return max(np.floor(min(left_s) * device.bench.rate_hz), 0.0) + 1 if left_s else float("inf")


def _edges_to_end(device: DeviceState) -> float:
    """Number of edges until the last live task that makes time pass, by a sample clock of its own or by pulses, has
    ended; 0 without one, infinite for one without end."""
    left = 0.0
    for task in device.tasks.values():
        if not task.progress.live:
            continue
        if task.type == "CO":
            left = max(left, 0.0 if task.pulses.finished else _edges_to_pulse_end(device, task))
        elif task.has_own_clock and (engine := find_clock_engine(device, task)) is not None:
            ended = float("inf") if np.isinf(engine.limit) else engine.edge_after(int(engine.limit))
            left = max(left, ended - device.bench.edge)
    return left


def _edges_to_pulse_end(device: DeviceState, task: SimulatedTask) -> float:
    return float(np.ceil(task.pulses.end_s * device.bench.rate_hz) - device.bench.edge) + 1


def wait_for_samples(device: DeviceState, task: SimulatedTask, missing: int, timeout_s: float) -> None:
    """Let time pass until a task has ``missing`` more samples per channel, has failed or was stopped, or ``timeout_s``
    is over (negative: never); nothing is raised, the caller looks how many came."""
    if task.buffer is not None:
        allowed = _edges_of_timeout(device, timeout_s)
        wanted = task.buffer.acquired + missing
        while allowed > 0 and task.state == "running" and not task.progress.error and task.buffer.acquired < wanted:
            passed = advance(device, int(min(_edges_to_sample(device, task, wanted), allowed)))
            if not passed:
                break
            allowed -= passed
        if task.buffer.acquired >= wanted or task.progress.error:
            return
        timeout_s = allowed / device.bench.rate_hz
    wait_for_timeout(device, task, timeout_s)


def wait_for_timeout(device: DeviceState, task: SimulatedTask, timeout_s: float) -> None:
    """Let ``timeout_s`` (negative: no end) pass on the clock, but no edge, for a running task for which nothing ticks;
    other clients get a turn, and may end it."""
    if timeout_s < 0:
        timeout_s = float(ENDLESS) / device.bench.rate_hz
    while timeout_s > 0 and task.state == "running" and not task.progress.error:
        now_s = min(timeout_s, STRETCH_S) if device.bench.clock.paced else timeout_s
        device.bench.clock.advance(now_s)
        timeout_s -= now_s
        device.let_clients_call()


def _edges_to_sample(device: DeviceState, task: SimulatedTask, wanted: int) -> float:
    """Number of edges to let pass before looking whether a task has acquired ``wanted`` samples since its start: up to
    that sample, to the next trigger where it waits for one, else a short poll."""
    poll = edges_in(device, POLL_S)
    if not task.progress.live:
        to_trigger = edges_to_trigger(device)
        return to_trigger if np.isfinite(to_trigger) else poll
    engine = find_clock_engine(device, task)
    if engine is None:
        return poll
    return max(engine.edge_after(task.progress.first_tick + wanted) - device.bench.edge, 1)


def wait_until_done(device: DeviceState, task: SimulatedTask, timeout_s: float) -> None:
    """Let time pass until a task is done or has failed, at most ``timeout_s`` (negative: no end), and only while
    something runs; nothing is raised."""
    allowed = _edges_of_timeout(device, timeout_s)
    while allowed > 0 and not task.is_done and not task.progress.error:
        passed = advance(device, int(min(edges_in(device, CALL_S), allowed)))
        if not passed:  # nothing runs that could end
            return
        allowed -= passed


def _edges_of_timeout(device: DeviceState, timeout_s: float) -> int:
    """Return a timeout in edges of the bench; a negative one has no end, one that is not a number has ended."""
    if timeout_s < 0 or timeout_s * device.bench.rate_hz > ENDLESS:
        return int(ENDLESS)
    return int(timeout_s * device.bench.rate_hz + 1e-9) if timeout_s > 0 else 0


def let_pass(device: DeviceState, duration_s: float) -> None:
    clock = device.bench.clock
    end_s = clock.now_s + duration_s
    advance(device, int(duration_s * device.bench.rate_hz))
    if (left_s := end_s - clock.now_s) > 0:
        clock.advance(left_s)


def pass_due_time(device: DeviceState) -> None:
    """On a paced clock let the time pass by which the bench is behind it, at most 0.5 s at once, if a task is live; on
    the virtual clock do nothing."""
    clock = device.bench.clock
    if not clock.paced:
        return
    running = any(task.progress.live for task in device.tasks.values())
    due = int(min(clock.due_s, MOST_DUE_S) * device.bench.rate_hz)
    if running and due > 0:
        advance(device, due)


def await_something(device: DeviceState, task: SimulatedTask) -> None:
    """Let a question about samples take its time on the virtual clock, when there are none to read."""
    if not device.bench.clock.paced and task.progress.live and task.buffer is not None and not task.buffer.available:
        advance(device, edges_in(device, POLL_S))


def question_asked(device: DeviceState, *, again: bool) -> None:
    """Let a question about a task take its time on the virtual clock, when the call before was one too."""
    if again and not device.bench.clock.paced:
        advance(device, edges_in(device, CALL_S))


def settle_on_demand(device: DeviceState) -> None:
    """Before a reading on demand let a little time pass, so that outputs written on demand act: 1 ms, on a paced clock
    what is due; do nothing where a live task makes time pass."""
    if any(task.progress.live and _makes_time_pass(task) for task in device.tasks.values()):
        return
    clock, rate_hz = device.bench.clock, device.bench.rate_hz
    due_s = min(clock.due_s, MOST_DUE_S) if clock.paced else CALL_S
    device.bench.present()  # begins a trial of its own where there was none
    if (n := int(due_s * rate_hz)) > 0:
        advance_bench(device, n)
    clock.begin()
