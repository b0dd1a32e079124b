"""Start and arm start triggers: what waits for one, what begins to tick when it comes.

Whenever time has passed the triggers are checked. A task with a sample clock of its own sends a start trigger as it
begins; counter outputs, the camera's exposures and the encoders' A signals trigger by the edges on their terminals.
Where nothing is connected no trigger ever comes.
"""

from __future__ import annotations

import numpy as np

from rig.simulated import daqmx
from rig.simulated.device.comparator import Comparator
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.pulses import edges_now, input_terminal, pulse_train, pulses_on
from rig.simulated.timing.clocked_pulses import load
from rig.simulated.timing.engine import drift, engine_of


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
