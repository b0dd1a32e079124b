"""Calls of a DAQmx client that set clocks, triggers and buffers of a task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated import status
from rig.simulated.device.device import SimulatedDevice
from rig.simulated.device.input_readings import EDGES
from rig.simulated.device.task import CONTINUOUS, FINITE, SampleClock, SimulatedTask
from rig.simulated.messages import enum
from rig.simulated.status import DaqStatusError, NotImplementedByDevice

UNKNOWN_RATE_HZ = 1000.0
"""A clock of unknown rate gets the buffer of 10 kS that the driver gives it."""
SIGNALS = {12487: "SampleClock", 12491: "StartTrigger"}


def _sample_clock(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    mode = enum(request, "sample_mode")
    if mode not in (FINITE, CONTINUOUS):
        raise NotImplementedByDevice(f"sample mode {mode}")
    device.configure_clock(task, request.rate, request.source, mode, int(request.samps_per_chan))


def _implicit(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    samples, mode = int(request.samps_per_chan), enum(request, "sample_mode")
    if task.type not in ("CI", "CO") or (task.type == "CI" and "decoding_type" in task.channels[0].settings):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: implicit timing")
    if task.state == "running":
        raise DaqStatusError(status.TASK_RUNNING, f"Task: {task.name}")
    if samples < 1 or mode not in (FINITE, CONTINUOUS):
        raise DaqStatusError(status.INVALID_VALUE, f"Samples per channel {samples}, sample mode {mode}")
    if task.type == "CO":
        task.pulses = samples if mode == FINITE else None
        return
    if task.channels[0].settings["measures"] == EDGES:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: edges are counted by a sample clock")
    task.implicit, task.clock = True, SampleClock(UNKNOWN_RATE_HZ, "", mode, samples)


def _change_detection(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    if task.type != "DI" or not device.inventory.product.change_detection:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: change detection")
    named = [text for text in (request.rising_edge_chan, request.falling_edge_chan) if text]
    lines = [line for text in named for line in device.inventory.lines(text)]
    if not lines or any(line.kind != "line" for line in lines):
        raise DaqStatusError(status.INVALID_VALUE, "Change detection needs lines that support it")
    task.changes = frozenset(line.name for line in lines)
    task.clock = SampleClock(1.0, "", enum(request, "sample_mode"), max(int(request.samps_per_chan), 1))


def _start_trigger(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    if task.type == "CI":
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: counters are armed, not started")
    task.start_trigger = device.inventory.terminal(request.trigger_source)


def _no_start_trigger(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    task.start_trigger = ""


def _reference_trigger(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    if task.type != "AI" or task.clock is None or task.clock.mode != FINITE:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: reference trigger")
    if not 2 <= request.pretrigger_samples < task.clock.samples - 1:
        raise DaqStatusError(status.INVALID_VALUE, f"Pretrigger samples {request.pretrigger_samples}")
    terminal = device.inventory.terminal(request.trigger_source)
    if terminal in device.inventory.product.internal:
        raise NotImplementedByDevice(f"reference trigger on {request.trigger_source}")
    task.ref_trigger, task.pretrigger = terminal, int(request.pretrigger_samples)


def _no_reference_trigger(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    task.ref_trigger = ""


def _buffer(attribute: int) -> Callable[[SimulatedDevice, SimulatedTask, Any], None]:
    def configure(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
        task.attributes["Buffer", "", attribute] = int(request.num_samps_per_chan)

    return configure


def _export(device: SimulatedDevice, task: SimulatedTask, request: Any) -> None:
    signal = SIGNALS.get(enum(request, "signal_id"))
    if signal is None or task.type not in ("AI", "AO", "DI", "DO"):
        raise NotImplementedByDevice(f"export of signal {enum(request, 'signal_id')}")
    target = device.inventory.terminal(request.output_terminal, output=True)
    source = f"{str(task.type).lower()}/{signal}"
    if device.exports.get(target, source) != source or device.reservations.is_held(f"PFI {target}"):
        raise DaqStatusError(status.ROUTE_IN_USE, f"Terminal: {request.output_terminal!r}")
    device.exports[target] = source
    task.exported.add(target)


TIMING_CALLS: dict[str, Callable[[SimulatedDevice, SimulatedTask, Any], None]] = {
    "CfgSampClkTiming": _sample_clock,
    "CfgImplicitTiming": _implicit,
    "CfgChangeDetectionTiming": _change_detection,
    "CfgDigEdgeStartTrig": _start_trigger,
    "DisableStartTrig": _no_start_trigger,
    "CfgDigEdgeRefTrig": _reference_trigger,
    "DisableRefTrig": _no_reference_trigger,
    "CfgInputBuffer": _buffer(0x186C),
    "CfgOutputBuffer": _buffer(0x186D),
    "ExportSignal": _export,
}
