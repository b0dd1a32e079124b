"""What an analog input or an encoder channel reads from the bench; an open input reads nothing but itself.

The scaling is the one the client set up in its task, so that a wrong calibration, swapped terminals or a
wrong number of pulses show up in the data as they would in the lab.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.bench.adc import quantise
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SimulatedTask

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


def encoder_reading(
    device: DeviceState, task: SimulatedTask, channel: Channel, quarter: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return what a counter gives for the encoder wired to its A and B terminals, in its task's units."""
    named = [
        task.setting("Chan", channel.name, attribute, "")
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
    settings = channel.settings
    edges = {daqmx.X1: 1, daqmx.X2: 2, daqmx.X4: 4}[settings["decoding_type"]]
    ticks = (counts * edges) // 4
    initial = settings["initial_angle"] if "pulses_per_rev" in settings else settings["initial_pos"]
    if settings["units"] == daqmx.TICKS:
        return ticks + initial
    if "pulses_per_rev" in settings:
        turn = 360.0 if settings["units"] == daqmx.DEGREES else 2 * np.pi
        return ticks * (turn / (edges * settings["pulses_per_rev"])) + initial
    return ticks * (settings["dist_per_pulse"] / edges) + initial
