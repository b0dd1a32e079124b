"""Values of properties that the product does not have, or the virtual device."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.rpc.messages import property_number
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

DO_NOT_OVERWRITE = 10159
READ_OVERWRITE = property_number("Read", "OVERWRITE")
CI_INPUT_TERMS = (
    daqmx.CI_ENCODER_A_INPUT_TERM,
    daqmx.CI_ENCODER_B_INPUT_TERM,
    daqmx.CI_ENCODER_Z_INPUT_TERM,
    *daqmx.CI_TERM.values(),
)


def check_value(device: DeviceState, task: SimulatedTask, number: int, value: Any) -> None:
    """Refuse a value that the product does not have, or the virtual device."""
    if number in (*CI_INPUT_TERMS, daqmx.DIG_EDGE_ARM_START_TRIG_SRC):
        device.inventory.terminal(value)
    if number == daqmx.CO_PULSE_TERM:
        device.inventory.terminal(value, output=True)
    if number == READ_OVERWRITE and value != DO_NOT_OVERWRITE:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "only DO_NOT_OVERWRITE_UNREAD_SAMPLES is simulated")
    if number == daqmx.ARM_START_TRIG_TYPE and value not in (daqmx.DIGITAL_EDGE, daqmx.NO_TRIGGER):
        raise DaqStatusError(status.INVALID_VALUE, f"Arm start trigger type {value}")
    if number == daqmx.START_TRIG_RETRIGGERABLE and (
        task.type not in ("AI", "AO", "DI", "DO") or task.triggers.referenced
    ):
        raise NotImplementedByDevice(f"retriggering a {task.type} task")
