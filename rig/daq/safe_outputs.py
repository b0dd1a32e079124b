"""The two outputs that decide whether the bench can move: motor at 0 V, drive enabled or not; written on demand.

A stopped DAC holds its last value, so 0 V must be written; a static line keeps its state. The tasks are reused and
reserve nothing between writes. Where a reused task fails (a restarted server does not know it) a new one is tried
before the failure is reported. Errors are those of ``nidaqmx``, translated by the caller.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import nidaqmx
import nidaqmx.constants as ni
from nidaqmx.stream_writers import AnalogSingleChannelWriter, DigitalSingleChannelWriter

from rig.configuration.rig_file import RigConfig
from rig.daq.task_set import NewTask, TaskSet

ZERO, DRIVE = "motor_zero", "drive_enable"
WRITE_TIMEOUT_S = 5.0


class SafeOutputs:
    """Writes the motor's zero and the drive-enable line of one rig."""

    def __init__(self, new_task: NewTask, end_left: Callable[[str], None]) -> None:
        self._tasks = TaskSet(new_task, end_left)

    def put_motor_at_zero(self, config: RigConfig) -> None:
        """Put the motor output at 0 V."""

        def add(task: nidaqmx.Task) -> None:
            channel, limit = config.motor.channel, config.motor.voltage_limit_v
            task.ao_channels.add_ao_voltage_chan(channel, "motor", -limit, limit, ni.VoltageUnits.VOLTS, "")

        def write(task: nidaqmx.Task) -> None:
            writer = AnalogSingleChannelWriter(task.out_stream, auto_start=True)
            writer.verify_array_shape = False  # saves a call
            writer.write_one_sample(0.0, timeout=WRITE_TIMEOUT_S)

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
            writer.write_one_sample_one_line(enabled, timeout=WRITE_TIMEOUT_S)

        self._write(DRIVE, add, write)

    def clear(self) -> None:
        """Clear the tasks; the outputs keep their state."""
        for name in self._tasks:
            self._tasks.clear(name)

    def _write(self, name: str, add: Callable[[nidaqmx.Task], None], write: Callable[[nidaqmx.Task], None]) -> None:
        if name in self._tasks:
            with contextlib.suppress(nidaqmx.errors.Error):
                self._written(name, write)
                return
            self._forget(name)
        try:
            add(self._tasks.make(name))
            self._written(name, write)
        except BaseException:
            self._forget(name)
            raise

    def _written(self, name: str, write: Callable[[nidaqmx.Task], None]) -> None:
        write(self._tasks[name])
        self._tasks[name].stop()  # it was started by the write: with that it gives its hardware back

    def _forget(self, name: str) -> None:
        """Clear a task that has failed; a failure to clear it tells nothing new."""
        with contextlib.suppress(nidaqmx.errors.Error):
            self._tasks.clear(name)
