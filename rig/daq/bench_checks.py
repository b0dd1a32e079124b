"""What only a self-test needs of the hardware: the bridge's shunt step, edges on a terminal, an expiring watchdog.

Each method opens and closes tasks of its own while those of the trials are idle, except
:meth:`BenchChecks.let_watchdog_expire`, which needs a running trial.
"""

from __future__ import annotations

import nidaqmx
import numpy as np
from nidaqmx.stream_readers import AnalogSingleChannelReader
from numpy.typing import ArrayLike

from rig.arrays import as_numbers
from rig.backend import Block, Expiry
from rig.configuration.rig_file import RigConfig
from rig.daq import analog_inputs, tasks
from rig.daq.faults import translated
from rig.daq.safe_outputs import SafeOutputs
from rig.daq.watchdog import Watchdog
from rig.errors import HardwareFault

SHUNT_S = 0.4
READ_TIMEOUT_S = 5.0


class BenchChecks:
    """Mixed into the backend, whose tasks it makes."""

    _watchdog: Watchdog | None
    _outputs: SafeOutputs

    def _new_task(self, name: str) -> nidaqmx.Task:
        raise NotImplementedError

    def _read_inputs(self, n_samples: int, timeout_s: float) -> Block:
        raise NotImplementedError

    def _check_task(self, name: str) -> nidaqmx.Task:
        return self._new_task(f"check_{name}")

    def shunt_step(self, config: RigConfig) -> float:
        """Return by how much the bridge's reading changes when the module's shunt resistor is switched in, mV/V."""
        readings = [self._mean_reading(config, shunt=shunt) for shunt in (False, True)]
        return readings[1] - readings[0]

    def _mean_reading(self, config: RigConfig, *, shunt: bool) -> float:
        n = int(SHUNT_S * config.device.sample_rate_hz)
        with translated("read", config.force.channel):
            task = analog_inputs.force_task(self._check_task, config)
            try:
                task.ai_channels[0].ai_bridge_shunt_cal_enable = shunt
                task.start()
                values = np.empty(n)
                AnalogSingleChannelReader(task.in_stream).read_many_sample(values, n, READ_TIMEOUT_S)
            finally:
                task.close()
        settled = values[n // 4 :]  # after the step response of the module's filter
        return float(np.mean(analog_inputs.volts_of_force(config, settled)))

    def count_edges(self, config: RigConfig, counter: str, terminal: str, duration_s: float, pulses: bool) -> int:
        """Return the rising edges on a terminal in ``duration_s``; with ``pulses`` the camera's counter gives them."""
        n = int(round(duration_s * config.device.sample_rate_hz))
        made: list[nidaqmx.Task] = []
        with translated("read", counter):
            try:
                edges = tasks.edge_task(self._check_task, config, counter, terminal)
                made.append(edges)
                if pulses and config.camera is not None:
                    made.append(tasks.camera_task(self._check_task, config, config.camera)[0])
                made.append(analog_inputs.force_task(self._check_task, config))
                for task in made:
                    task.start()
                counted = edges.read(n, timeout=READ_TIMEOUT_S)
            finally:
                for task in reversed(made):
                    task.close()
        return int(counted[-1]) - int(counted[0])

    def loopback_read(self, config: RigConfig, channel: str, command_v: ArrayLike) -> np.ndarray:
        """Return what a voltage input wired to the motor's output reads while the command is put out, V."""
        command_v = as_numbers(command_v, "motor command", 1)
        made: list[nidaqmx.Task] = []
        values = np.empty(command_v.size)
        with translated("read", channel):
            try:
                motor = tasks.motor_task(self._check_task, config)
                made.append(motor)
                tasks.prepare_command(motor, config, command_v.size)
                tasks.load_command(motor, command_v)
                loop = analog_inputs.voltage_task(self._check_task, config, channel)
                made.append(loop)
                motor.start()
                loop.start()
                AnalogSingleChannelReader(loop.in_stream).read_many_sample(values, values.size, READ_TIMEOUT_S)
            finally:
                for task in made:
                    task.close()
                self._outputs.put_motor_at_zero(config)
        return values

    def let_watchdog_expire(self, n_samples: int, blocks: int) -> Expiry:
        """Read without resetting the watchdog, at most ``blocks`` blocks; a chassis gives none after its expiration.

        The bench is then stopped by ``safe_stop``, which resets a device whose watchdog has expired.
        """
        read: list[Block] = []
        tripped: int | None = None
        for index in range(blocks):
            try:
                read.append(self._read_inputs(n_samples, READ_TIMEOUT_S))
            except HardwareFault:
                if not self._expired():
                    raise
                return Expiry(read, index if tripped is None else tripped, locked=True)
            if tripped is None and self._expired():
                tripped = index
        return Expiry(read, tripped)

    def _expired(self) -> bool:
        with translated("read", "watchdog"):
            return self._watchdog is not None and self._watchdog.expired
