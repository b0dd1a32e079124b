"""AI tasks: load cell and further channels, the master of clock and trigger; and one voltage input for a self-test.

NI-DAQmx's defaults (pounds, 2.5 V) are never relied on: every argument is given.
"""

from __future__ import annotations

import contextlib

import nidaqmx
import nidaqmx.constants as ni
import numpy as np
from numpy.typing import NDArray

from rig.configuration.channels import ChannelConfig
from rig.configuration.rig_file import RigConfig
from rig.daq.task_set import NewTask

BUFFER_S = 20.0
"""Length of the driver's buffers: how late the program may read before samples are lost."""
MASTER = "force"
"""Name of the master task."""


def buffer_samples(sample_rate_hz: float) -> int:
    """Return the driver's buffer size in samples per channel."""
    return int(BUFFER_S * sample_rate_hz)


def inputs_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """AI on the load cell and the further channels, in this order, continuous, on its own clock: the master."""
    task = force_task(new_task, config)
    for further in config.channels:
        _add_voltage(task, further.channel, further.name, _electrical_ends(further))
    for device in config.devices:
        if device.clock_from is not None:
            task.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, device.clock_from)
    return task


def force_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """AI on the load cell alone, continuous, on its own clock."""
    task = new_task(MASTER)
    force = config.force
    if force.kind == "bridge":
        task.ai_channels.add_ai_force_bridge_two_point_lin_chan(
            force.channel,
            name_to_assign_to_channel="force",
            min_val=force.min_n,
            max_val=force.max_n,
            units=ni.ForceUnits.NEWTONS,
            bridge_config=ni.BridgeConfiguration.FULL_BRIDGE,
            voltage_excit_source=ni.ExcitationSource.INTERNAL,
            voltage_excit_val=force.excitation_v,
            nominal_bridge_resistance=force.bridge_resistance_ohm,
            first_electrical_val=force.electrical[0],
            second_electrical_val=force.electrical[1],
            electrical_units=ni.BridgeElectricalUnits.MILLIVOLTS_PER_VOLT,
            first_physical_val=force.physical_n[0],
            second_physical_val=force.physical_n[1],
            physical_units=ni.BridgePhysicalUnits.NEWTONS,
            custom_scale_name="",
        )
    else:
        ends = volts_of_force(config, np.array([force.min_n, force.max_n]))
        _add_voltage(task, force.channel, "force", ends)
    _own_clock(task, config)
    task.in_stream.overwrite = ni.OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
    return task


def device_scaling(task: nidaqmx.Task) -> tuple[float, ...]:
    """Return the polynomial by which the driver scales codes of the force channel; empty where it does not say."""
    with contextlib.suppress(nidaqmx.errors.DaqError):
        return tuple(float(one) for one in task.ai_channels[0].ai_dev_scaling_coeff)
    return ()


def voltage_task(new_task: NewTask, config: RigConfig, channel: str) -> nidaqmx.Task:
    """AI on one voltage input within the motor's range, continuous, on its own clock."""
    task, limit = new_task("voltage"), config.motor.voltage_limit_v
    _add_voltage(task, channel, "voltage", np.array([-limit, limit]))
    _own_clock(task, config)
    return task


def _add_voltage(task: nidaqmx.Task, channel: str, name: str, ends_v: NDArray[np.float64]) -> None:
    task.ai_channels.add_ai_voltage_chan(
        channel,
        name_to_assign_to_channel=name,
        terminal_config=ni.TerminalConfiguration.DIFF,
        min_val=float(ends_v.min()),
        max_val=float(ends_v.max()),
        units=ni.VoltageUnits.VOLTS,
        custom_scale_name="",
    )


def _own_clock(task: nidaqmx.Task, config: RigConfig) -> None:
    rate = config.device.sample_rate_hz
    task.timing.cfg_samp_clk_timing(
        rate,
        source="",
        active_edge=ni.Edge.RISING,
        sample_mode=ni.AcquisitionType.CONTINUOUS,
        samps_per_chan=buffer_samples(rate),
    )


Points = tuple[float, float]


def _on_line(value: NDArray[np.float64], x: Points, y: Points) -> NDArray[np.float64]:
    """Return where ``value`` lies on the straight line through the points (x[0], y[0]) and (x[1], y[1])."""
    return y[0] + (value - x[0]) * ((y[1] - y[0]) / (x[1] - x[0]))


def volts_of_force(config: RigConfig, force_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Electrical reading (mV/V or V) that the calibration line gives for a force."""
    return _on_line(force_n, config.force.physical_n, config.force.electrical)


def force_of_volts(config: RigConfig, electrical: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force that the calibration line gives for an electrical reading (mV/V or V)."""
    return _on_line(electrical, config.force.electrical, config.force.physical_n)


def channel_of_volts(channel: ChannelConfig, volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Value in the channel's unit that its calibration line gives for a voltage."""
    return _on_line(volts, channel.electrical, channel.physical)


def _electrical_ends(channel: ChannelConfig) -> NDArray[np.float64]:
    return _on_line(np.array([channel.least, channel.most]), channel.physical, channel.electrical)
