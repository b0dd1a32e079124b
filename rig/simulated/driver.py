"""What the NI-DAQmx driver does for a client: creates, configures, starts and stops tasks, reads and writes samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState, WatchdogTimer, commit, release
from rig.simulated.device.task import Channel, InputBuffer, Progress, SampleClock, SimulatedTask, TaskType
from rig.simulated.device.watchdog import refuse_bad_timer, refuse_expired, start_watchdog
from rig.simulated.product import Inventory, Kind, channel_names
from rig.simulated.signals import latch_now, set_outputs
from rig.simulated.status import Code, DaqStatusError, NotAnswered
from rig.simulated.timing import await_something, await_trigger, go_live, settle_on_demand, wait_for_samples


def find_task(device: DeviceState, name: str) -> SimulatedTask:
    if name not in device.tasks:
        raise DaqStatusError(Code.INVALID_TASK, f"Task: {name!r}")
    return device.tasks[name]


def create_task(device: DeviceState, name: str) -> SimulatedTask:
    """Make an empty task; an empty name gets a free one."""
    name = name or next(f"_unnamedTask<{i}>" for i in range(10**6) if f"_unnamedTask<{i}>" not in device.tasks)
    if name in device.tasks:
        raise DaqStatusError(Code.DUPLICATE_TASK, f"Task: {name}")
    device.tasks[name] = SimulatedTask(name)
    return device.tasks[name]


def create_watchdog_task(device: DeviceState, name: str, timeout_s: float, of: str = "") -> SimulatedTask:
    refuse_bad_timer(device.inventory.owner_of(of), name, timeout_s)
    task = create_task(device, name)
    device.watchdogs[task.name] = WatchdogTimer(name, timeout_s, of)
    return task


def clear_task(device: DeviceState, name: str) -> None:
    """Stop a task, release its resources and forget it, with the signals it exports and its watchdog timer; refuse a
    name that no task has."""
    task = find_task(device, name)
    stop_task(device, task)
    release(device, task)
    for terminal in task.exported:
        device.exports.pop(terminal, None)
    del device.tasks[name]
    device.watchdogs.pop(name, None)


def start_task(device: DeviceState, task: SimulatedTask) -> None:
    """Start a task: reserve its hardware, begin its counts anew, then go live or wait for its trigger; a watchdog task
    starts its timer. Refuse a running one, a clocked output without samples, and hardware that another task holds."""
    task.refuse_while_running()
    if task.name in device.watchdogs:
        start_watchdog(device, task)
        return
    output = task.output
    if task.type == "AO" and output.samples is None and task.clock is not None:
        raise DaqStatusError(Code.OUTPUT_BUFFER_EMPTY, f"Task: {task.name}")
    commit(device, task)
    task.state, output.generated, task.pulses.finished = "running", 0, False
    task.progress = Progress()
    if task.type in ("AI", "CI"):
        task.buffer = InputBuffer(task.input_buffer_size, len(task.channels))
    # a trigger that is waited for must still come; one that has passed never comes again
    if task.triggers.begin:
        await_trigger(device, task)
    else:
        go_live(device, task)


def stop_task(device: DeviceState, task: SimulatedTask) -> None:
    """Stop a task and give its hardware back unless a client has committed it; an output keeps the value it has.
    Nothing happens to a task that does not run."""
    if task.state != "running":
        return
    task.progress.live = False
    if task.name in device.watchdogs:
        device.watchdogs[task.name].running = False
    if task.committed:
        task.state = "committed"
    else:
        release(device, task)


def reset_device(device: DeviceState, which: Inventory | None = None) -> None:
    """Clear all tasks of a device (None: the main one), put its outputs at 0 V and low as after power-up, end its
    exported signals, and unlock a chassis whose watchdog has expired."""
    inventory = device.inventory
    reset = inventory if which is None else which
    for name, task in list(device.tasks.items()):
        timer = device.watchdogs.get(name)
        if (timer is not None and inventory.owner_of(timer.device) is reset) or (
            task.channels and inventory.owner_of(task.channels[0].physical.name) is reset
        ):
            clear_task(device, name)
    device.output_v |= {name: 0.0 for name in device.output_v if inventory.owner_of(name) is reset}
    device.lines |= {name: False for name in device.lines if inventory.owner_of(name) is reset}
    for target in [target for target in device.exports if inventory.owner_of(target) is reset]:
        del device.exports[target]
    if reset.product.expiry_locks:
        device.locked = False


def add_channels(
    device: DeviceState, task: SimulatedTask, type_: TaskType, kind: Kind, physical: str, name: str, **settings: Any
) -> None:
    """Add the physical channels that a list such as ``Dev1/ai0:2`` names, all of ``kind``, to a task as type ``type_``;
    ``name``: of the virtual channel, numbered for several, "" for the physical name; ``settings``: kept with each
    channel."""
    names = channel_names(physical)
    for index, part in enumerate(names):
        channel = device.inventory.channel(part, kind)
        assigned = name if len(names) == 1 else f"{name}{index}"
        task.add_channel(type_, Channel(assigned if name else channel.name, channel, dict(settings)))


def add_lines(device: DeviceState, task: SimulatedTask, lines: str, name: str, *, one_channel: bool) -> None:
    """Add digital outputs to a task, a list of lines such as ``Dev1/port0/line0:7`` or of whole ports: as one channel
    or as one per line, called ``name`` (numbered from 0 for several), or after the lines where that is empty."""
    found = device.inventory.lines(lines)
    groups = [found] if one_channel else [[line] for line in found]
    for index, group in enumerate(groups):
        assigned = name if len(groups) == 1 else f"{name}{index}"
        port = group[0].name.rsplit("/", 1)[0]
        several = port if lines.strip().lower() == port.lower() else group[0].name + "..."
        usual = several if len(group) > 1 else group[0].name
        task.add_channel("DO", Channel(assigned if name else usual, group[0], {"lines": [line.name for line in group]}))


def configure_clock(device: DeviceState, task: SimulatedTask, clock: SampleClock) -> None:
    """Give a task a copy of ``clock`` with its rate coerced to one that the product has; refuse a running task or one
    without channels, a counter or digital output, a counter input without a source, and an unknown terminal."""
    rate_hz, source = clock.rate_hz, clock.source
    if not task.channels:
        raise DaqStatusError(Code.CAN_NOT_PERFORM_OP_WHEN_NO_CHANS_IN_TASK, f"Task: {task.name}")
    task.refuse_while_running()
    if task.type in ("CO", "DO"):
        raise NotAnswered(f"a sample clock of a {task.type} task")
    if not rate_hz > 0 or clock.samples < 1:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Rate {rate_hz:g}, samples per channel {clock.samples}")
    terminal = device.inventory.terminal(source) if source and source != "OnboardClock" else ""
    if task.type == "CI" and not terminal:
        raise DaqStatusError(Code.EXT_SAMP_CLK_SRC_NOT_SPECIFIED)
    owner = device.inventory.owner_of(task.channels[0].physical.name)
    rate_hz = owner.coerced_rate(rate_hz, task.channels[0].physical.kind, len(task.channels))
    task.clock = replace(clock, rate_hz=rate_hz, source=terminal)


MAX_ON_DEMAND = 100_000  # readings on demand in one call: a minute and a half of virtual time


def read_samples(device: DeviceState, task: SimulatedTask, n: int, timeout_s: float) -> NDArray[np.float64]:
    """Return n samples per channel (all available for a negative n), shape (m, channels), in the task's units, letting
    time pass until they have come; fewer where ``timeout_s`` ends first. An idle task is started.

    Raises DaqStatusError when samples were overwritten or will never come.
    """
    if task.clock is None and task.state != "running":  # started for this read alone
        start_task(device, task)
        try:
            return read_samples(device, task, n, timeout_s)
        finally:
            stop_task(device, task)
    if task.state != "running":
        start_task(device, task)
    if task.clock is None or task.buffer is None:
        return _read_on_demand(device, task, n)
    if n < 0:
        await_something(device, task)
        n = task.read_all_samples
    missing = n - task.buffer.available
    if missing > task.samples_remaining:  # cut to what there will be
        n = task.buffer.available + int(task.samples_remaining)
        missing = n - task.buffer.available
        if n <= 0:
            raise DaqStatusError(Code.SAMPLES_WILL_NEVER_BE_AVAILABLE, f"Task: {task.name}", samples_read=0)
    if missing > 0:
        wait_for_samples(device, task, missing, timeout_s)
    if task.progress.error:  # e.g. the watchdog expired while the read waited
        raise DaqStatusError(task.progress.error, f"Task: {task.name}", samples_read=0)
    values = task.buffer.take(min(n, task.buffer.available))
    device.handed_out = max(device.handed_out, task.buffer.read)
    return values


def has_been_read(task: SimulatedTask) -> bool:
    """Whether a finite acquisition has ended and all its samples have been read: a read gives no more."""
    return task.buffer is not None and task.samples_remaining <= 0 and not task.buffer.available


def _read_on_demand(device: DeviceState, task: SimulatedTask, n: int) -> NDArray[np.float64]:
    """``n`` readings (at least one) without a clock, shape (n, channels); time moves on where no task makes it pass."""
    if n > MAX_ON_DEMAND:
        raise NotAnswered(f"{n} readings on demand at once")
    settle_on_demand(device)
    return np.concatenate([latch_now(device, task) for _ in range(max(n, 1))])


def write_volts(device: DeviceState, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool) -> None:
    """Write ``values`` (n, channels), V, to an analog output task: into its buffer, or the last row at once where it
    has no sample clock; refuse values outside a channel's limits. ``auto_start`` lets an idle task start."""
    for column, channel in enumerate(task.channels):
        low, high = channel.settings["min_val"], channel.settings["max_val"]
        inside = (values[:, column] >= low) & (values[:, column] <= high)  # NaN is not inside
        if not np.all(inside):
            detail = f"Channel: {channel.name}, limits {low:g} to {high:g} V"
            raise DaqStatusError(Code.INVALID_AO_DATA_WRITE, detail)
    write_levels(device, task, values, auto_start)


def write_levels(device: DeviceState, task: SimulatedTask, values: NDArray[np.float64], auto_start: bool) -> None:
    """Write ``values`` (n, channels), V, or (n, lines), levels, to an output task: into its buffer, or the last row at
    once where it has no sample clock. ``auto_start`` lets an idle task start. Refuse outputs that a watchdog holds."""
    refuse_expired(device, task)
    if task.clock is None:
        _write_on_demand(device, task, values[-1], auto_start)
    elif task.state != "running":
        before, room = task.output.samples, int(task.setting("Buffer", "", daqmx.BUF_OUTPUT_BUF_SIZE, 0))
        if before is not None and not task.output.generated and before.shape[0] + values.shape[0] <= room:
            values = np.concatenate((before, values))  # each write begins where the one before left off
        task.output.samples, task.output.generated = values.copy(), 0
        if auto_start:
            start_task(device, task)
    elif task.progress.error:
        raise DaqStatusError(task.progress.error, f"Task: {task.name}")
    else:
        task.output.samples = values.copy()


def _write_on_demand(device: DeviceState, task: SimulatedTask, row: NDArray[np.float64], auto_start: bool) -> None:
    """Put out ``row`` (channels or lines,), V or levels, at once; refuse an idle task without ``auto_start``, and
    reserve its hardware for the write only, unless the task is committed."""
    if task.state != "running":
        if not auto_start:
            raise DaqStatusError(Code.CANNOT_WRITE_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING, f"Task: {task.name}")
        commit(device, task)
        if not task.committed:
            release(device, task)
    set_outputs(device, task, row)
