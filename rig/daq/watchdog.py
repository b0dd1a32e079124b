"""The device's watchdog timer: it puts the outputs in their safe state when this program stalls or is killed.

It starts before any other task reserves a resource (a chassis demands that), and is reset only when the previous data
have been read and checked. Which outputs it reaches depends on the product: on X Series cards only the drive-enable
line, so a rig on such a card needs that line. After an expiration a cDAQ-9185 or 9189 does nothing until it is reset,
so the caller resets the device, whatever it is, and makes every task afresh.
"""

from __future__ import annotations

import atexit
import contextlib
import warnings

import grpc
import nidaqmx
from nidaqmx.constants import Level, WatchdogAOExpirState
from nidaqmx.system import Device
from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState, WatchdogTask

from rig.configuration.rig_file import RigConfig
from rig.daq.tasks import NEW, session_options

NAME = "watchdog"
ANALOG_REACH = ("cDAQ-9185", "cDAQ-9189")
"""Products whose watchdog reaches analog outputs (NI: watchdog timers in NI-DAQmx)."""

_LEFT_OPEN: list[WatchdogTask] = []
"""Timers left to expire, or that could not be closed; kept, as the client warns of one collected while it is open."""


class Watchdog:
    """A watchdog timer that can be started repeatedly; errors are those of ``nidaqmx``, translated by the caller."""

    def __init__(self, channel: grpc.Channel | None, config: RigConfig) -> None:
        timeout_s = config.watchdog.timeout_s if config.watchdog else 0.5
        options = session_options(channel, NAME, NEW)
        self._task: WatchdogTask | None = WatchdogTask(
            config.device.name, NAME, timeout=timeout_s, grpc_options=options
        )
        try:
            if config.device.product in ANALOG_REACH and config.device_of(config.motor.channel) is None:
                self._task.cfg_watchdog_ao_expir_states(
                    [AOExpirationState(config.motor.channel, 0.0, WatchdogAOExpirState.VOLTAGE)]
                )
            if config.drive_enable is not None and config.device_of(config.drive_enable.line) is None:
                self._task.cfg_watchdog_do_expir_states([DOExpirationState(config.drive_enable.line, Level.LOW)])
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Start the timer."""
        self._open.start()

    def stop(self) -> None:
        """Stop the timer and unreserve it; it stays configured."""
        self._open.stop()

    def reset(self) -> None:
        """Reset the timer; an expired one refuses."""
        self._open.reset_timer()

    @property
    def expired(self) -> bool:
        """Whether the time has run out; known only while the timer runs."""
        return bool(self._open.expired)

    def close(self) -> None:
        """Stop the timer and clear it."""
        task, self._task = self._open, None
        with contextlib.suppress(nidaqmx.errors.Error):
            task.stop()  # closing is what counts
        try:
            task.close()
        except nidaqmx.errors.Error:
            _keep_open(task)
            raise

    def leave_running(self) -> None:
        """Forget the timer without stopping it: it expires, and makes the outputs safe that could not be written."""
        _keep_open(self._open)
        self._task = None

    @property
    def _open(self) -> WatchdogTask:
        assert self._task is not None, "the watchdog has been closed"
        return self._task


def _keep_open(task: WatchdogTask) -> None:
    if not _LEFT_OPEN:  # at the end of the program, too, this is on purpose
        atexit.register(warnings.simplefilter, "ignore", nidaqmx.errors.DaqResourceWarning)
    _LEFT_OPEN.append(task)


def reset_device(channel: grpc.Channel | None, name: str) -> None:
    """Reset the device: all tasks on it end, outputs go to their power-up state, an expired watchdog is disarmed."""
    Device(name, grpc_options=session_options(channel)).reset_device()
