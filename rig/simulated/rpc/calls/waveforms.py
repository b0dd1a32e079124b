"""Calls of a DAQmx client that move waveforms (samples with their times, names and units) and raw converter codes.

The samples are those of :mod:`rig.simulated.rpc.calls.data`. Times are those of the bench's clock, counted from the
moment the device was made.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.driver import reading, writing
from rig.simulated.rpc.calls.data import came, lines_by_channel, put_levels, refuse_other_type, samples_to_read
from rig.simulated.rpc.handlers import Fields, TaskHandler
from rig.simulated.rpc.messages import enum
from rig.simulated.rpc.properties.channel import volts_per_code
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

NI_EPOCH_S = 2_082_844_800
"""Seconds from 1904, where NI's time begins, to 1970."""
TIMING, EXTENDED = 1, 2
"""Bits of the waveform attribute mode."""
_MADE_S = time.time()


def _times(device: DeviceState, task: SimulatedTask, n: int) -> dict[str, Any]:
    clock, progress = task.timing.clock, task.progress
    if clock is None or task.timing.change_lines or task.buffer is None:
        return {}
    first = task.buffer.read - n - progress.samples_before_trigger
    since_s = progress.live_since_s - device.bench.now_s + device.bench.clock.now_s
    at_s = _MADE_S + since_s + first / clock.rate_hz + NI_EPOCH_S
    whole = int(np.floor(at_s))
    t0 = {"seconds": whole, "fractional_seconds": min(int((at_s - whole) * 2.0**64), 2**64 - 1)}
    return {"t0": t0, "dt": 1 / clock.rate_hz}


def _named(name: str, unit: str = "") -> dict[str, Any]:
    named = {"NI_ChannelName": {"string_value": name}}
    return {**named, "NI_UnitDescription": {"string_value": unit}} if unit else named


def _read(device: DeviceState, task: SimulatedTask, request: Any, type_: str) -> tuple[NDArray[Any], Fields, Any]:
    refuse_other_type(task, type_)
    wanted = samples_to_read(task, request)
    values = reading.read(device, task, wanted, request.timeout)
    mode = enum(request, "waveform_attribute_mode")
    timing = _times(device, task, values.shape[0]) if mode & TIMING else {}
    return values, came(task, values, wanted), (timing, bool(mode & EXTENDED))


def _read_analog(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    values, read, (timing, named) = _read(device, task, request, "AI")
    waveforms = []
    for column, channel in enumerate(task.channels):
        unit = "Volts" if channel.physical.kind == "voltage_in" else ""
        extra = {"attributes": _named(channel.name, unit)} if named else {}
        waveforms.append({"y_data": values[:, column], **timing, **extra})
    return {"waveforms": waveforms, **read}


def _read_digital(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    values, read, (timing, named) = _read(device, task, request, "DI")
    levels, waveforms = lines_by_channel(task, values), []
    for index, channel in enumerate(task.channels):
        lines = channel.settings["lines"]
        extra = {"attributes": _named(channel.name)} if named else {}
        if named:
            signals = ",".join(line.split("/", 1)[1] for line in lines)
            extra["attributes"]["NI_LineNames"] = {"string_value": signals}
        data = levels[:, index, : len(lines)].astype(np.uint8).tobytes()
        waveforms.append({"y_data": data, "signal_count": len(lines), **timing, **extra})
    return {"waveforms": waveforms, **read}


def _columns(task: SimulatedTask, waveforms: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    if len(waveforms) != len(task.channels) or len({w.shape[0] for w in waveforms}) != 1 or not waveforms[0].size:
        detail = f"{len(waveforms)} waveforms for {len(task.channels)} channels, or of unequal length"
        raise DaqStatusError(status.WRONG_SIZE, detail)
    return np.concatenate(waveforms, axis=1)


def _write_analog(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "AO")
    values = _columns(task, [np.array(w.y_data, dtype=np.float64)[:, None] for w in request.waveforms])
    writing.write_volts(device, task, values, request.auto_start, request.timeout)
    return {"samps_per_chan_written": values.shape[0]}


def _write_digital(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_other_type(task, "DO")
    tables = []
    for waveform, channel in zip(request.waveforms, task.channels, strict=False):
        lines = len(channel.settings["lines"])
        data = np.frombuffer(waveform.y_data, dtype=np.uint8)
        if waveform.signal_count != lines or data.size % lines:
            detail = f"Channel: {channel.name}: {waveform.signal_count} signals for {lines} lines"
            raise DaqStatusError(status.WRONG_SIZE, detail)
        if data.size and data.max() > 1:
            raise DaqStatusError(status.INVALID_VALUE, f"Channel: {channel.name}: a level is neither 0 nor 1")
        tables.append(data.reshape(-1, lines).astype(np.float64))
    if len(request.waveforms) != len(task.channels):
        tables = []
    values = _columns(task, tables)
    put_levels(device, task, values, request)
    return {"samps_per_chan_written": values.shape[0]}


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
    values = reading.read(device, task, wanted, request.timeout)
    return np.rint(values / np.array(steps)).astype(np.int64), came(task, values, wanted)


def _read_raw(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    codes, read = _codes(device, task, request, 2 * len(task.channels))
    data = codes.astype("<i2").tobytes()  # interleaved, as the converter gives them
    return {"read_array": data, "status": read["status"], "samps_read": codes.shape[0], "num_bytes_per_samp": 2}


def _read_codes(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    codes, read = _codes(device, task, request)
    return {"read_array": (codes if enum(request, "fill_mode") == 1 else codes.T).ravel(), **read}


WAVEFORM_CALLS: dict[str, TaskHandler] = {
    "ReadAnalogWaveforms": _read_analog,
    "ReadDigitalWaveforms": _read_digital,
    "WriteAnalogWaveforms": _write_analog,
    "WriteDigitalWaveforms": _write_digital,
    "ReadRaw": _read_raw,
    "ReadBinaryI16": _read_codes,
    "ReadBinaryI32": _read_codes,
}
