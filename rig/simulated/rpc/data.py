"""Calls of a DAQmx client that move samples: reading and writing of analog, counter and digital tasks.

Samples are put into the layout the call asks for: by channel, by scan, or as waveforms (samples with their times, names
and units). A read that times out returns what came, with the driver's status, as the real server does. Times are those
of the bench's clock, counted from the moment the device was made.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask, TaskType
from rig.simulated.driver import all_has_come, read_samples, write_levels, write_volts
from rig.simulated.rpc.messages import Fields, TaskHandler, enum
from rig.simulated.rpc.properties import most_lines, volts_per_code
from rig.simulated.status import Code, DaqStatusError, NotImplementedByDevice

_BY_SCAN = 1
MOST_VALUES = 2**26
"""Values one call may move."""
Converter = Callable[[SimulatedTask, NDArray[np.float64]], NDArray[Any]]
Parser = Callable[[DeviceState, SimulatedTask, Any], NDArray[Any]]


def refuse_other_type(task: SimulatedTask, type_: str) -> None:
    """Refuse to read or write a task of another type than the call moves."""
    if task.type != type_:
        code = Code.PHYS_CHAN_OUTPUT_TYPE if type_ in ("AO", "DO", "CO") else Code.PHYS_CHAN_MEAS_TYPE
        raise DaqStatusError(code, f"Task: {task.name} is {task.type}")


def _by_scan(request: Any, field: str) -> bool:
    return field in request.DESCRIPTOR.fields_by_name and enum(request, field) == _BY_SCAN


def samples_to_read(task: SimulatedTask, request: Any, values_per_sample: int | None = None) -> int:
    """Return the samples per channel to read; refuses more than the client has room for.

    ``values_per_sample`` counts all channels of the task; by default there is one value a channel.
    """
    wanted, fields = int(request.num_samps_per_chan), request.DESCRIPTOR.fields_by_name
    needed = max(wanted, 0) * (values_per_sample or len(task.channels))
    sizes = [name for name in ("array_size_in_samps", "array_size_in_bytes") if name in fields]
    room = min([MOST_VALUES, *(getattr(request, name) for name in sizes)])
    if needed > room:
        raise DaqStatusError(Code.READ_BUFFER_TOO_SMALL, f"Task: {task.name}: {needed} values, room for {room}")
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
        wanted = samples_to_read(task, request, most_lines(task) * len(task.channels) if by_line else None)
        values = convert(task, read_samples(device, task, wanted, request.timeout))
        flat = _laid_out(values, wanted, _by_scan(request, "fill_mode"))
        fields = {
            "read_array": bytes(flat.astype(np.uint8)) if as_bytes else flat,
            **({"num_bytes_per_samp": most_lines(task)} if by_line else {}),
        }
        return {**fields, **came(task, values, wanted)}

    return read


def came(task: SimulatedTask, values: NDArray[Any], wanted: int) -> Fields:
    """Return status and number of the samples per channel a read gives: fewer than wanted when it timed out.

    Fewer also come, without an error, at the end of a finite acquisition.
    """
    n = values.shape[0]
    return {
        "status": 0 if n >= wanted or all_has_come(task) else Code.SAMPLES_NOT_YET_AVAILABLE,
        "samps_per_chan_read": n,
    }


def _read_scalar(type_: str, convert: Converter) -> TaskHandler:
    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, type_)
        if len(task.channels) != 1:
            raise DaqStatusError(Code.MULTI_CHAN_TYPES_IN_TASK, f"Task: {task.name}: a scalar read needs one channel")
        values = _one_sample(device, task, request)
        return {"value": convert(task, values).ravel()[0]}

    return read


def _one_sample(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
    values = read_samples(device, task, 1, request.timeout)
    if not values.size:
        raise DaqStatusError(Code.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}", samples_read=0)
    return values


def _as_is(task: SimulatedTask, values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values


def lines_by_channel(task: SimulatedTask, levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, channels, lines of the largest channel); a smaller channel is filled up with low."""
    out = np.zeros((levels.shape[0], len(task.channels), most_lines(task)))
    column = 0
    for index, channel in enumerate(task.channels):
        n = len(channel.settings["lines"])
        out[:, index, :n] = levels[:, column : column + n]
        column += n
    return out


def _write(type_: TaskType, parse: Parser, *, counts: bool = True) -> TaskHandler:
    """Return the writer of an output task, which takes the samples, (n, channels or lines), that ``parse`` finds."""

    def write(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, type_)
        values = parse(device, task, request)
        put = write_volts if type_ == "AO" else write_levels
        put(device, task, values, request.auto_start, request.timeout)
        return {"samps_per_chan_written": values.shape[0]} if counts else {}

    return write


def _table(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[Any]:
    values, n, columns = np.array(list(request.write_array)), int(request.num_samps_per_chan), len(task.channels)
    if n < 1 or n * columns != values.size:
        detail = f"{values.size} values for {columns} channels and {n} samples"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    return values.reshape(n, columns) if _by_scan(request, "data_layout") else values.reshape(columns, n).T


def _converter_codes(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
    """Codes of 16-bit converters, in the order of the channels, scan by scan."""
    codes = np.frombuffer(request.write_array, dtype="<i2")
    if any("scale" in channel.settings for channel in task.channels):
        raise NotImplementedByDevice(f"raw samples of a channel with a custom scale in {task.name}")
    n, columns = int(request.num_samps), len(task.channels)
    if n < 1 or n * columns > codes.size:
        detail = f"{codes.size} codes for {columns} channels and {n} samples"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    reach = np.array([device.inventory.of(c.physical.name).product.ao_range_v for c in task.channels])
    return np.asarray(codes[: n * columns].reshape(n, columns) * (reach / 2**15))


def _one_value(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[Any]:
    if len(task.channels) != 1:
        detail = f"Task: {task.name}: one value for {len(task.channels)} channels"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    return np.array([[request.value]])


def _line_levels(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
    states = np.array([bool(value) for value in request.write_array], dtype=np.float64)
    n, most, channels = int(request.num_samps_per_chan), most_lines(task), len(task.channels)
    if n < 1 or n * most * channels != states.size:
        detail = f"{states.size} levels for {channels} channels of {most} lines"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    by_scan = _by_scan(request, "data_layout")
    grid = states.reshape(n, channels, most) if by_scan else states.reshape(channels, n, most).swapaxes(0, 1)
    return np.concatenate([grid[:, i, : len(c.settings["lines"])] for i, c in enumerate(task.channels)], axis=1)


def _bits(parse: Parser) -> Parser:
    """Return the parser of words: bit i is line i of the channel's port."""

    def levels(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
        words = parse(device, task, request).astype(np.int64)
        bits = [
            (words[:, index] >> int(line.rsplit("line", 1)[1])) & 1
            for index, channel in enumerate(task.channels)
            for line in channel.settings["lines"]
        ]
        return np.stack(bits, axis=1).astype(np.float64)

    return levels


def _waveform_samples(device: DeviceState, task: SimulatedTask, request: Any) -> NDArray[np.float64]:
    tables = []
    for waveform, channel in zip(request.waveforms, task.channels, strict=False):
        if task.type == "AO":
            tables.append(np.array(waveform.y_data, dtype=np.float64)[:, None])
            continue
        lines, data = len(channel.settings["lines"]), np.frombuffer(waveform.y_data, dtype=np.uint8)
        if waveform.signal_count != lines or data.size % lines:
            detail = f"Channel: {channel.name}: {waveform.signal_count} signals for {lines} lines"
            raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
        if data.size and data.max() > 1:
            detail = f"Channel: {channel.name}: a level is neither 0 nor 1"
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, detail)
        tables.append(data.reshape(-1, lines).astype(np.float64))
    given = len(request.waveforms)
    if given != len(task.channels) or len({table.shape[0] for table in tables}) != 1 or not tables[0].size:
        detail = f"{given} waveforms for {len(task.channels)} channels, or of unequal length"
        raise DaqStatusError(Code.WRITE_NUM_CHANS_MISMATCH, detail)
    return np.concatenate(tables, axis=1)


def _read_pairs(first: str, second: str, measures: str, *, scalar: bool) -> TaskHandler:
    """Return the reader of pulses: two arrays, or two scalars."""

    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, "CI")
        if task.measures != measures:
            raise DaqStatusError(Code.PHYS_CHAN_MEAS_TYPE, f"Task: {task.name} does not measure {measures}")
        type_ = np.uint32 if measures == daqmx.PULSE_TICKS else np.float64
        if scalar:
            pair = _one_sample(device, task, request).astype(type_)[0]
            return {first: pair[0], second: pair[1]}
        wanted = samples_to_read(task, request)
        values = read_samples(device, task, wanted, request.timeout).astype(type_)
        filled = _laid_out(values, wanted, True).reshape(-1, 2)
        return {f"read_array_{first}": filled[:, 0], f"read_array_{second}": filled[:, 1], **came(task, values, wanted)}

    return read


NI_EPOCH_S = 2_082_844_800
"""Seconds from 1904, where NI's time begins, to 1970."""
TIMING, EXTENDED = 1, 2
"""Bits of the waveform attribute mode."""


def _times(device: DeviceState, task: SimulatedTask, n: int) -> dict[str, Any]:
    clock, progress = task.timing.clock, task.progress
    if clock is None or task.timing.change_lines or task.buffer is None:
        return {}
    first = task.buffer.read - n - progress.samples_before_trigger
    since_s = progress.live_since_s - device.bench.now_s + device.bench.clock.now_s
    at_s = device.bench.clock.made_s + since_s + first / clock.rate_hz + NI_EPOCH_S
    whole = int(np.floor(at_s))
    t0 = {"seconds": whole, "fractional_seconds": min(int((at_s - whole) * 2.0**64), 2**64 - 1)}
    return {"t0": t0, "dt": 1 / clock.rate_hz}


def _read_waveforms(type_: TaskType) -> TaskHandler:
    """Return the reader of one waveform a channel, with what its waveform attribute mode asks for."""

    def read(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        refuse_other_type(task, type_)
        wanted, mode = samples_to_read(task, request), enum(request, "waveform_attribute_mode")
        values = read_samples(device, task, wanted, request.timeout)
        timing = _times(device, task, values.shape[0]) if mode & TIMING else {}
        levels = lines_by_channel(task, values).astype(np.uint8) if type_ == "DI" else None
        waveforms = []
        for index, channel in enumerate(task.channels):
            lines, named = channel.settings.get("lines", ()), {"NI_ChannelName": channel.name}
            if levels is None:
                data: dict[str, Any] = {"y_data": values[:, index]}
                if channel.physical.kind == "voltage_in":
                    named["NI_UnitDescription"] = "Volts"
            else:
                data = {"y_data": levels[:, index, : len(lines)].tobytes(), "signal_count": len(lines)}
                named["NI_LineNames"] = ",".join(line.split("/", 1)[1] for line in lines)
            extended = {name: {"string_value": text} for name, text in named.items()} if mode & EXTENDED else {}
            waveforms.append({**data, **timing, "attributes": extended})
        return {"waveforms": waveforms, **came(task, values, wanted)}

    return read


def _codes(
    device: DeviceState, task: SimulatedTask, request: Any, values_per_sample: int | None = None
) -> tuple[NDArray[np.int64], Fields]:
    """Return converter codes, (n, channels); channels of 24 bits or with a bridge's scaling are not there."""
    refuse_other_type(task, "AI")
    steps = []
    for channel in task.channels:
        step = volts_per_code(device, channel)
        if step is None or "scale" in channel.settings:
            raise NotImplementedByDevice(f"raw samples of {channel.physical.name}")
        steps.append(step)
    wanted = samples_to_read(task, request, values_per_sample)
    values = read_samples(device, task, wanted, request.timeout)
    return np.rint(values / np.array(steps)).astype(np.int64), came(task, values, wanted)


def _read_raw(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    codes, read = _codes(device, task, request, 2 * len(task.channels))
    data = codes.astype("<i2").tobytes()  # interleaved, as the converter gives them
    return {"read_array": data, "status": read["status"], "samps_read": codes.shape[0], "num_bytes_per_samp": 2}


def _read_codes(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    codes, read = _codes(device, task, request)
    return {"read_array": (codes if enum(request, "fill_mode") == 1 else codes.T).ravel(), **read}


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
    "WriteAnalogF64": _write("AO", _table),
    "WriteAnalogScalarF64": _write("AO", _one_value, counts=False),
    "WriteAnalogWaveforms": _write("AO", _waveform_samples),
    "WriteRaw": _write("AO", _converter_codes),
    "WriteDigitalLines": _write("DO", _line_levels),
    **dict.fromkeys(("WriteDigitalU32", "WriteDigitalU16", "WriteDigitalU8"), _write("DO", _bits(_table))),
    "WriteDigitalScalarU32": _write("DO", _bits(_one_value), counts=False),
    "WriteDigitalWaveforms": _write("DO", _waveform_samples),
    "ReadAnalogWaveforms": _read_waveforms("AI"),
    "ReadDigitalWaveforms": _read_waveforms("DI"),
    "ReadRaw": _read_raw,
    "ReadBinaryI16": _read_codes,
    "ReadBinaryI32": _read_codes,
}
