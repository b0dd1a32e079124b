"""Starting tasks: what is reserved, what waits for a trigger, what begins to tick when the trigger comes.

Place in the data flow: the device starts a task here; whenever time has passed the triggers are looked for. A task with
a clock of its own puts out a start trigger as it begins; counter outputs, the camera's exposures and the scales' A
signals trigger by the edges on their terminals. Where nothing is connected no trigger ever comes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.simulated import status
from rig.simulated.device.input_readings import EDGES, PAIRS, edge_terminal
from rig.simulated.device.pulse_trains import driver_of, edges_until, pulse_train
from rig.simulated.device.task import Buffer, SimulatedTask
from rig.simulated.device.timing_engines import engine_of, own_clock
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

OUTPUT_BUFFER = 0x186D
INPUTS = ("AI", "CI", "DI")


def start(device: SimulatedDevice, task: SimulatedTask) -> None:
    """Start a task: reserve what it needs, then go live or wait for its trigger."""
    if task.state == "running":
        raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
    if device.watchdogs.started(task):
        return
    if task.type in ("AO", "DO") and task.output is None and task.clock is not None:
        raise DaqStatusError(status.NO_DATA_WRITTEN, f"Task: {task.name}")
    device.commit(task)
    if task.output is not None:
        task.capacity = max(int(task.setting("Buffer", "", OUTPUT_BUFFER, 0)), task.output.shape[0])
    task.state, task.generated, task.finished, task.error, task.before_trigger = "running", 0, False, 0, 0
    if task.type in INPUTS:
        columns = sum(len(channel.settings.get("lines", "1")) for channel in task.channels)
        if task.type == "CI":
            columns = 2 if task.channels[0].settings.get("measures") in PAIRS else 1
        task.ref_edges = task.ref_end = None
        task.buffer = Buffer(task.buffer_size, columns, forgets=bool(task.ref_trigger))
    # a trigger that is waited for must still come; one that has passed never comes again
    if task.waits_for:
        await_trigger(device, task)
    else:
        go_live(device, task)


def await_trigger(device: SimulatedDevice, task: SimulatedTask) -> None:
    """Let a task wait for the next edge on its trigger's terminal."""
    task.live = False
    task.trigger_edges = _edges_now(device, task.waits_for)


def _edges_now(device: SimulatedDevice, terminal: str) -> int:
    return int(edges_until(device, terminal, np.array([device.bench.edge]))[0])


def _times(task: SimulatedTask) -> bool:
    """Whether a task makes time pass by itself."""
    return own_clock(task) or task.type == "CO"


def go_live(device: SimulatedDevice, task: SimulatedTask) -> None:
    """Let a task's clock tick from here on, and those that waited for it."""
    if _times(task) and not any(other.live and _times(other) for other in device.tasks.values()):
        _begin_trial(device, task)
    task.live, task.since_s, task.before_trigger = True, device.bench.edge / device.bench.rate_hz, task.so_far
    engine = None if own_clock(task) else engine_of(device, task)
    task.since_tick = engine.passed(device.bench.edge) if engine else 0
    if task.type == "CO":
        task.pulses_before, task.next_pulse_s = 0, None
        task.pulse_end_s = pulse_train(task).end_s
    if task.type == "CI" and task.channels[0].settings.get("measures") == EDGES:
        task.counted = _edges_now(device, edge_terminal(device, task, task.channels[0]))
    if own_clock(task):
        trigger = f"{str(task.type).lower()}/StartTrigger"
        for other in _waiting(device):
            if device.exports.get(other.waits_for, other.waits_for) == trigger:
                go_live(device, other)


def _begin_trial(device: SimulatedDevice, task: SimulatedTask) -> None:
    bench = device.bench
    rate_hz = task.clock.rate_hz if task.clock is not None else bench.rate_hz
    device.trial += 1
    delay_s = device.inventory.input_delay_s(task.channels[0].physical.kind, rate_hz)
    loaded = [t.output for t in device.tasks.values() if t.type == "AO" and t.output is not None]
    bench.begin(device.trial, rate_hz, delay_s, by_hand=bool(loaded) and not any(o.any() for o in loaded))
    for other in _waiting(device):
        other.trigger_edges = 0


def _waiting(device: SimulatedDevice) -> list[SimulatedTask]:
    return [t for t in device.tasks.values() if t.state == "running" and not t.live and t.waits_for]


def edges_to_trigger(device: SimulatedDevice) -> float:
    """Return how many edges of the bench pass before the next trigger somebody waits for; infinite for none."""
    bench, nearest = device.bench, float("inf")
    for task in _waiting(device):
        train = driver_of(device, task.waits_for)
        if train is not None:
            at_s = train.next_after(bench.edge / bench.rate_hz)
            nearest = min(nearest, max(np.ceil(at_s * bench.rate_hz - 1e-6) - bench.edge, 1.0))
        elif any(task.waits_for == a_terminal for a_terminal, _ in device.wiring.encoders):
            nearest = 1.0  # when a scale moves on is known only afterwards
    return nearest


def look_for_triggers(device: SimulatedDevice) -> None:
    """Start what waited for an edge that has come; a finished task that may be triggered again waits anew."""
    for task in _waiting(device):
        if _edges_now(device, task.waits_for) > task.trigger_edges:
            go_live(device, task)
    for task in device.tasks.values():
        if task.live and task.retriggerable and task.to_do <= 0:
            await_trigger(device, task)
