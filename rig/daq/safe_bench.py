"""What the NI-DAQmx backend holds on the device, and how it makes that safe: outputs, tasks, watchdog, reset.

Two outputs decide whether the bench can move: motor at 0 V, drive enabled or not; they are written on demand. A stopped
DAC holds its last value, so 0 V must be written; a static line keeps its state. The tasks are reused and reserve
nothing between writes. Where a reused task fails (a restarted server does not know it) a new one is tried before the
failure is reported.

The device's watchdog timer puts the outputs in their safe state when this program stalls or is killed. It starts before
any other task reserves a resource (a chassis demands that), and is reset only when the previous data have been read and
checked. Which outputs it reaches depends on the product: on X Series cards only the drive-enable line, so a rig on such
a card needs that line. After an expiration a cDAQ-9185 or 9189 does nothing until it is reset, so the device is reset,
whatever it is. Errors of the single steps are those of ``nidaqmx``, translated by the caller.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, partialmethod
from typing import Any

import grpc
import nidaqmx
import nidaqmx.constants as ni
from nidaqmx.constants import Level, WatchdogAOExpirState
from nidaqmx.stream_writers import AnalogSingleChannelWriter, DigitalSingleChannelWriter
from nidaqmx.system import Device
from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState, WatchdogTask

from rig.backend import CALL_TIMEOUT_S, Timing
from rig.configuration.rig_file import RigConfig
from rig.daq import tasks
from rig.daq.faults import translate_faults
from rig.daq.tasks import ATTACHED, NEW, NewTask, TaskSet, session_options
from rig.errors import WatchdogTripped, is_defect

WATCHDOG = "watchdog"
ANALOG_REACH = ("cDAQ-9185", "cDAQ-9189")
"""Products whose watchdog reaches analog outputs (NI: watchdog timers in NI-DAQmx)."""

_LEFT_OPEN: list[WatchdogTask] = []
"""Timers left to expire, or that could not be closed; kept, as the client warns of one collected while it is open."""


def make_watchdog(channel: grpc.Channel | None, config: RigConfig) -> WatchdogTask:
    """Make a rig's watchdog timer, not started; on expiry the motor goes to 0 V and the drive-enable line low, as far
    as the timer reaches. ``channel`` None is this computer's driver; errors are those of ``nidaqmx``."""
    timeout_s = config.watchdog.timeout_s if config.watchdog else 0.5
    options = session_options(channel, WATCHDOG, NEW)
    timer = WatchdogTask(config.device.name, WATCHDOG, timeout=timeout_s, grpc_options=options)
    try:
        if config.device.product in ANALOG_REACH and config.device_of(config.motor.channel) is None:
            at_zero = AOExpirationState(config.motor.channel, 0.0, WatchdogAOExpirState.VOLTAGE)
            timer.cfg_watchdog_ao_expir_states([at_zero])
        if config.drive_enable is not None and config.device_of(config.drive_enable.line) is None:
            timer.cfg_watchdog_do_expir_states([DOExpirationState(config.drive_enable.line, Level.LOW)])
    except BaseException:
        close_watchdog(timer)
        raise
    return timer


def close_watchdog(timer: WatchdogTask) -> None:
    """Stop and close the timer; where closing fails it is left running, and the error is raised."""
    with contextlib.suppress(nidaqmx.errors.Error):
        timer.stop()  # closing is what counts
    try:
        timer.close()
    except nidaqmx.errors.Error:
        leave_running(timer)
        raise


def leave_running(timer: WatchdogTask) -> None:
    """Forget a timer without stopping it: it expires, and makes the outputs safe that could not be written."""
    if not _LEFT_OPEN:  # at the end of the program, too, this is on purpose
        atexit.register(warnings.simplefilter, "ignore", nidaqmx.errors.DaqResourceWarning)
    _LEFT_OPEN.append(timer)


def reset_device(channel: grpc.Channel | None, name: str) -> None:
    """Reset the device: all tasks on it end, outputs go to their power-up state, an expired watchdog is disarmed."""
    Device(name, grpc_options=session_options(channel)).reset_device()


ZERO, DRIVE = "motor_zero", "drive_enable"


class SafeOutputs:
    """Writes the motor's zero and the drive-enable line of one rig."""

    def __init__(self, new_task: NewTask, end_left: Callable[[str], None]) -> None:
        self._tasks = TaskSet(new_task, end_left)

    def put_motor_at_zero(self, config: RigConfig) -> None:
        """Write 0 V to the motor's output, in a task of its own."""

        def add(task: nidaqmx.Task) -> None:
            channel, limit = config.motor.channel, config.motor.voltage_limit_v
            task.ao_channels.add_ao_voltage_chan(channel, "motor", -limit, limit, ni.VoltageUnits.VOLTS, "")

        def write(task: nidaqmx.Task) -> None:
            writer = AnalogSingleChannelWriter(task.out_stream, auto_start=True)
            writer.verify_array_shape = False  # saves a call
            writer.write_one_sample(0.0, timeout=CALL_TIMEOUT_S)

        self._write(ZERO, add, write)

    def enable_drive(self, line: str, enabled: bool) -> None:
        """Set the drive-enable line; high is enabled."""

        def add(task: nidaqmx.Task) -> None:
            task.do_channels.add_do_chan(
                line, name_to_assign_to_lines="drive_enable", line_grouping=ni.LineGrouping.CHAN_PER_LINE
            )

        def write(task: nidaqmx.Task) -> None:
            writer = DigitalSingleChannelWriter(task.out_stream, auto_start=True)
            writer.verify_array_shape = False
            writer.write_one_sample_one_line(enabled, timeout=CALL_TIMEOUT_S)

        self._write(DRIVE, add, write)

    def clear(self) -> None:
        for name in self._tasks:
            self._tasks.clear(name)

    def _write(self, name: str, add: Callable[[nidaqmx.Task], None], write: Callable[[nidaqmx.Task], None]) -> None:
        """Write an output with the task of this name: ``add`` gives a new one its channel, ``write`` puts the value
        out. Where there is none, or the kept one fails, a new one is made; where that fails too the error is raised."""
        if name in self._tasks:
            with contextlib.suppress(nidaqmx.errors.Error):
                self._write_output(name, write)
                return
            self._forget(name)
        try:
            add(self._tasks.make(name))
            self._write_output(name, write)
        except BaseException:
            self._forget(name)
            raise

    def _write_output(self, name: str, write: Callable[[nidaqmx.Task], None]) -> None:
        write(self._tasks[name])
        self._tasks[name].stop()  # it was started by the write: with that it gives its hardware back

    def _forget(self, name: str) -> None:
        with contextlib.suppress(nidaqmx.errors.Error):
            self._tasks.clear(name)


LOG = logging.getLogger("rig.daq")


def attempt(step: Callable[[], None], failures: list[BaseException], what: str) -> bool:
    """Try a step and return whether it succeeded; log what it raises, even Ctrl-C, and append it to ``failures``."""
    try:
        step()
    except BaseException as error:
        defect = is_defect(error) and not isinstance(error, nidaqmx.errors.Error)
        LOG.error("%s failed: %s: %s", what, type(error).__name__, error, exc_info=error if defect else None)
        failures.append(error)
        return False
    return True


def worst_failure(failures: list[BaseException]) -> BaseException:
    """Return the failure to raise: a programming error before the first fault of the hardware, so that neither hides.

    A fault caused by an error in this program would otherwise be blamed on the bench.
    """
    return next(filter(is_defect, failures), failures[0])


class RememberedCalls(grpc.Channel):
    """A channel whose callables are made when they are first asked for, and kept.

    NI's client asks for all 451 of them anew with every task: over a socket that takes 15 ms of processor time, several
    times a trial. It never asks to be told of changes of the connection.

    Parameters
    ----------
    make : makes a callable by its kind, e.g. ``unary_unary``, and what the client asks for it with.
    close : closes the connection
    """

    def __init__(self, make: Callable[..., Callable[..., Any]], close: Callable[[], object] = lambda: None) -> None:
        self._make, self._close = make, close
        self._made: dict[tuple[str, str], Callable[..., Any]] = {}

    @classmethod
    def on_channel(cls, channel: grpc.Channel | None) -> RememberedCalls | None:
        """Return another channel with this memory; None for none."""
        if channel is None or isinstance(channel, RememberedCalls):
            return channel
        return cls(lambda kind, *args, **kwargs: getattr(channel, kind)(*args, **kwargs), channel.close)

    def _once(self, kind: str, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        if (kind, method) not in self._made:
            self._made[kind, method] = self._make(kind, method, *args, **kwargs)
        return self._made[kind, method]

    unary_unary = partialmethod(_once, "unary_unary")  # type: ignore[assignment]
    unary_stream = partialmethod(_once, "unary_stream")  # type: ignore[assignment]
    stream_unary = partialmethod(_once, "stream_unary")  # type: ignore[assignment]
    stream_stream = partialmethod(_once, "stream_stream")  # type: ignore[assignment]

    def subscribe(self, callback: Callable[..., Any], try_to_connect: bool | None = False) -> None:
        """Do nothing: nobody asks."""

    unsubscribe = subscribe

    def close(self) -> None:
        self._close()

    def __enter__(self) -> RememberedCalls:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class SafeBench:
    """Connection, tasks, outputs and watchdog of one rig; :meth:`safe_stop` ends what they do.

    Parameters
    ----------
    channel : grpc.Channel or None
        What answers: None is the NI-DAQmx driver of this computer.
    """

    def __init__(self, channel: grpc.Channel | None) -> None:
        self._channel = RememberedCalls.on_channel(channel)
        self._config: RigConfig | None = None
        self._tasks = TaskSet(self._new_task, self._end_left)
        self._outputs = SafeOutputs(self._new_task, self._end_left)
        self._watchdog: WatchdogTask | None = None
        self._timing: Timing | None = None
        """Timing of the tasks as made; None unless all of them exist."""
        self._live = False
        """Configured, and not stopped since."""
        self._safe = True
        """Both outputs accepted their safe state when it was last written."""
        self._was_reset = False
        """The device was reset since the connection was made."""
        self._next_sample = 0
        self._reset_at_sample = 0
        """The next sample to be read, and what it was when the watchdog was last reset."""
        self._last_reset_s = float("-inf")
        """When the watchdog was last reset."""

    def _new_task(self, name: str) -> nidaqmx.Task:
        return nidaqmx.Task(name, grpc_options=tasks.session_options(self._channel, name, NEW))

    def _end_left(self, name: str) -> None:
        """End the server's session of a task of ours whose clearing failed; the client itself cannot try again."""
        if self._channel is not None:
            with contextlib.suppress(nidaqmx.errors.Error):  # there is none: it was cleared after all
                nidaqmx.Task(name, grpc_options=tasks.session_options(self._channel, name, ATTACHED)).close()

    def _now_s(self) -> float:
        return time.monotonic()

    def _reset_device(self, phase: str) -> None:
        """Clear all tasks and the watchdog and reset every device of the rig; the next trial makes everything afresh.
        ``phase``: what the program was doing, for the message of a fault."""
        self._clear(watchdog_too=True)
        if self._config is not None:
            for name in (self._config.device.name, *(further.name for further in self._config.devices)):
                with translate_faults(phase, f"device {name} not reset"):
                    reset_device(self._channel, name)
        self._was_reset = True

    def safe_stop(self) -> None:
        """Stop all tasks, put the motor at 0 V and disable the drive; every step is tried even where one fails, then a
        programming error, or else the first failure, is raised.

        The tasks stay for the next trial, unreserved, unless a step has failed. Where an output could not be written
        the watchdog is left to expire: the device then makes it safe.
        """
        failures: list[BaseException] = []
        self._live = False
        tripped = self._watchdog is not None and self._has_tripped()
        if not tripped:
            self._unreserve(tasks.MOTOR, failures)
        self._make_outputs_safe("stop", failures, tripped=tripped)
        for name in self._tasks:
            self._unreserve(name, failures)
        if self._watchdog is not None and self._safe and not attempt(self._watchdog.stop, [], "stopping the watchdog"):
            self._close_watchdog()  # last: until here it watches over the steps above
        if failures:
            self._clear()
            raise worst_failure(failures)

    def _has_tripped(self) -> bool:
        assert self._watchdog is not None
        try:
            return bool(self._watchdog.expired)
        except (nidaqmx.errors.Error, grpc.RpcError):
            return False  # unknown: if the outputs are locked, writing them tells

    @contextmanager
    def _safe_on_failure(self) -> Iterator[None]:
        """Context: where the block raises, stop the bench, clear all its tasks, and let the block's error go on; what
        fails in stopping is only logged. The next trial makes its tasks afresh."""
        try:
            yield
        except BaseException:
            attempt(self.safe_stop, [], "safe stop")
            self._clear()
            raise

    def _clear(self, *, watchdog_too: bool = False) -> None:
        self._timing = None
        for name in self._tasks:
            attempt(partial(self._tasks.clear, name), [], f"clearing task {name}")
        attempt(self._outputs.clear, [], "clearing the tasks of the outputs")
        self._close_watchdog(always=watchdog_too)

    def _close_watchdog(self, *, always: bool = False) -> None:
        """Close the timer, unless it still has to make the outputs safe."""
        if self._watchdog is not None and (self._safe or always):
            attempt(partial(close_watchdog, self._watchdog), [], "closing the watchdog")
            self._watchdog = None

    def _make_outputs_safe(self, phase: str, failures: list[BaseException], *, tripped: bool = False) -> None:
        """Put the motor at 0 V and disable the drive, after a reset of the devices if the watchdog has ``tripped`` or
        writing shows that it has; append what fails to ``failures``, raising nothing."""
        found: list[BaseException] = []
        if not tripped:
            self._write_safe_state(phase, found)
            tripped = any(isinstance(failure, WatchdogTripped) for failure in found)
        if tripped and attempt(partial(self._reset_device, phase), found := [], "resetting the tripped device"):
            self._write_safe_state(phase, found)
        failures += found

    def _write_safe_state(self, phase: str, failures: list[BaseException]) -> None:
        """Put the motor at 0 V, disable the drive, note whether both succeeded; append what fails to ``failures``."""
        config = self._config
        if config is None:
            return

        def zero() -> None:
            with translate_faults(phase, f"{config.motor.channel} not put at 0 V, use the emergency stop"):
                self._outputs.put_motor_at_zero(config)

        def disable() -> None:
            if config.drive_enable is not None:
                line = config.drive_enable.line
                with translate_faults(phase, f"{line} not disabled, use the emergency stop"):
                    self._outputs.enable_drive(line, False)

        steps = ((zero, "motor to 0 V"), (disable, "drive disabled"))
        written = [attempt(step, failures, what) for step, what in steps]
        self._safe = all(written)

    def _unreserve(self, name: str, failures: list[BaseException]) -> None:
        """Stop and unreserve a task, or clear it where that fails; what fails is appended to ``failures``."""

        def unreserve() -> None:
            with translate_faults("stop", name):
                self._tasks.unreserve(name)

        attempt(unreserve, failures, f"stopping task {name}")
        if name not in self._tasks:
            self._timing = None

    def _reset_watchdog(self, *, at_least_every_s: float = 0.0) -> None:
        """Reset the watchdog, unless that was done less than ``at_least_every_s`` ago."""
        if self._watchdog is not None and self._now_s() - self._last_reset_s >= at_least_every_s:
            self._last_reset_s = self._now_s()  # before the call, which may take long: the device counts from its end
            self._reset_at_sample = self._next_sample
            self._watchdog.reset_timer()
