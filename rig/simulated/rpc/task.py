"""Calls of a DAQmx client about a task as a whole: start, stop, control, wait, clocks, triggers, buffers, and logging
of its samples to a TDMS file on the server's side.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState, commit, release, verify
from rig.simulated.device.task import LOG, LOG_AND_READ, OFF, OPEN, LogSettings, SampleClock, SimulatedTask, Timing
from rig.simulated.driver import clear_task, configure_clock, open_log, start_task, stop_task
from rig.simulated.rpc.messages import Fields, TaskHandler, enum, property_number
from rig.simulated.rpc.properties import STORED, note_edge
from rig.simulated.status import Code, DaqStatusError, NotImplementedByDevice, Unsupported, one_of
from rig.simulated.timing import wait_until_done

START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)


def _control(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    action = enum(request, "action")
    if action == START:
        start_task(device, task)
    elif action in (STOP, ABORT):
        stop_task(device, task)
    elif action in (COMMIT, RESERVE):
        commit(device, task)
        task.committed = True
    elif action == UNRESERVE:
        release(device, task)
        task.output.samples = None  # the buffer goes with the reservation
    elif action == VERIFY:
        verify(device, task)
    else:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Task action {action}")


def refuse_failed(task: SimulatedTask) -> None:
    """Raise the status that ended a task's generation, if one did."""
    if task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")


def _wait_until_done(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not task.done and not task.progress.error:
        wait_until_done(device, task, request.time_to_wait)
    refuse_failed(task)
    if not task.done:
        raise DaqStatusError(Code.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE, f"Task: {task.name}")


def _is_task_done(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    refuse_failed(task)
    return {"is_task_done": task.done}


def _nth(names: Callable[[DeviceState, SimulatedTask], list[str]]) -> TaskHandler:
    def get(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
        found = names(device, task)
        if not 1 <= request.index <= len(found):
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Index {request.index} of {len(found)}, counted from 1")
        return {"buffer": found[request.index - 1]}

    return get


_nth_channel = _nth(lambda device, task: [channel.name for channel in task.channels])

MODE, PATH, GROUP, OPERATION = (
    property_number("Read", f"LOGGING_{what}") for what in ("MODE", "FILE_PATH", "TDMS_GROUP_NAME", "TDMS_OPERATION")
)


def settle_logging(task: SimulatedTask) -> None:
    """Take over what a client has set."""

    def value(number: int) -> Any:
        return task.setting("Read", "", number, STORED["Read", number].default)

    task.logging = LogSettings(value(MODE), value(PATH), value(GROUP), value(OPERATION))


def _configure(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    task.refuse_while_running()
    mode, operation = enum(request, "logging_mode") or LOG_AND_READ, enum(request, "operation") or OPEN
    one_of(mode, (OFF, LOG, LOG_AND_READ), "Logging mode")
    for number, value in ((MODE, mode), (PATH, request.file_path), (GROUP, request.group_name), (OPERATION, operation)):
        task.properties["Read", "", number] = value
    settle_logging(task)


def _start_new_file(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if not request.file_path:
        raise DaqStatusError(Code.FILE_PATH_INVALID, f"Task: {task.name}: no path")
    task.properties["Read", "", PATH] = request.file_path
    settle_logging(task)
    if task.state == "running":
        open_log(task)


TASK_CALLS: dict[str, TaskHandler] = {
    "ClearTask": lambda device, task, request: clear_task(device, task.name),
    "StartTask": lambda device, task, request: start_task(device, task),
    "StopTask": lambda device, task, request: stop_task(device, task),
    "TaskControl": _control,
    "IsTaskDone": _is_task_done,
    "WaitUntilTaskDone": _wait_until_done,
    "GetNthTaskChannel": _nth_channel,
    "GetNthTaskReadChannel": _nth_channel,
    "GetNthTaskDevice": _nth(lambda device, task: device.devices_of(task)),
    "ConfigureLogging": _configure,
    "StartNewFile": _start_new_file,
}


SHAPES = {"analog edge": "ANLG_EDGE", "analog window": "ANLG_WIN"}
FIELDS: dict[str, dict[str, Callable[[Any], Any]]] = {
    "analog edge": {"SLOPE": lambda r: enum(r, "trigger_slope"), "LVL": lambda r: float(r.trigger_level)},
    "analog window": {
        "WHEN": lambda r: enum(r, "trigger_when"),
        "TOP": lambda r: float(r.window_top),
        "BTM": lambda r: float(r.window_bottom),
    },
}
"""Settings of an analog trigger in a request, by the end of their names."""
UNKNOWN_RATE_HZ = 1000.0
"""Taken for a clock of unknown rate, so that its task gets the buffer of 10 kS that the driver gives it."""
DIG_EDGE_REF_TRIG_SRC = property_number("Trig", "DIG_EDGE_REF_TRIG_SRC")
PRETRIGGER_SAMPLES = property_number("Trig", "REF_TRIG_PRETRIG_SAMPLES")
DIG_EDGE_REF_TRIG_EDGE = property_number("Trig", "DIG_EDGE_REF_TRIG_EDGE")
SIGNALS = {12487: "SampleClock", 12491: "StartTrigger"}


def _sample_clock(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    mode = enum(request, "sample_mode")
    if mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
        raise NotImplementedByDevice(f"sample mode {mode}")
    configure_clock(device, task, SampleClock(request.rate, request.source, mode, int(request.samps_per_chan)))
    note_edge(task, "sample clock", daqmx.RISING if task.timing.own_clock else enum(request, "active_edge"))


def _implicit(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    samples, mode = int(request.samps_per_chan), enum(request, "sample_mode")
    if task.type not in ("CI", "CO") or (task.type == "CI" and "decoding_type" in task.channels[0].settings):
        raise Unsupported(f"Task: {task.name}: implicit timing")
    task.refuse_while_running()
    if samples < 1 or mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {samples}, sample mode {mode}")
    if task.type == "CO":
        task.pulses.count = samples if mode == daqmx.FINITE else None
        return
    if task.measures == daqmx.EDGES:
        raise Unsupported(f"Task: {task.name}: edges are counted by a sample clock")
    task.timing = Timing(SampleClock(UNKNOWN_RATE_HZ, "", mode, samples), implicit=True)


def _change_detection(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if task.type != "DI" or not device.inventory.of(task.channels[0].physical.name).product.change_detection:
        raise Unsupported(f"Task: {task.name}: change detection")
    named = ((request.rising_edge_chan, True), (request.falling_edge_chan, False))
    lines = {(line, level) for text, level in named if text for line in device.inventory.lines(text)}
    if not lines or any(line.kind != "line" for line, _ in lines):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, "Change detection needs lines that support it")
    clock = SampleClock(1.0, "", enum(request, "sample_mode"), max(int(request.samps_per_chan), 1))
    task.timing = Timing(clock, change_lines=frozenset((line.name, level) for line, level in lines))


def _start_trigger(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if task.type == "CI":
        raise Unsupported(f"Task: {task.name}: counters are armed, not started")
    terminal = device.inventory.terminal(request.trigger_source)
    task.forget_trigger("start trigger")
    note_edge(task, "start trigger", enum(request, "trigger_edge"))
    task.triggers.start = terminal


def _keep_pretrigger(task: SimulatedTask, request: Any) -> None:
    task.triggers.pretrigger_samples = int(request.pretrigger_samples)
    task.properties["Trig", "", PRETRIGGER_SAMPLES] = task.triggers.pretrigger_samples


def trigger_source(device: DeviceState, task: SimulatedTask, name: str) -> str:
    """Check the source of an analog trigger: an analog terminal of the card, or an input by its channel's name."""
    owner = device.inventory.of(task.channels[0].physical.name)
    relative = name.removeprefix(f"/{owner.name}/")
    if re.fullmatch(r"APFI[01]", relative) and owner.product.apfi:
        return f"/{owner.name}/{relative}"
    if any(name in (channel.name, channel.physical.name) for channel in task.channels):
        return name
    return device.inventory.channel(name, "voltage_in").name


def _unsimulated(which: str, kind: str) -> TaskHandler:
    """A trigger kept like a setting; one that the virtual bench does not have is refused when the task is committed."""
    short = "REF" if which == "reference trigger" else "START"

    def configure(device: DeviceState, task: SimulatedTask, request: Any) -> None:
        task.refuse_while_running()
        if which == "reference trigger" and task.type != "AI":
            raise Unsupported(f"Task: {task.name}: reference trigger")
        source = trigger_source(device, task, request.trigger_source) if kind in SHAPES else ""
        task.forget_trigger(which)
        if kind not in SHAPES:
            task.unsimulated[which] = kind
            return
        task.triggers.analog_kinds[which] = kind
        settings = {"SRC": source, **{what: get(request) for what, get in FIELDS[kind].items()}}
        for what, value in settings.items():
            task.properties["Trig", "", property_number("Trig", f"{SHAPES[kind]}_{short}_TRIG_{what}")] = value
        if short == "REF":
            _keep_pretrigger(task, request)

    return configure


def _reference_trigger(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if task.type != "AI" or task.timing.clock is None or not task.timing.finite:
        raise Unsupported(f"Task: {task.name}: reference trigger")
    if not 2 <= request.pretrigger_samples < task.timing.clock.samples - 1:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Pretrigger samples {request.pretrigger_samples}")
    task.forget_trigger("reference trigger")
    apfi = re.fullmatch(r"(/\w+/)?(APFI[01])", request.trigger_source)
    if apfi and device.inventory.of(request.trigger_source).product.apfi:
        # an analog terminal as a digital one: by the level of its comparator, which is not simulated
        owner = device.inventory.of(task.channels[0].physical.name)
        task.unsimulated["reference trigger"] = f"digital edge on {apfi[2]}"
        _keep_pretrigger(task, request)
        task.properties["Trig", "", DIG_EDGE_REF_TRIG_SRC] = f"/{owner.name}/{apfi[2]}"
        task.properties["Trig", "", DIG_EDGE_REF_TRIG_EDGE] = enum(request, "trigger_edge")
        return
    terminal = device.inventory.terminal(request.trigger_source)
    if device.inventory.own_name(terminal) in device.inventory.of(request.trigger_source).product.internal:
        raise NotImplementedByDevice(f"reference trigger on {request.trigger_source}")
    note_edge(task, "reference trigger", enum(request, "trigger_edge"))
    task.triggers.reference = terminal
    _keep_pretrigger(task, request)


def _export(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    signal = SIGNALS.get(enum(request, "signal_id"))
    if signal is None or task.type not in ("AI", "AO", "DI", "DO"):
        raise NotImplementedByDevice(f"export of signal {enum(request, 'signal_id')}")
    target = device.inventory.terminal(request.output_terminal, output=True)
    owner = device.inventory.of(task.channels[0].physical.name)
    source = device.inventory.known_as(owner, f"{str(task.type).lower()}/{signal}")
    if device.exports.get(target, source) != source or device.reservations.is_reserved(f"PFI {target}"):
        raise DaqStatusError(Code.RESOURCES_IN_USE_FOR_ROUTE_ROUTING, f"Terminal: {request.output_terminal!r}")
    device.exports[target] = source
    task.exported.add(target)


TIMING_CALLS: dict[str, TaskHandler] = {
    "CfgSampClkTiming": _sample_clock,
    "CfgImplicitTiming": _implicit,
    "CfgChangeDetectionTiming": _change_detection,
    "CfgDigEdgeStartTrig": _start_trigger,
    "DisableStartTrig": lambda device, task, request: task.forget_trigger("start trigger"),
    "CfgDigEdgeRefTrig": _reference_trigger,
    "DisableRefTrig": lambda device, task, request: task.forget_trigger("reference trigger"),
    **{
        f"Cfg{kind}{end}": _unsimulated(which, words)
        for kind, words in (
            ("AnlgEdge", "analog edge"),
            ("AnlgMultiEdge", "analog edges"),
            ("AnlgWindow", "analog window"),
            ("DigPattern", "digital pattern"),
        )
        for end, which in (("StartTrig", "start trigger"), ("RefTrig", "reference trigger"))
    },
    "CfgInputBuffer": lambda device, task, request: task.properties.update(
        {("Buffer", "", daqmx.BUF_INPUT_BUF_SIZE): int(request.num_samps_per_chan)}
    ),
    "CfgOutputBuffer": lambda device, task, request: task.properties.update(
        {("Buffer", "", daqmx.BUF_OUTPUT_BUF_SIZE): int(request.num_samps_per_chan)}
    ),
    "ExportSignal": _export,
}
