"""What is on the terminals of the virtual device: pulses and their edges, input readings, output levels.

In: the device's state and what the bench's sensors give at edges of the sample clock.
Out: samples, as an input task would acquire them, and the levels its outputs are at.

Counter outputs, the A signals of the encoders and the camera's exposure signal drive terminals; a terminal where
nothing is connected has no edges, and a counter that is to measure its pulses times out. Terminals are named relative
to the device. An open input reads nothing but itself. Scaling is the one the client set up in its task, so that a wrong
calibration, swapped terminals or a wrong number of pulses show up in the data as they would in the lab.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.bench.bench_time import PulseTrain
from rig.simulated.bench.sensors import quantise
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.status import Code, DaqStatusError


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


def input_terminal(device: DeviceState, task: SimulatedTask) -> str:
    """Return the terminal whose edges a counter counts or measures."""
    channel = task.channels[0]
    named = task.setting("Chan", channel.name, daqmx.CI_TERM[channel.settings["measures"]], "")
    if not named:
        raise DaqStatusError(
            Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING,
            f"Channel: {channel.name}: its input terminal must be set",
        )
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


def pulse_reading(device: DeviceState, task: SimulatedTask, edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return what a counter gives for the pulse that ends at each edge (n,) of the bench: (n, 1), (n, 2) for pairs."""
    channel, bench, terminal = task.channels[0], device.bench, input_terminal(device, task)
    train, buffer = pulses_on(device, terminal), task.buffer if task.timing.implicit else None
    if train is None or (buffer is None and not np.isfinite(train.next_after(bench.now_s))):
        raise DaqStatusError(Code.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}: no edges", samples_read=0)
    timebase, settings = device.inventory.of(channel.physical.name).product.counter_timebase_hz, channel.settings
    if buffer is not None:  # each sample is the pulse after the last one's
        first = train.passed_at(task.progress.live_since_s) + buffer.acquired
        number = first + np.arange(edge.size)
    else:
        number = np.maximum(train.passed(edge / bench.rate_hz) - 2, 0)
    high = high_times(device, terminal, train, number)
    period = np.full(edge.size, 1 / train.rate_hz)
    measures = settings["measures"]
    if measures == daqmx.PULSE_FREQUENCY:
        return np.column_stack((1 / period, high / period))
    if measures == daqmx.PULSE_TIME:
        return np.column_stack((high, period - high))
    if measures in (daqmx.FREQUENCY, daqmx.PERIOD, daqmx.WIDTH):
        part = period if measures != daqmx.WIDTH else period - high if settings["edge"] == daqmx.FALLING else high
        if settings["units"] == daqmx.TICKS:
            return np.rint(part * timebase)[:, None]
        return (1 / part if measures == daqmx.FREQUENCY else part)[:, None]
    return np.rint(np.column_stack((high, period - high)) * timebase)


SHUNT_OHM = 100e3
"""Shunt resistor inside the NI 9237."""
BRIDGE_OHM = 350.0
NEWTON_IN = {daqmx.NEWTONS: 1.0, daqmx.POUNDS: 4.4482216152605, daqmx.KILOGRAM_FORCE: 9.80665}
"""Newtons per unit of force."""


def analog_reading(
    device: DeviceState,
    task: SimulatedTask,
    channel: Channel,
    cell_mv_per_v: NDArray[np.float64],
    edge: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return what an AI channel gives at each edge (n,) for the load cell's output (n,), in its task's units."""
    owner, settings = device.inventory.of(channel.physical.name), channel.settings
    product = owner.product
    wired = channel.physical.name == device.inventory.full_name(device.wiring.force)
    signal = cell_mv_per_v if wired else np.zeros_like(cell_mv_per_v)
    if channel.physical.kind == "voltage_in":
        volts = signal * device.wiring.conditioner_v_per_mv_per_v
        loopback = device.wiring.loopback
        if loopback is not None and channel.physical.name == device.inventory.full_name(loopback):
            volts = device.bench.motor_volts_before(edge)
        half = owner.half_range(settings)
        reading = quantise(volts, half, product.ai_bits)
        scale = settings.get("scale")
        return reading if scale is None else scale.scaled(reading)
    if task.setting("Chan", channel.name, daqmx.AI_BRIDGE_SHUNT_CAL_ENABLE, False) and wired:
        # one arm of the bridge shunted; an input that is open has no bridge to unbalance
        signal = signal + 1e3 * BRIDGE_OHM / (4 * SHUNT_OHM + 2 * BRIDGE_OHM)
    reading = quantise(signal, product.bridge_range_mv_per_v, product.bridge_bits)
    per_mv = 1e-3 if settings["electrical_units"] == daqmx.VOLTS_PER_VOLT else 1.0
    e0, e1 = settings["first_electrical_val"], settings["second_electrical_val"]
    p0, p1 = settings["first_physical_val"], settings["second_physical_val"]
    physical = p0 + (reading * per_mv - e0) * ((p1 - p0) / (e1 - e0))
    return physical * (NEWTON_IN[settings["physical_units"]] / NEWTON_IN[settings["units"]])


def encoder_counts(device: DeviceState, task: SimulatedTask, quarter: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the counts (X4) since the trial began of the encoder wired to a counter's A and B terminals, (n,)."""
    named = [
        task.setting("Chan", task.channels[0].name, attribute, "")
        for attribute in (daqmx.CI_ENCODER_A_INPUT_TERM, daqmx.CI_ENCODER_B_INPUT_TERM)
    ]
    terminals = tuple(device.inventory.terminal(name) for name in named)
    counts = np.zeros(quarter.shape[0], dtype=np.int64)
    for column, wired in enumerate((*device.wiring.encoders, device.wiring.opposite)):
        if wired is None:
            continue
        if terminals == wired:
            counts = quarter[:, column]
        elif terminals == wired[::-1]:  # A and B exchanged count backwards
            counts = -quarter[:, column]
    return counts


def encoder_reading(device: DeviceState, task: SimulatedTask, quarter: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return what a counter gives for its encoder since it was started, in its task's units."""
    counts, settings = encoder_counts(device, task, quarter) - task.progress.initial_edges, task.channels[0].settings
    edges = {daqmx.X1: 1, daqmx.X2: 2, daqmx.X4: 4}[settings["decoding_type"]]
    ticks = (counts * edges) // 4
    turning = "pulses_per_rev" in settings
    initial = settings["initial_angle" if turning else "initial_pos"]
    if settings["units"] == daqmx.TICKS:
        return ticks + initial
    turn = 360.0 if settings["units"] == daqmx.DEGREES else 2 * np.pi
    return ticks * ((turn / settings["pulses_per_rev"] if turning else settings["dist_per_pulse"]) / edges) + initial


def latch(
    device: DeviceState,
    task: SimulatedTask,
    cell: NDArray[np.float64],
    quarter: NDArray[np.int64],
    edge: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return what an input task reads, (n, channels or lines), for cell output (n,) and counts (n, 3) at edges (n,)."""
    if task.type == "AI":
        return np.column_stack([analog_reading(device, task, channel, cell, edge) for channel in task.channels])
    if task.type == "DI":
        return np.column_stack([_level_before(device, name, edge) for name in task.lines])
    channel = task.channels[0]
    if task.measures != daqmx.EDGES:
        if task.measures is None:
            reading = encoder_reading(device, task, quarter)[:, None]
        else:
            reading = pulse_reading(device, task, edge)
        scale = channel.settings.get("scale")
        return reading if scale is None else scale.scaled(reading)
    passed = edges_passed(device, input_terminal(device, task), edge) - task.progress.initial_edges
    return (channel.settings["initial_count"] + channel.settings["step"] * passed)[:, None].astype(np.float64)


def latch_now(device: DeviceState, task: SimulatedTask) -> NDArray[np.float64]:
    """Return what an input task reads on demand, shape (1, channels or lines), without letting time pass."""
    cell, quarter = device.faults.change(device.trial, np.array([device.bench.now_s]), *device.bench.present())
    if task.type == "DI":
        return np.array([[float(device.lines.get(name, False)) for name in task.lines]])
    device.bench.settle_motor_volts(device.output_v.get(device.motor, 0.0))
    return latch(device, task, cell, quarter, np.array([device.bench.edge]))


def _level_before(device: DeviceState, line: str, edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the level of a line just before each of the last edges (n,) of the bench."""
    history = device.line_history.get(line)
    if history is None:
        return np.full(edge.size, float(device.lines.get(line, False)))
    first = device.bench.edge - (history.size - 1)
    return history[np.clip(edge - first, 0, history.size - 1)]


def set_outputs(device: DeviceState, task: SimulatedTask, row: NDArray[np.float64]) -> None:
    """Set a task's outputs, V per channel or levels per line; tasks with change detection acquire a sample."""
    if task.type == "AO":
        device.output_v.update({c.physical.name: float(row[i]) for i, c in enumerate(task.channels)})
        return
    names = task.lines
    before = dict(device.lines)
    open_ = tristate_lines(task)
    device.lines.update({name: bool(level) and name not in open_ for name, level in zip(names, row, strict=True)})
    changed = {(name, device.lines[name]) for name in names if device.lines[name] != before.get(name, False)}
    for other in device.tasks.values():
        if other.progress.live and other.buffer is not None and changed & other.timing.change_lines:
            other.buffer.put(latch_now(device, other))


def tristate_lines(task: SimulatedTask) -> set[str]:
    """Return the lines a task does not drive: the card's resistors pull them low."""
    return {
        line
        for channel in task.channels
        if task.setting("Chan", channel.name, daqmx.DO_TRISTATE, False)
        for line in channel.settings["lines"]
    }


def set_clocked_lines(
    device: DeviceState, task: SimulatedTask, rows: NDArray[np.float64], at: NDArray[np.int64], n: int
) -> None:
    """Set levels, (m, lines), at edges ``at`` (m,) of the n that pass; an input sees the level before its edge."""
    names = task.lines
    last_row = np.searchsorted(at, np.arange(n), side="right") - 1
    open_ = tristate_lines(task)
    for column, name in enumerate(names):
        before = float(device.lines.get(name, False))
        levels = np.zeros(rows.shape[0]) if name in open_ else rows[:, column]
        after = np.where(last_row >= 0, levels[np.maximum(last_row, 0)], before)
        device.line_history[name] = np.concatenate(([before], after))
    detected = any(name in names for other in device.tasks.values() for name, _ in other.timing.change_lines)
    for row in rows if detected else rows[-1:]:
        set_outputs(device, task, row)
