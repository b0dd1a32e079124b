"""Configuring a task: its channels, looked up on the product, and its sample clock, coerced to a rate it has."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx, status
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import Channel, SampleClock, SimulatedTask, TaskType, Timing
from rig.simulated.product.capabilities import Kind
from rig.simulated.product.inventory import channel_names
from rig.simulated.status import DaqStatusError, NotImplementedByDevice


def add_channels(
    device: DeviceState, task: SimulatedTask, type_: TaskType, kind: Kind, physical: str, name: str, **settings: Any
) -> None:
    """Add comma-separated physical channels to a task; digital ones come from :func:`add_lines`."""
    names = channel_names(physical)
    for index, part in enumerate(names):
        channel = device.inventory.channel(part, kind)
        assigned = name if len(names) == 1 else f"{name}{index}"
        task.add_channel(type_, Channel(assigned if name else channel.name, channel, dict(settings)))


def add_lines(
    device: DeviceState, task: SimulatedTask, type_: TaskType, lines: str, name: str, *, one_channel: bool
) -> None:
    """Add digital lines or whole ports to a task, as one channel or one per line."""
    found = device.inventory.lines(lines)
    groups = [found] if one_channel else [[line] for line in found]
    for index, group in enumerate(groups):
        assigned = name if len(groups) == 1 else f"{name}{index}"
        port = group[0].name.rsplit("/", 1)[0]
        several = port if lines.strip().lower() == port.lower() else group[0].name + "..."
        own = several if len(group) > 1 else group[0].name
        task.add_channel(type_, Channel(assigned if name else own, group[0], {"lines": [line.name for line in group]}))


def configure_clock(
    device: DeviceState, task: SimulatedTask, rate_hz: float, source: str, mode: int, samples: int
) -> None:
    """Set a task's sample clock after coercing its rate and checking its route."""
    if not task.channels:
        raise DaqStatusError(status.NO_CHANNELS, f"Task: {task.name}")
    task.refuse_while_running()
    if not rate_hz > 0 or samples < 1:
        raise DaqStatusError(status.INVALID_VALUE, f"Rate {rate_hz:g}, samples per channel {samples}")
    terminal = device.inventory.terminal(source) if source and source != "OnboardClock" else ""
    if task.type in ("CI", "CO") and not terminal:
        raise DaqStatusError(status.CLOCK_SOURCE_REQUIRED)
    if task.type == "CO" and mode != daqmx.CONTINUOUS:
        raise NotImplementedByDevice("finite pulses on a sample clock")
    owner = device.inventory.of(task.channels[0].physical.name)
    static = any(channel.physical.kind == "static_line" for channel in task.channels)
    if static or (task.type in ("DI", "DO") and not owner.product.clocked_lines):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Task: {task.name}: these lines are static")
    rate_hz = owner.coerced_rate(rate_hz, task.channels[0].physical.kind, len(task.channels))
    task.timing = Timing(SampleClock(rate_hz, terminal, mode, samples))
    if task.type == "CO":
        task.pulses.count = None
