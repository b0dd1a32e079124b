"""Tasks as the driver manages them: created, started, stopped, cleared; and the reset of the device."""

from __future__ import annotations

from dataclasses import replace

from rig.simulated import daqmx, status
from rig.simulated.device.sample_buffers import InputBuffer
from rig.simulated.device.state import DeviceState, WatchdogTimer, commit, release, verify
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import OFF, TdmsLog
from rig.simulated.device.watchdog import refuse_bad_timer, start_watchdog
from rig.simulated.product.inventory import Inventory
from rig.simulated.status import DaqStatusError
from rig.simulated.timing.triggers import await_trigger, go_live


def find_task(device: DeviceState, name: str) -> SimulatedTask:
    """Return a task by name."""
    if name not in device.tasks:
        raise DaqStatusError(status.INVALID_TASK, f"Task: {name!r}")
    return device.tasks[name]


def create_task(device: DeviceState, name: str) -> SimulatedTask:
    """Make an empty task; an empty name gets a free one."""
    name = name or next(f"_unnamedTask<{i}>" for i in range(10**6) if f"_unnamedTask<{i}>" not in device.tasks)
    if name in device.tasks:
        raise DaqStatusError(status.DUPLICATE_TASK, f"Task: {name}")
    device.tasks[name] = SimulatedTask(name)
    return device.tasks[name]


def create_watchdog_task(device: DeviceState, name: str, timeout_s: float, of: str = "") -> SimulatedTask:
    """Make a watchdog timer task of the device named, by default the main one."""
    refuse_bad_timer(device.inventory.of(of), name, timeout_s)
    task = create_task(device, name)
    device.watchdogs[task.name] = WatchdogTimer(name, timeout_s, of)
    return task


def clear_task(device: DeviceState, name: str) -> None:
    """Stop a task, release its resources and forget it."""
    task = find_task(device, name)
    stop_task(device, task)
    release(device, task)
    for terminal in task.exported:
        device.exports.pop(terminal, None)
    del device.tasks[name]
    device.watchdogs.pop(name, None)


def start_task(device: DeviceState, task: SimulatedTask) -> None:
    """Start a task: reserve what it needs, then go live or wait for its trigger."""
    task.refuse_while_running()
    if task.name in device.watchdogs:
        start_watchdog(device, task)
        return
    output = task.output
    if task.type in ("AO", "DO") and output.samples is None and task.timing.clock is not None:
        raise DaqStatusError(status.NO_DATA_WRITTEN, f"Task: {task.name}")
    verify(device, task)
    open_log(task)
    try:
        commit(device, task)
    except DaqStatusError:
        close_log(task)
        raise
    if output.samples is not None:
        output.size = max(int(task.setting("Buffer", "", daqmx.BUF_OUTPUT_BUF_SIZE, 0)), output.written)
    task.state, output.generated, task.pulses.finished = "running", 0, False
    task.progress = replace(
        task.progress, error=0, samples_before_trigger=0, reference_edges=None, reference_end=None, comparator=None
    )
    if task.type in ("AI", "CI", "DI"):
        columns = len(task.lines) if task.type == "DI" else len(task.channels)
        if task.measures in daqmx.PULSE_PAIRS:
            columns = 2
        task.buffer = InputBuffer(task.input_buffer_size, columns, drops_oldest=task.triggers.referenced)
    # a trigger that is waited for must still come; one that has passed never comes again
    if task.triggers.awaited:
        await_trigger(device, task)
    else:
        go_live(device, task)


def open_log(task: SimulatedTask) -> None:
    """Open the file of a task that logs, in place of the one that is open."""
    close_log(task)
    logging, clock = task.logging, task.timing.clock
    if logging.mode == OFF:
        return
    if task.type in ("AO", "DO", "CO"):
        raise DaqStatusError(status.LOGGING_OF_OUTPUTS, f"Task: {task.name}")
    if clock is None:
        raise DaqStatusError(status.LOGGING_WITHOUT_BUFFER, f"Task: {task.name}")
    if task.type == "DI" or task.measures in daqmx.PULSE_PAIRS:
        raise DaqStatusError(status.NOT_FOR_LOGGING, f"Task: {task.name}")
    interval_s = 1 / clock.rate_hz if task.timing.own_clock else 0.0
    names = [channel.name for channel in task.channels]
    task.log = TdmsLog(logging.path, logging.operation, logging.group or task.name, names, interval_s)


def close_log(task: SimulatedTask) -> None:
    """Close the file of a task that logs."""
    if task.log is not None:
        task.log.close()
        task.log = None


def stop_task(device: DeviceState, task: SimulatedTask) -> None:
    """Stop a task; an output keeps the value it has."""
    if task.state != "running":
        return
    task.progress.live = False
    close_log(task)
    if task.name in device.watchdogs:
        device.watchdogs[task.name].running = False
    if task.committed:
        task.state = "committed"
    else:
        release(device, task)


def reset_device(device: DeviceState, which: Inventory | None = None) -> None:
    """Clear all tasks that use a device, and put its outputs where they are after power-up; by default the main one."""
    inventory = device.inventory
    reset = inventory if which is None else which
    for name, task in list(device.tasks.items()):
        timer = device.watchdogs.get(name)
        if (timer is not None and inventory.of(timer.device) is reset) or (
            task.channels and inventory.of(task.channels[0].physical.name) is reset
        ):
            clear_task(device, name)
    device.output_v |= {name: 0.0 for name in device.output_v if inventory.of(name) is reset}
    device.lines |= {name: False for name in device.lines if inventory.of(name) is reset}
    for target in [target for target in device.exports if inventory.of(target) is reset]:
        del device.exports[target]
    if reset.product.expiry_locks:
        device.locked = False
