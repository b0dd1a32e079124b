"""Watchdog timers of the virtual device: what the outputs do when the program that commands them stops calling.

Timers are checked with every call and every passage of time. What a watchdog reaches, and what comes after its
expiration, is a property of the product. X Series cards: digital lines only; they refuse to be written until the timer
is cleared, all else goes on. cDAQ-9185 and 9189: analog outputs and lines; every task ends and every operation is
refused (-201478) until the chassis is reset, and clearing the timer or its task does not help.
"""

from __future__ import annotations

import re

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState, WatchdogTimer
from rig.simulated.device.task import SimulatedTask
from rig.simulated.product import Inventory
from rig.simulated.status import Code, DaqStatusError, refuse_any

RESET_TIMER, CLEAR_EXPIRATION = 0, 1
SHORTEST_S = 1e-3  # of an expiration that may be asked for: choice
WITHOUT_HARDWARE = re.compile(
    r"(Create|Cfg)\w+|Get(Device|System|Watchdog|Task|Timing|Chan)\w*|GetErrorString|StopTask|ClearTask|ResetDevice"
)
"""Calls that a locked device still answers: they do not reach the hardware, or reset it."""


def refuse_bad_timer(owner: Inventory, name: str, timeout_s: float) -> None:
    """Refuse the watchdog timer task ``name`` on a device without a timer, or with a timeout, s, below 1 ms or above
    the longest of its product."""
    refuse_any(
        (not owner.product.watchdog_reach, Code.WATCHDOG_TIMER_NOT_SUPPORTED, f"Task: {name}"),
        (
            not SHORTEST_S <= timeout_s <= owner.product.watchdog_longest_s,
            Code.WATCHDOG_TIMEOUT_OUT_OF_RANGE_AND_NOT_SPECIAL_VAL,
            f"Timeout: {timeout_s:g} s",
        ),
    )


def watchdog_timer(device: DeviceState, name: str) -> WatchdogTimer:
    if name not in device.watchdogs:
        raise DaqStatusError(Code.ACTION_NOT_SUPPORTED_TASK_NOT_WATCHDOG, f"Task: {name!r}")
    return device.watchdogs[name]


def set_expiration_volts(
    device: DeviceState, timer: WatchdogTimer, channel: str, volts: float, output_type: int
) -> None:
    """Set the volts to which an analog output goes when the watchdog expires; refuse an output that the product's
    watchdog does not reach or of another device, volts out of range, and an output type other than voltage."""
    product = device.inventory.owner_of(timer.device).product
    if "voltage_out" not in product.watchdog_reach:
        raise DaqStatusError(Code.WATCHDOG_TIMER_NOT_SUPPORTED, f"Physical Channel: {channel} is analog")
    physical = device.inventory.channel(channel, "voltage_out")
    _same_device(device, timer, channel)
    if output_type != daqmx.VOLTAGE or abs(volts) > product.ao_range_v:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Expiration state of {channel}: {volts:g}")
    timer.volts[physical.name] = volts


def set_expiration_level(device: DeviceState, timer: WatchdogTimer, line: str, level: int) -> None:
    if level not in (daqmx.LOW, daqmx.HIGH, daqmx.TRISTATE, daqmx.NO_CHANGE):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Expiration state of {line}: {level}")
    _same_device(device, timer, line)
    timer.levels[device.inventory.channel(line, "line").name] = level


def _same_device(device: DeviceState, timer: WatchdogTimer, name: str) -> None:
    if device.inventory.owner_of(name) is not device.inventory.owner_of(timer.device):
        raise DaqStatusError(Code.WATCHDOG_TIMER_NOT_SUPPORTED, f"Physical Channel: {name} is on another device")


def start_watchdog(device: DeviceState, task: SimulatedTask) -> None:
    """Start the timer of a task; on a chassis no other task may have reserved anything then."""
    timer = device.watchdogs[task.name]
    owner = device.inventory.owner_of(timer.device)
    others = [
        other.name
        for other in device.tasks.values()
        if other.state != "unreserved"
        and all(device.inventory.owner_of(c.physical.name) is owner for c in other.channels)
    ]
    if others and "voltage_out" in owner.product.watchdog_reach:
        raise DaqStatusError(
            Code.CANT_RESERVE_WATCHDOG_TASK_WHILE_OTHER_TASKS_RESERVED, f"Task: {task.name}, reserved: {others[0]}"
        )
    timer.running, timer.reset_at_s = True, device.bench.clock.elapsed_s
    task.state = "running"


def control_watchdog(device: DeviceState, timer: WatchdogTimer, action: int) -> None:
    """Reset the timer (``action`` 0), or clear its expiration and stop it (1); refuse another action, and to reset a
    timer that has expired."""
    if action == CLEAR_EXPIRATION:
        timer.expired, timer.running = False, False
    elif action != RESET_TIMER:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Watchdog action {action}")
    elif timer.expired:
        raise DaqStatusError(Code.CANT_RESET_EXPIRED_WATCHDOG, f"Task: {timer.name}")
    else:
        timer.reset_at_s = device.bench.clock.elapsed_s


def check_watchdogs(device: DeviceState) -> None:
    """Let timers that have run out on the bench's clock expire: outputs go to their expiration states. A chassis ends
    every running task and is locked until it is reset; on other products the tasks of those outputs end."""
    for timer in device.watchdogs.values():
        if not timer.running or timer.expired or device.bench.clock.elapsed_s - timer.reset_at_s <= timer.timeout_s:
            continue
        timer.expired = True
        device.output_v.update(timer.volts)
        states = {line: level for line, level in timer.levels.items() if level != daqmx.NO_CHANGE}
        device.lines |= {line: level == daqmx.HIGH for line, level in states.items()}  # tri-stated, it is pulled down
        if device.inventory.owner_of(timer.device).product.expiry_locks:
            device.locked = True
            for task in device.tasks.values():
                if task.state == "running" and task.name not in device.watchdogs:
                    task.progress.live, task.progress.error = False, Code.CHASSIS_WATCHDOG_TIMER_EXPIRED
            continue
        for task in device.tasks.values():
            if task.type in ("AO", "DO") and any(timer.controls(channel.physical.name) for channel in task.channels):
                task.progress.live = False


def refuse_locked(device: DeviceState, call: str) -> None:
    if device.locked and not WITHOUT_HARDWARE.fullmatch(call):
        raise DaqStatusError(Code.CHASSIS_WATCHDOG_TIMER_EXPIRED, f"Device: {device.inventory.name}")


def refuse_expired(device: DeviceState, task: SimulatedTask) -> None:
    for channel in task.channels:
        if any(timer.controls(channel.physical.name) for timer in device.watchdogs.values()):
            raise DaqStatusError(
                Code.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED, f"Physical Channel: {channel.physical.name}"
            )
