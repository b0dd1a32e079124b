"""Calls that move samples: reading of analog and counter tasks, writing of analog and digital ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver import has_been_read, read_samples, write_levels, write_volts
from rig.simulated.rpc.messages import Fields, TaskHandler, enum
from rig.simulated.status import Code, DaqStatusError

_BY_SCAN = 1
MOST_VALUES = 2**26  # values one call may move


def _refuse_other_type(task: SimulatedTask, type_: str) -> None:
    if task.type != type_:
        code = Code.PHYS_CHAN_OUTPUT_TYPE if type_ in ("AO", "DO") else Code.PHYS_CHAN_MEAS_TYPE
        raise DaqStatusError(code, f"Task: {task.name} is {task.type}")


def make_reader(type_: str) -> TaskHandler:
    """Return the handler of NI's read calls for tasks of type ``AI`` or ``CI``: it answers with the values, how many
    came per channel, and a status, not zero where the timeout cut them short; it refuses another type and too small a
    buffer."""

    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        _refuse_other_type(task, type_)
        wanted, columns = int(request.num_samps_per_chan), len(task.channels)
        needed, room = max(wanted, 0) * columns, min(MOST_VALUES, request.array_size_in_samps)
        if needed > room:
            raise DaqStatusError(Code.READ_BUFFER_TOO_SMALL, f"Task: {task.name}: {needed} values, room for {room}")
        values = read_samples(device, task, wanted, request.timeout)
        came = values.shape[0]
        laid_out = np.zeros((max(wanted, came), columns))
        laid_out[:came] = values
        # fewer than wanted when it timed out; without an error at the end of a finite acquisition
        status = 0 if came >= wanted or has_been_read(task) else Code.SAMPLES_NOT_YET_AVAILABLE
        by_scan = enum(request, "fill_mode") == _BY_SCAN
        array = (laid_out if by_scan else laid_out.T).ravel()
        return {"read_array": array, "status": status, "samps_per_chan_read": came}

    return read


def write_analog(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    """Write volts to an AO task: all samples of one channel after the other, or scan by scan."""
    _refuse_other_type(task, "AO")
    values = _shape_values(request, np.array(list(request.write_array), dtype=np.float64), len(task.channels))
    write_volts(device, task, values, request.auto_start)
    return {"samps_per_chan_written": values.shape[0]}


def write_analog_scalar(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    _refuse_other_type(task, "AO")
    if len(task.channels) != 1:
        detail = f"Task: {task.name}: one value for {len(task.channels)} channels"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    write_volts(device, task, np.array([[request.value]]), request.auto_start)


def _shape_values(request: Any, values: NDArray[np.float64], columns: int) -> NDArray[np.float64]:
    n = int(request.num_samps_per_chan)
    if n < 1 or n * columns != values.size:
        detail = f"{values.size} values for {columns} channels and {n} samples"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    by_scan = enum(request, "data_layout") == _BY_SCAN
    return values.reshape(n, columns) if by_scan else values.reshape(columns, n).T


def largest_line_count(task: SimulatedTask) -> int:
    return max((len(channel.settings.get("lines", "1")) for channel in task.channels), default=0)


def write_lines(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    """Answer NI's WriteDigitalLines to a DO task and return the number of samples written: each sample has for every
    channel as many levels as the largest channel has lines, those beyond the channel's own being ignored."""
    _refuse_other_type(task, "DO")
    states = np.array([bool(value) for value in request.write_array], dtype=np.float64)
    n, most, channels = int(request.num_samps_per_chan), largest_line_count(task), len(task.channels)
    if n < 1 or n * most * channels != states.size:
        detail = f"{states.size} levels for {channels} channels of {most} lines"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    by_scan = enum(request, "data_layout") == _BY_SCAN
    grid = states.reshape(n, channels, most) if by_scan else states.reshape(channels, n, most).swapaxes(0, 1)
    lines = [grid[:, i, : len(channel.settings["lines"])] for i, channel in enumerate(task.channels)]
    write_levels(device, task, np.concatenate(lines, axis=1), request.auto_start)
    return {"samps_per_chan_written": n}
