"""Calls of a DAQmx client that move samples: reading and writing of analog, counter and digital tasks.

Samples are put into the layout the call asks for: by channel, or by scan. A read that times out returns what came, with
the driver's status, as the real server does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver import reading, writing
from rig.simulated.rpc.handlers import Fields, TaskHandler
from rig.simulated.rpc.messages import enum
from rig.simulated.status import DaqStatusError

_BY_SCAN = 1
MOST_VALUES = 2**26
"""Values one call may move."""
Converter = Callable[[SimulatedTask, NDArray[np.float64]], NDArray[Any]]


def refuse_other_type(task: SimulatedTask, type_: str) -> None:
    """Refuse to read or write a task of another type than the call moves."""
    if task.type != type_:
        code = status.WRONG_OUTPUT_TYPE if type_ in ("AO", "DO", "CO") else status.WRONG_MEASUREMENT_TYPE
        raise DaqStatusError(code, f"Task: {task.name} is {task.type}")


def _by_scan(request: Any, field: str) -> bool:
    return field in request.DESCRIPTOR.fields_by_name and enum(request, field) == _BY_SCAN


def _wanted(request: Any) -> int:
    return int(request.num_samps_per_chan)


def samples_to_read(task: SimulatedTask, request: Any, values_per_sample: int | None = None) -> int:
    """Return the samples per channel to read; refuses more than the client has room for.

    ``values_per_sample`` counts all channels of the task; by default there is one value a channel.
    """
    wanted, fields = _wanted(request), request.DESCRIPTOR.fields_by_name
    needed = max(wanted, 0) * (values_per_sample or len(task.channels))
    sizes = [name for name in ("array_size_in_samps", "array_size_in_bytes") if name in fields]
    room = min([MOST_VALUES, *(getattr(request, name) for name in sizes)])
    if needed > room:
        raise DaqStatusError(status.READ_BUFFER_TOO_SMALL, f"Task: {task.name}: {needed} values, room for {room}")
    return wanted


def _laid_out(values: NDArray[Any], rows: int, by_scan: bool) -> NDArray[Any]:
    filled = np.zeros((max(rows, values.shape[0]), *values.shape[1:]), dtype=values.dtype)
    filled[: values.shape[0]] = values
    return (filled if by_scan else np.swapaxes(filled, 0, 1)).ravel()


def _words(task: SimulatedTask, levels: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return one word per channel, (n, channels): bit i is line i of the port."""
    out = np.zeros((levels.shape[0], len(task.channels)), dtype=np.uint32)
    column = 0
    for index, channel in enumerate(task.channels):
        for line in channel.settings["lines"]:
            bit = int(line.rsplit("line", 1)[1])
            out[:, index] |= (levels[:, column] != 0).astype(np.uint32) << np.uint32(bit)
            column += 1
    return out


def _register(task: SimulatedTask, values: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return counts as a 32-bit counter register holds them."""
    return (values.astype(np.int64) % 2**32).astype(np.uint32)


def _read(type_: str, convert: Converter, *, as_bytes: bool = False) -> TaskHandler:
    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, type_)
        by_line = convert is lines_by_channel
        wanted = samples_to_read(task, request, _most_lines(task) * len(task.channels) if by_line else None)
        values = convert(task, reading.read(device, task, wanted, request.timeout))
        flat = _laid_out(values, wanted, _by_scan(request, "fill_mode"))
        fields = {
            "read_array": bytes(flat.astype(np.uint8)) if as_bytes else flat,
            **({"num_bytes_per_samp": _most_lines(task)} if by_line else {}),
        }
        return {**fields, **came(task, values, wanted)}

    return read


def came(task: SimulatedTask, values: NDArray[Any], wanted: int) -> Fields:
    """Return status and number of the samples per channel a read gives: fewer than wanted when it timed out.

    Fewer also come, without an error, at the end of a finite acquisition.
    """
    n = values.shape[0]
    return {
        "status": 0 if n >= wanted or reading.all_has_come(task) else status.SAMPLES_NOT_YET_AVAILABLE,
        "samps_per_chan_read": n,
    }


def _most_lines(task: SimulatedTask) -> int:
    return max(len(channel.settings["lines"]) for channel in task.channels)


def _read_scalar(type_: str, convert: Converter) -> TaskHandler:
    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, type_)
        if len(task.channels) != 1:
            raise DaqStatusError(status.TASK_MIXES_TYPES, f"Task: {task.name}: a scalar read needs one channel")
        values = _one_sample(device, task, request)
        return {"value": convert(task, values).ravel()[0]}

    return read


def _one_sample(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
    values = reading.read(device, task, 1, request.timeout)
    if not values.size:
        raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}", samples_read=0)
    return values


def _as_is(task: SimulatedTask, values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values


def lines_by_channel(task: SimulatedTask, levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, channels, lines of the largest channel); a smaller channel is filled up with low."""
    out = np.zeros((levels.shape[0], len(task.channels), _most_lines(task)))
    column = 0
    for index, channel in enumerate(task.channels):
        n = len(channel.settings["lines"])
        out[:, index, :n] = levels[:, column : column + n]
        column += n
    return out


def _write_analog(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "AO")
    values = _table(request, np.array(request.write_array, dtype=np.float64), len(task.channels))
    writing.write_volts(device, task, values, request.auto_start, request.timeout)
    return {"samps_per_chan_written": values.shape[0]}


def _write_raw(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    """Take codes of 16-bit converters, in the order of the channels, scan by scan."""
    refuse_other_type(task, "AO")
    codes = np.frombuffer(request.write_array, dtype="<i2")
    n, columns = int(request.num_samps), len(task.channels)
    if n < 1 or n * columns > codes.size:
        raise DaqStatusError(status.WRONG_SIZE, f"{codes.size} codes for {columns} channels and {n} samples")
    reach = np.array([device.inventory.of(c.physical.name).product.ao_range_v for c in task.channels])
    volts = codes[: n * columns].reshape(n, columns) * (reach / 2**15)
    writing.write_volts(device, task, volts, request.auto_start, request.timeout)
    return {"samps_per_chan_written": n}


def _table(request: Any, values: NDArray[Any], columns: int) -> NDArray[Any]:
    n = _wanted(request)
    if n < 1 or n * columns != values.size:
        raise DaqStatusError(status.WRONG_SIZE, f"{values.size} values for {columns} channels and {n} samples")
    return values.reshape(n, columns) if _by_scan(request, "data_layout") else values.reshape(columns, n).T


def _refuse_several_channels(task: SimulatedTask) -> None:
    if len(task.channels) != 1:
        raise DaqStatusError(status.WRONG_SIZE, f"Task: {task.name}: one value for {len(task.channels)} channels")


def _write_analog_scalar(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "AO")
    _refuse_several_channels(task)
    writing.write_volts(device, task, np.array([[request.value]]), request.auto_start, request.timeout)
    return {}


def _write_lines(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "DO")
    states = np.array([bool(value) for value in request.write_array], dtype=np.float64)
    n, most, channels = _wanted(request), _most_lines(task), len(task.channels)
    if n < 1 or n * most * channels != states.size:
        raise DaqStatusError(status.WRONG_SIZE, f"{states.size} levels for {channels} channels of {most} lines")
    by_scan = _by_scan(request, "data_layout")
    grid = states.reshape(n, channels, most) if by_scan else states.reshape(channels, n, most).swapaxes(0, 1)
    columns = [grid[:, i, : len(c.settings["lines"])] for i, c in enumerate(task.channels)]
    put_levels(device, task, np.concatenate(columns, axis=1), request)
    return {"samps_per_chan_written": n}


def put_levels(device: DeviceState, task: SimulatedTask, levels: NDArray[np.float64], request: Any) -> None:
    """Take levels, (n, lines): put out at once without a clock, else buffered."""
    writing.write(device, task, levels, request.auto_start, request.timeout)


def _levels(task: SimulatedTask, words: NDArray[np.int64]) -> NDArray[np.float64]:
    bits = [
        (words[:, index] >> int(line.rsplit("line", 1)[1])) & 1
        for index, channel in enumerate(task.channels)
        for line in channel.settings["lines"]
    ]
    return np.stack(bits, axis=1).astype(np.float64)


def _write_words(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "DO")
    table = _table(request, np.array(list(request.write_array), dtype=np.int64), len(task.channels))
    put_levels(device, task, _levels(task, table), request)
    return {"samps_per_chan_written": table.shape[0]}


def _write_word(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "DO")
    _refuse_several_channels(task)
    put_levels(device, task, _levels(task, np.array([[request.value]], dtype=np.int64)), request)
    return {}


def _read_pairs(first: str, second: str, measures: str, *, scalar: bool) -> TaskHandler:
    """Return the reader of pulses: two arrays, or two scalars."""

    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, "CI")
        if task.measures != measures:
            raise DaqStatusError(status.WRONG_MEASUREMENT_TYPE, f"Task: {task.name} does not measure {measures}")
        type_ = np.uint32 if measures == daqmx.PULSE_TICKS else np.float64
        if scalar:
            pair = _one_sample(device, task, request).astype(type_)[0]
            return {first: pair[0], second: pair[1]}
        wanted = samples_to_read(task, request)
        values = reading.read(device, task, wanted, request.timeout).astype(type_)
        filled = _laid_out(values, wanted, True).reshape(-1, 2)
        return {f"read_array_{first}": filled[:, 0], f"read_array_{second}": filled[:, 1], **came(task, values, wanted)}

    return read


DATA_CALLS: dict[str, TaskHandler] = {
    "ReadAnalogF64": _read("AI", _as_is),
    "ReadAnalogScalarF64": _read_scalar("AI", _as_is),
    "ReadCounterF64": _read("CI", _as_is),
    "ReadCounterF64Ex": _read("CI", _as_is),
    "ReadCounterScalarF64": _read_scalar("CI", _as_is),
    "ReadCounterU32": _read("CI", _register),
    "ReadCounterU32Ex": _read("CI", _register),
    "ReadCounterScalarU32": _read_scalar("CI", _register),
    "ReadCtrFreq": _read_pairs("frequency", "duty_cycle", daqmx.PULSE_FREQUENCY, scalar=False),
    "ReadCtrFreqScalar": _read_pairs("frequency", "duty_cycle", daqmx.PULSE_FREQUENCY, scalar=True),
    "ReadCtrTime": _read_pairs("high_time", "low_time", daqmx.PULSE_TIME, scalar=False),
    "ReadCtrTimeScalar": _read_pairs("high_time", "low_time", daqmx.PULSE_TIME, scalar=True),
    "ReadCtrTicks": _read_pairs("high_ticks", "low_ticks", daqmx.PULSE_TICKS, scalar=False),
    "ReadCtrTicksScalar": _read_pairs("high_ticks", "low_ticks", daqmx.PULSE_TICKS, scalar=True),
    "ReadDigitalU32": _read("DI", _words),
    "ReadDigitalU16": _read("DI", _words),
    "ReadDigitalU8": _read("DI", _words, as_bytes=True),
    "ReadDigitalScalarU32": _read_scalar("DI", _words),
    "ReadDigitalLines": _read("DI", lines_by_channel, as_bytes=True),
    "WriteAnalogF64": _write_analog,
    "WriteAnalogScalarF64": _write_analog_scalar,
    "WriteRaw": _write_raw,
    "WriteDigitalLines": _write_lines,
    **dict.fromkeys(("WriteDigitalU32", "WriteDigitalU16", "WriteDigitalU8"), _write_words),
    "WriteDigitalScalarU32": _write_word,
}
