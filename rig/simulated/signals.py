"""What is on the terminals of the virtual device: pulses and their edges, input readings, output levels.

An open input reads nothing but itself. Scaling is the one the client set up in its task, so that a wrong calibration,
swapped terminals or a wrong number of pulses show up in the data as they would in the lab.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.bench.bench_time import PulseTrain
from rig.simulated.bench.sensors import quantise
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask
from rig.simulated.status import Code, DaqStatusError


def pulse_train(task: SimulatedTask) -> PulseTrain:
    settings, pulses = task.channels[0].settings, task.pulses
    rate_hz = settings["pulse_hz"] * pulses.drift
    first_s = task.progress.live_since_s + settings["delay_s"] / pulses.drift
    count = float("inf") if pulses.count is None else float(pulses.count)
    return PulseTrain(rate_hz, first_s, count, settings["duty_cycle"] / rate_hz)


def output_terminals(device: DeviceState, task: SimulatedTask) -> set[str]:
    """Return the terminals, relative to the main device, on which a counter's pulses appear: its internal output, and
    the terminal set for it or else its default one."""
    channel = task.channels[0]
    owner, number = device.inventory.owner_of(channel.physical.name), channel.physical.resource.removeprefix("ctr")
    found = {device.inventory.known_as(owner, f"Ctr{number}InternalOutput")}
    if named := task.setting("Chan", channel.name, daqmx.CO_PULSE_TERM, ""):
        found.add(device.inventory.terminal(named))
    elif default := device.inventory.counter_terminal(channel.physical, "out"):
        found.add(default)
    return found


def input_terminal(device: DeviceState, task: SimulatedTask) -> str:
    """Return the terminal, relative to the main device, whose edges a counter input counts; refuse a task in which none
    is set."""
    channel = task.channels[0]
    named = task.setting("Chan", channel.name, daqmx.CI_COUNT_EDGES_TERM, "")
    if not named:
        raise DaqStatusError(
            Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING,
            f"Channel: {channel.name}: its input terminal must be set",
        )
    return device.inventory.terminal(named)


def pulses_on(device: DeviceState, terminal: str) -> PulseTrain | None:
    """Return the pulses on a terminal; None when nothing pulses there."""
    terminal = device.source_terminal(terminal)
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and terminal in output_terminals(device, task):
            return pulse_train(task)
    return device.bench.exposures if terminal == device.wiring.exposure else None


def count_edges_passed(device: DeviceState, terminal: str, edge: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of rising edges (n,) that have passed on a terminal by each sample edge of the bench ``edge`` (n,),
    numbered in the trial: of pulses, camera exposures or an encoder's A signal; 0 where nothing is connected."""
    if (train := pulses_on(device, terminal)) is not None:
        time_s = edge / device.bench.rate_hz
        passed = train.count_edges(time_s)
        return device.faults.drop_exposures(device.trial, time_s, passed) if train is device.bench.exposures else passed
    for body, (a_terminal, _) in enumerate(device.wiring.encoders):
        if terminal == a_terminal:
            return device.bench.a_edges(body, edge)
    return np.zeros(edge.size, dtype=np.int64)


def edges_now(device: DeviceState, terminal: str) -> int:
    return int(count_edges_passed(device, terminal, np.array([device.bench.edge]))[0])


SHUNT_OHM = 100e3  # shunt resistor inside the NI 9237
BRIDGE_OHM = 350.0  # the usual full bridge of a load cell
NEWTON_IN = {daqmx.NEWTONS: 1.0, daqmx.POUNDS: 4.4482216152605, daqmx.KILOGRAM_FORCE: 9.80665}
"""Newtons per unit of force."""


def analog_reading(
    device: DeviceState,
    task: SimulatedTask,
    channel: Channel,
    cell_mv_per_v: NDArray[np.float64],
    edge: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Reading (n,) of an analog input channel in its task's units, quantised, at edges of the bench ``edge`` (n,),
    numbers: of the load cell's output ``cell_mv_per_v`` (n,) where that is wired to it, of the motor's volts at a
    loopback, else 0."""
    owner, settings = device.inventory.owner_of(channel.physical.name), channel.settings
    product = owner.product
    wired = channel.physical.name == device.inventory.full_name(device.wiring.force)
    signal = cell_mv_per_v if wired else np.zeros_like(cell_mv_per_v)
    if channel.physical.kind == "voltage_in":
        volts = signal * device.wiring.conditioner_v_per_mv_per_v
        loopback = device.wiring.loopback
        if loopback is not None and channel.physical.name == device.inventory.full_name(loopback):
            volts = device.bench.motor_volts_before(edge)
        return quantise(volts, owner.half_range(settings), product.ai_bits)
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
    """X4 counts (n,) since the trial began of the encoder wired to a counter's A and B terminals, out of ``quarter``
    (n, 4) of key, whippen, hammer, second head; of opposite sign where A and B are exchanged, 0 where none is wired."""
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
    """Reading (n,) of a counter for its encoder, counted since its task went live: ticks of its decoding, degrees or
    radians as its channel says, plus the initial angle; ``quarter``: X4 counts (n, 4) of key, whippen, hammer, second
    head."""
    counts, settings = encoder_counts(device, task, quarter) - task.progress.initial_edges, task.channels[0].settings
    edges = {daqmx.X1: 1, daqmx.X2: 2, daqmx.X4: 4}[settings["decoding_type"]]
    ticks = (counts * edges) // 4
    if settings["units"] == daqmx.TICKS:
        return ticks + settings["initial_angle"]
    turn = 360.0 if settings["units"] == daqmx.DEGREES else 2 * np.pi
    return ticks * (turn / settings["pulses_per_rev"] / edges) + settings["initial_angle"]


def latch(
    device: DeviceState,
    task: SimulatedTask,
    cell: NDArray[np.float64],
    quarter: NDArray[np.int64],
    edge: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Samples (n, channels) of an input task, in its units, at edges of the bench ``edge`` (n,), numbers: from the load
    cell's output ``cell`` (n,), mV/V, and X4 counts ``quarter`` (n, 4) of key, whippen, hammer, second head."""
    if task.type == "AI":
        return np.column_stack([analog_reading(device, task, channel, cell, edge) for channel in task.channels])
    if not task.counts_edges:
        return encoder_reading(device, task, quarter)[:, None]
    settings = task.channels[0].settings
    passed = count_edges_passed(device, input_terminal(device, task), edge) - task.progress.initial_edges
    return (settings["initial_count"] + settings["step"] * passed)[:, None].astype(np.float64)


def latch_now(device: DeviceState, task: SimulatedTask) -> NDArray[np.float64]:
    """Return what an input task reads on demand, shape (1, channels), without letting time pass."""
    cell, quarter = device.faults.apply_sensor_faults(
        device.trial, np.array([device.bench.now_s]), *device.bench.present()
    )
    device.bench.settle_motor_volts(device.output_v.get(device.motor, 0.0))
    return latch(device, task, cell, quarter, np.array([device.bench.edge]))


def set_outputs(device: DeviceState, task: SimulatedTask, row: NDArray[np.float64]) -> None:
    if task.type == "AO":
        device.output_v.update({c.physical.name: float(row[i]) for i, c in enumerate(task.channels)})
    else:
        device.lines.update({name: bool(level) for name, level in zip(task.lines, row, strict=True)})
