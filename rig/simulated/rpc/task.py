"""Calls of a DAQmx client about a task as a whole: start, stop, control, clocks, triggers, an exported clock."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState, commit, release
from rig.simulated.device.task import SampleClock, SimulatedTask
from rig.simulated.driver import configure_clock, start_task, stop_task
from rig.simulated.rpc.messages import Fields, enum, refuse_falling_edge
from rig.simulated.status import Code, DaqStatusError, NotAnswered, Unsupported
from rig.simulated.timing import wait_until_done

START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)
SAMPLE_CLOCK = 12487  # the signal of :func:`export_clock`


def control_task(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Answer NI's TaskControl: start, stop, abort, commit, reserve or unreserve a task, by the request's action;
    verifying is refused as not simulated."""
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
        raise NotAnswered("TaskControl with action VERIFY")
    else:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Task action {action}")


def await_task_end(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    """Answer when a task has ended, or refuse after the timeout with NI's code."""
    wait_until_done(device, task, request.time_to_wait)
    if not is_task_done(device, task, request)["is_task_done"]:
        raise DaqStatusError(Code.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE, f"Task: {task.name}")
    return {}


def is_task_done(device: DeviceState, task: SimulatedTask, request: Any) -> Fields:
    """Say whether a task has ended; a failure that ended it is the driver's answer."""
    if task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")
    return {"is_task_done": task.is_done}


def set_sample_clock(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Give a task the sample clock that the ``request`` of NI's CfgSampClkTiming describes, finite or continuous: its
    own, or the rising edges on a terminal. Its rate is coerced; falling edges are refused as not simulated."""
    mode = enum(request, "sample_mode")
    if mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
        raise NotAnswered(f"sample mode {mode}")
    configure_clock(device, task, SampleClock(request.rate, request.source, mode, int(request.samps_per_chan)))
    if not task.has_own_clock:
        refuse_falling_edge(request, "active_edge")


def set_implicit_timing(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Set how many pulses a counter output task puts out, as the ``request`` of NI's CfgImplicitTiming says; continuous
    ones have no end. Refuse other types of task, and a running one."""
    samples, mode = int(request.samps_per_chan), enum(request, "sample_mode")
    if task.type != "CO":
        raise Unsupported(f"Task: {task.name}: implicit timing")
    task.refuse_while_running()
    if samples < 1 or mode not in (daqmx.FINITE, daqmx.CONTINUOUS):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Samples per channel {samples}, sample mode {mode}")
    task.pulses.count = samples if mode == daqmx.FINITE else None


def set_start_trigger(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    if task.type == "CI":
        raise Unsupported(f"Task: {task.name}: counters are armed, not started")
    terminal = device.inventory.terminal(request.trigger_source)
    refuse_falling_edge(request, "trigger_edge")
    task.triggers.start = terminal


def export_clock(device: DeviceState, task: SimulatedTask, request: Any) -> None:
    """Put the sample clock of an analog task out on the terminal that the ``request`` of NI's ExportSignal names;
    refuse other signals, and a terminal that carries another signal already."""
    if enum(request, "signal_id") != SAMPLE_CLOCK or task.type not in ("AI", "AO"):
        raise NotAnswered(f"export of signal {enum(request, 'signal_id')} of a {task.type} task")
    target = device.inventory.terminal(request.output_terminal, output=True)
    owner = device.inventory.owner_of(task.channels[0].physical.name)
    source = device.inventory.known_as(owner, f"{str(task.type).lower()}/SampleClock")
    if device.exports.get(target, source) != source or device.reservations.is_reserved(f"PFI {target}"):
        raise DaqStatusError(Code.RESOURCES_IN_USE_FOR_ROUTE_ROUTING, f"Terminal: {request.output_terminal!r}")
    device.exports[target] = source
    task.exported.add(target)
