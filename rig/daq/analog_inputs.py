"""AI tasks: the load cell, whose task is the master of clock and trigger, and a voltage input of a self-test.

NI-DAQmx's defaults are never relied on (pounds, 2.5 V): every argument is given.
"""

from __future__ import annotations

import nidaqmx
import nidaqmx.constants as ni
import numpy as np
from numpy.typing import NDArray

from rig.config import RigConfig
from rig.daq.task_set import NewTask

BUFFER_S = 20.0
"""Length of the driver's buffers: how long the program may be late before samples are lost."""
MASTER = "force"
"""Name of the master task."""


def buffer_samples(sample_rate_hz: float) -> int:
    """Return the number of samples per channel the driver is told to keep."""
    return int(BUFFER_S * sample_rate_hz)


def force_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """AI on the load cell, continuous, on its own clock: the master."""
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
        ends = sorted(volts_of_force(config, np.array([force.min_n, force.max_n])))
        task.ai_channels.add_ai_voltage_chan(
            force.channel,
            name_to_assign_to_channel="force",
            terminal_config=ni.TerminalConfiguration.DIFF,
            min_val=float(ends[0]),
            max_val=float(ends[1]),
            units=ni.VoltageUnits.VOLTS,
            custom_scale_name="",
        )
    _own_clock(task, config)
    task.in_stream.overwrite = ni.OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
    return task


def voltage_task(new_task: NewTask, config: RigConfig, channel: str) -> nidaqmx.Task:
    """AI on one voltage input, continuous, on its own clock."""
    task, limit = new_task("voltage"), config.motor.voltage_limit_v
    task.ai_channels.add_ai_voltage_chan(
        channel,
        name_to_assign_to_channel="voltage",
        terminal_config=ni.TerminalConfiguration.DIFF,
        min_val=-limit,
        max_val=limit,
        units=ni.VoltageUnits.VOLTS,
        custom_scale_name="",
    )
    _own_clock(task, config)
    return task


def _own_clock(task: nidaqmx.Task, config: RigConfig) -> None:
    rate = config.device.sample_rate_hz
    task.timing.cfg_samp_clk_timing(
        rate,
        source="",
        active_edge=ni.Edge.RISING,
        sample_mode=ni.AcquisitionType.CONTINUOUS,
        samps_per_chan=buffer_samples(rate),
    )


def volts_of_force(config: RigConfig, force_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Electrical reading (mV/V or V) that the calibration line gives for a force."""
    (e0, e1), (p0, p1) = config.force.electrical, config.force.physical_n
    return e0 + (force_n - p0) * ((e1 - e0) / (p1 - p0))


def force_of_volts(config: RigConfig, electrical: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force that the calibration line gives for an electrical reading (mV/V or V)."""
    (e0, e1), (p0, p1) = config.force.electrical, config.force.physical_n
    return p0 + (electrical - e0) * ((p1 - p0) / (e1 - e0))
