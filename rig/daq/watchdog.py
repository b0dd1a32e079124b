"""The device's watchdog timer: it puts the outputs in their safe state when this program stalls or is killed.

It starts before any other task reserves a resource (a chassis demands that), and is reset only when the previous data
have been read and checked. Which outputs it reaches depends on the product: on X Series cards only the drive-enable
line, so a rig on such a card needs that line.
"""

from __future__ import annotations

import contextlib

import nidaqmx
from nidaqmx import GrpcSessionOptions
from nidaqmx.constants import Level, WatchdogAOExpirState
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState, WatchdogTask

from rig.configuration.rig_file import RigConfig

NAME = "watchdog"
ANALOG_REACH = ("cDAQ-9185", "cDAQ-9189")
"""Products whose watchdog reaches analog outputs (NI: watchdog timers in NI-DAQmx)."""


class Watchdog:
    """A watchdog timer that can be started repeatedly; errors are those of ``nidaqmx``, translated by the caller."""

    def __init__(self, channel: object | None, config: RigConfig) -> None:
        timeout_s = config.watchdog.timeout_s if config.watchdog else 0.5
        options = None
        if channel is not None:
            behavior = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
            options = GrpcSessionOptions(channel, NAME, initialization_behavior=behavior)  # type: ignore[arg-type]
        self._task = WatchdogTask(config.device.name, NAME, timeout=timeout_s, grpc_options=options)
        self._task._close_on_exit = False  # a timer left to expire on purpose deserves no warning of the client
        try:
            if config.device.product in ANALOG_REACH:
                self._task.cfg_watchdog_ao_expir_states(
                    [AOExpirationState(config.motor.channel, 0.0, WatchdogAOExpirState.VOLTAGE)]
                )
            if config.drive_enable is not None:
                self._task.cfg_watchdog_do_expir_states([DOExpirationState(config.drive_enable.line, Level.LOW)])
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Start the timer."""
        self._task.start()

    def stop(self) -> None:
        """Stop the timer and unreserve it; it stays configured."""
        self._task.stop()

    def reset(self) -> None:
        """Reset the timer; an expired one refuses."""
        self._task.reset_timer()

    @property
    def expired(self) -> bool:
        """Whether the time has run out."""
        return bool(self._task.expired)

    def release_outputs(self) -> None:
        """Make the outputs writable again if the timer has expired."""
        if self.expired:
            self._task.clear_expiration()

    def close(self) -> None:
        """Stop the timer and clear it."""
        with contextlib.suppress(nidaqmx.errors.Error):
            self._task.stop()  # closing is what counts
        self._task.close()
