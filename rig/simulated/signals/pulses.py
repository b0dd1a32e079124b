"""Pulses and edges on the terminals of the device: what counters generate, and how many edges a terminal has seen.

Counter outputs, the A signals of the encoders and the camera's exposure signal drive terminals; a terminal where
nothing is connected has no edges. Terminals are named relative to the device.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx, status
from rig.simulated.bench.pulse_train import PulseTrain
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.status import DaqStatusError


def pulse_train(task: SimulatedTask) -> PulseTrain:
    """Return the pulses a counter output generates from the moment it became live."""
    name, pulses = task.channels[0].name, task.pulses
    rate_hz = task.setting("Chan", name, daqmx.CO_PULSE_FREQ, 1.0) * pulses.drift
    first_s = pulses.next_s
    if first_s is None:
        first_s = task.progress.live_since_s + (
            task.setting("Chan", name, daqmx.CO_PULSE_FREQ_INITIAL_DELAY, 0.0) / pulses.drift
        )
    count = float("inf") if pulses.count is None else float(pulses.count)
    return PulseTrain(
        rate_hz, first_s, count, task.setting("Chan", name, daqmx.CO_PULSE_DUTY_CYC, 0.5) / rate_hz, pulses.passed
    )


def output_terminals(device: DeviceState, task: SimulatedTask) -> set[str]:
    """Return the terminals that carry a counter output's pulses."""
    channel = task.channels[0]
    owner, number = device.inventory.of(channel.physical.name), channel.physical.resource.removeprefix("ctr")
    found = {device.inventory.known_as(owner, f"Ctr{number}InternalOutput")}
    if named := task.setting("Chan", channel.name, daqmx.CO_PULSE_TERM, ""):
        found.add(device.inventory.terminal(named))
    elif default := device.inventory.counter_terminal(channel.physical, "out"):
        found.add(default)
    return found


def input_terminal(device: DeviceState, task: SimulatedTask, channel: Channel) -> str:
    """Return the terminal whose edges a counter counts or measures."""
    named = task.setting("Chan", channel.name, daqmx.CI_TERM[channel.settings["measures"]], "")
    if not named:
        raise DaqStatusError(status.NO_SUCH_TERMINAL, f"Channel: {channel.name}: its input terminal must be set")
    return device.inventory.terminal(named)


def counter_output_on(device: DeviceState, terminal: str) -> SimulatedTask | None:
    """Return the counter output that drives a terminal; None when none does."""
    terminal = device.carried(terminal)
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and terminal in output_terminals(device, task):
            return task
    return None


def pulses_on(device: DeviceState, terminal: str) -> PulseTrain | None:
    """Return the pulses on a terminal; None when nothing pulses there."""
    task = counter_output_on(device, terminal)
    if task is not None:
        return pulse_train(task)
    return device.bench.exposures if terminal == device.wiring.exposure else None


def high_times(device: DeviceState, terminal: str, train: PulseTrain, number: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how long each of these pulses (n,) on a terminal is high, s."""
    task = counter_output_on(device, terminal)
    if task is None or task.pulses.high_times_s is None:
        return np.full(number.size, train.high_s)
    return task.pulses.high_times_s[number % task.pulses.high_times_s.size]


def edges_passed(device: DeviceState, terminal: str, edge: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many rising edges have passed on a terminal by each edge (n,) of the bench."""
    if (train := pulses_on(device, terminal)) is not None:
        time_s = edge / device.bench.rate_hz
        passed = train.passed(time_s)
        return device.faults.exposures(device.trial, time_s, passed) if train is device.bench.exposures else passed
    for body, (a_terminal, _) in enumerate(device.wiring.encoders):
        if terminal == a_terminal:
            return device.bench.a_edges(body, edge)
    return np.zeros(edge.size, dtype=np.int64)


def level_on(device: DeviceState, terminal: str, edge: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether a terminal is high at each edge (n,) of the bench; where nothing drives it it is low."""
    if (train := pulses_on(device, terminal)) is not None:
        time_s = edge / device.bench.rate_hz
        passed = train.passed(time_s) - train.before
        since_s = time_s - (train.first_s + (passed - 1) / train.rate_hz)
        number = np.maximum(train.before + passed - 1, 0)
        return np.asarray((passed > 0) & (since_s < high_times(device, terminal, train, number) - 1e-9))
    pin = re.fullmatch(r"PFI(\d+)", device.inventory.own_name(terminal))
    if pin is None:
        return np.zeros(edge.size, dtype=bool)
    owner, number_of = device.inventory.of(terminal).name, int(pin[1])  # X Series: PFI0 to 15 are P1.0 to P2.7
    line = f"{owner}/port{1 + number_of // 8}/line{number_of % 8}"
    return np.full(edge.size, bool(device.lines.get(line, False)))


def edges_now(device: DeviceState, terminal: str) -> int:
    """Return how many rising edges have passed on a terminal so far."""
    return int(edges_passed(device, terminal, np.array([device.bench.edge]))[0])
