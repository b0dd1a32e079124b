"""Calls of a DAQmx client that move samples: reading and writing of analog, counter and digital tasks.

Place in the data flow: the service finds the task, these put samples into the layout the call asks for: by channel,
or by scan. A read that times out returns what came, with the driver's status, as the real server does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.constants import PULSE_FREQUENCY, PULSE_TICKS, PULSE_TIME
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver import reading, writing
from rig.simulated.rpc.calls.counter_outputs import PULSE_WRITES
from rig.simulated.rpc.messages import enum, response
from rig.simulated.status import DaqStatusError

_BY_SCAN = 1
MOST_VALUES = 2**26
"""Values one call may move."""
Converter = Callable[[SimulatedTask, NDArray[np.float64]], NDArray[Any]]
Handler = Callable[[DeviceState, SimulatedTask, Any], Any]


def refuse_other_type(task: SimulatedTask, type_: str) -> None:
    """Refuse to read or write a task of another type than the call moves."""
    if task.type != type_:
        code = status.WRONG_OUTPUT_TYPE if type_ in ("AO", "DO") else status.WRONG_MEASUREMENT_TYPE
        raise DaqStatusError(code, f"Task: {task.name} is {task.type}")


def _by_scan(request: Any, field: str) -> bool:
    return field in request.DESCRIPTOR.fields_by_name and enum(request, field) == _BY_SCAN


def _wanted(request: Any) -> int:
    return int(request.num_samps_per_chan)


def samples_to_read(task: SimulatedTask, request: Any, values_per_sample: int | None = None) -> int:
    """Return the samples per channel to read; refuses more than the client has room for.

    ``values_per_sample`` is for all channels of the task, one each unless told.
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


def _counts(values: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return counts as a 32-bit counter register holds them."""
    return (values.astype(np.int64) % 2**32).astype(np.uint32)


def _read(call: str, type_: str, convert: Converter) -> Handler:
    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
        refuse_other_type(task, type_)
        per_sample = _most_lines(task) * len(task.channels) if call == "ReadDigitalLines" else None
        wanted = samples_to_read(task, request, per_sample)
        values = convert(task, reading.read(device, task, wanted, request.timeout))
        came = values.shape[0]
        code = 0 if came >= wanted else status.SAMPLES_NOT_YET_AVAILABLE
        flat = _laid_out(values, wanted, _by_scan(request, "fill_mode"))
        packed = bytes(flat.astype(np.uint8)) if call in ("ReadDigitalLines", "ReadDigitalU8") else flat
        extra = {"num_bytes_per_samp": _most_lines(task)} if call == "ReadDigitalLines" else {}
        return response(call, status=code, read_array=packed, samps_per_chan_read=came, **extra)

    return read


def _most_lines(task: SimulatedTask) -> int:
    return max(len(channel.settings["lines"]) for channel in task.channels)


def _read_scalar(
    call: str, type_: str, convert: Callable[[SimulatedTask, NDArray[np.float64]], NDArray[Any]]
) -> Handler:
    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
        refuse_other_type(task, type_)
        if len(task.channels) != 1:
            raise DaqStatusError(status.TASK_MIXES_TYPES, f"Task: {task.name}: a scalar read needs one channel")
        values = reading.read(device, task, 1, request.timeout)
        if not values.size:
            raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}", samples_read=0)
        return response(call, value=convert(task, values).ravel()[0])

    return read


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


def _register(task: SimulatedTask, values: NDArray[np.float64]) -> NDArray[np.uint32]:
    return _counts(values)


def _write_analog(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    refuse_other_type(task, "AO")
    values = _table(request, np.array(request.write_array, dtype=np.float64), len(task.channels))
    writing.write_volts(device, task, values, request.auto_start, request.timeout)
    return response("WriteAnalogF64", samps_per_chan_written=values.shape[0])


def _table(request: Any, values: NDArray[Any], columns: int) -> NDArray[Any]:
    n = _wanted(request)
    if n < 1 or n * columns != values.size:
        raise DaqStatusError(status.WRONG_SIZE, f"{values.size} values for {columns} channels and {n} samples")
    return values.reshape(n, columns) if _by_scan(request, "data_layout") else values.reshape(columns, n).T


def _write_analog_scalar(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    refuse_other_type(task, "AO")
    writing.write_volts(device, task, np.array([[request.value]]), request.auto_start, request.timeout)
    return response("WriteAnalogScalarF64")


def _write_lines(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    refuse_other_type(task, "DO")
    states = np.array([bool(value) for value in request.write_array], dtype=np.float64)
    n, most, channels = _wanted(request), _most_lines(task), len(task.channels)
    if n < 1 or n * most * channels != states.size:
        raise DaqStatusError(status.WRONG_SIZE, f"{states.size} levels for {channels} channels of {most} lines")
    by_scan = _by_scan(request, "data_layout")
    grid = states.reshape(n, channels, most) if by_scan else states.reshape(channels, n, most).swapaxes(0, 1)
    columns = [grid[:, i, : len(c.settings["lines"])] for i, c in enumerate(task.channels)]
    put_levels(device, task, np.concatenate(columns, axis=1), request)
    return response("WriteDigitalLines", samps_per_chan_written=n)


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


def _write_words(call: str) -> Handler:
    def write(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
        refuse_other_type(task, "DO")
        array = request.write_array
        words = np.array(list(array), dtype=np.int64)
        table = _table(request, words, len(task.channels))
        put_levels(device, task, _levels(task, table), request)
        return response(call, samps_per_chan_written=table.shape[0])

    return write


def _write_word(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
    refuse_other_type(task, "DO")
    put_levels(device, task, _levels(task, np.array([[request.value]], dtype=np.int64)), request)
    return response("WriteDigitalScalarU32")


def _read_pairs(call: str, first: str, second: str, measures: str) -> Handler:
    """Return the reader of pulses: two arrays, or two scalars."""

    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Any:
        refuse_other_type(task, "CI")
        if task.measures != measures:
            raise DaqStatusError(status.WRONG_MEASUREMENT_TYPE, f"Task: {task.name} does not measure {measures}")
        scalar = call.endswith("Scalar")
        wanted = 1 if scalar else samples_to_read(task, request)
        values = reading.read(device, task, wanted, request.timeout)
        came = values.shape[0]
        if measures == PULSE_TICKS:
            values = values.astype(np.uint32)
        if scalar:
            if not came:
                raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}", samples_read=0)
            return response(call, **{first: values[0, 0], second: values[0, 1]})
        code = 0 if came >= wanted else status.SAMPLES_NOT_YET_AVAILABLE
        filled = _laid_out(values, wanted, True).reshape(-1, 2)
        arrays = {f"read_array_{first}": filled[:, 0], f"read_array_{second}": filled[:, 1]}
        return response(call, status=code, samps_per_chan_read=came, **arrays)

    return read


_READS: dict[str, tuple[str, Converter]] = {
    "ReadAnalogF64": ("AI", _as_is),
    "ReadCounterF64Ex": ("CI", _as_is),
    "ReadCounterF64": ("CI", _as_is),
    "ReadCounterU32": ("CI", _register),
    "ReadCounterU32Ex": ("CI", _register),
    "ReadDigitalU32": ("DI", _words),
    "ReadDigitalU16": ("DI", _words),
    "ReadDigitalU8": ("DI", _words),
    "ReadDigitalLines": ("DI", lines_by_channel),
}
_SCALARS: dict[str, tuple[str, Converter]] = {
    "ReadAnalogScalarF64": ("AI", _as_is),
    "ReadCounterScalarF64": ("CI", _as_is),
    "ReadCounterScalarU32": ("CI", _register),
    "ReadDigitalScalarU32": ("DI", _words),
}
_PAIRS: dict[str, tuple[str, str, str]] = {
    "ReadCtrFreq": ("frequency", "duty_cycle", PULSE_FREQUENCY),
    "ReadCtrTime": ("high_time", "low_time", PULSE_TIME),
    "ReadCtrTicks": ("high_ticks", "low_ticks", PULSE_TICKS),
}
DATA_CALLS: dict[str, Handler] = {
    **{call + end: _read_pairs(call + end, *how) for call, how in _PAIRS.items() for end in ("", "Scalar")},
    **PULSE_WRITES,
    **{call: _read(call, *how) for call, how in _READS.items()},
    **{call: _read_scalar(call, *how) for call, how in _SCALARS.items()},
    "WriteAnalogF64": _write_analog,
    "WriteAnalogScalarF64": _write_analog_scalar,
    "WriteDigitalLines": _write_lines,
    "WriteDigitalU32": _write_words("WriteDigitalU32"),
    "WriteDigitalU16": _write_words("WriteDigitalU16"),
    "WriteDigitalU8": _write_words("WriteDigitalU8"),
    "WriteDigitalScalarU32": _write_word,
}
