"""The backend contract (:mod:`rig.backend`) on NI-DAQmx: one set of tasks for all trials, slaves before the master.

Between trials the tasks reserve nothing; after a fault all are cleared and made again. Every way out ends at 0 V.
Software is the second safety layer only: the drive's own torque limit, hard stops and emergency stop are the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version

import grpc
import nidaqmx
import numpy as np
from nidaqmx import GrpcSessionOptions
from nidaqmx.constants import TaskMode
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.system import Device
from numpy.typing import NDArray

from rig.backend import Backend, Block, Capabilities, Timing
from rig.configuration.rig_file import RigConfig
from rig.daq import analog_inputs, read_samples, tasks
from rig.daq.bench_checks import BenchChecks
from rig.daq.faults import translated
from rig.daq.safe_outputs import SafeOutputs
from rig.daq.task_set import TaskSet
from rig.daq.watchdog import Watchdog
from rig.errors import HardwareFault, RigInputError

CLIENT_VERSION = version("nidaqmx")


class NidaqmxBackend(BenchChecks, Backend):
    """Acquisition on NI-DAQmx; what only a self-test needs is in :mod:`rig.daq.bench_checks`.

    Parameters
    ----------
    channel : grpc.Channel or None
        What answers: None is the NI-DAQmx driver of this computer, a channel is a gRPC Device Server or the
        virtual bench.
    name : str
        Shown in reports.
    """

    def __init__(self, channel: grpc.Channel | None, *, name: str) -> None:
        self._channel = channel
        self._name = name
        self._simulated, self._product = False, "unknown"
        self._config: RigConfig | None = None
        self._tasks = TaskSet(self._new_task)
        self._outputs = SafeOutputs(self._new_task)
        self._watchdog: Watchdog | None = None
        self._timing: Timing | None = None
        """Timing of the tasks as made; None unless all of them exist."""
        self._live = False
        """Configured, and not stopped since."""
        self._safe = True
        """Both outputs accepted their safe state when it was last written."""
        self._next_sample = 0

    @property
    def capabilities(self) -> Capabilities:
        """What this is."""
        description = {"client": f"nidaqmx {CLIENT_VERSION}", "product": self._product}
        return Capabilities(self._name, self._simulated, description, watchdog=True, hardware=True)

    def identify(self, config: RigConfig) -> None:
        """Read the product type of the device; a simulated one is marked so in every session.

        Raises
        ------
        RigInputError
            When it is another product than the rig file says.
        HardwareFault
            When the driver, server or device does not answer.
        """
        name = config.device.name
        options = None if self._channel is None else GrpcSessionOptions(self._channel, "")
        with translated("connect", f"device {name}"):
            device = Device(name, grpc_options=options)
            self._product, self._simulated = str(device.product_type), bool(device.is_simulated)
        if self._product != config.device.product:
            raise RigInputError(
                f"device.product = {config.device.product!r}: device {name} is a {self._product}; correct the rig file"
            )

    def _new_task(self, name: str) -> nidaqmx.Task:
        if self._channel is None:
            return nidaqmx.Task(name)
        behavior = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
        return nidaqmx.Task(
            name, grpc_options=GrpcSessionOptions(self._channel, name, initialization_behavior=behavior)
        )

    def configure(self, config: RigConfig, command_v: NDArray[np.float64]) -> Timing:
        """Put the outputs in their safe state, reserve every channel, load the motor command."""
        tasks.check_command(config, command_v)
        if self._live or not self._safe:
            self.safe_stop()
        if config != self._config or self._timing is None:
            self._clear()
        self._config = config
        with self._safe_on_failure():
            failures: list[BaseException] = []
            self._outputs_safe("configure", failures)
            if failures:
                raise failures[0]
            self._live = True
            if config.watchdog is not None:
                with translated("configure", "watchdog"):
                    self._watchdog = self._watchdog or Watchdog(self._channel, config)
                    self._watchdog.start()
            timing = self._timing = self._timing or self._make_tasks(config)
            with translated("configure", config.motor.channel):
                tasks.load_command(self._tasks[tasks.MOTOR], config, command_v)
            for name in self._tasks:
                with translated("configure", name):
                    self._reset_watchdog()
                    self._tasks[name].control(TaskMode.TASK_COMMIT)
        return timing

    def _make_tasks(self, config: RigConfig) -> Timing:
        """Make every task of the rig file; nothing is reserved yet."""
        frame_rate_hz = first_pulse_s = None
        with translated("configure", config.force.channel):
            rate = float(analog_inputs.inputs_task(self._tasks.make, config).timing.samp_clk_rate)
        if abs(rate - config.device.sample_rate_hz) > 1e-6 * rate:
            raise RigInputError(
                f"device.sample_rate_hz = {config.device.sample_rate_hz:g} Hz: "
                f"{config.force.module} gives {rate:.6g} Hz; "
                "write a rate the module has"
            )
        for encoder in config.encoders:
            with translated("configure", encoder.counter):
                tasks.encoder_task(self._tasks.make, config, encoder)
        with translated("configure", config.motor.channel):
            tasks.motor_task(self._tasks.make, config)
        if config.camera is not None:
            with translated("configure", config.camera.counter):
                if config.camera.mode == "counted":
                    tasks.edge_task(self._tasks.make, config, config.camera.counter, config.camera.terminal)
                else:
                    _, frame_rate_hz, first_pulse_s = tasks.camera_task(self._tasks.make, config, config.camera)
        return Timing(rate, config.force.group_delay(rate), frame_rate_hz, first_pulse_s)

    def arm(self, *, enable_drive: bool = True) -> None:
        """Start all slaves, which wait for the master's clock and trigger; enable the drive last, at 0 V."""
        config = self._ready()
        with self._safe_on_failure():
            for name in self._tasks:
                if name != analog_inputs.MASTER:
                    with translated("arm", name):
                        self._reset_watchdog()
                        self._tasks[name].start()
            if config.drive_enable is not None and enable_drive:
                with translated("arm", config.drive_enable.line):
                    self._outputs.enable_drive(config.drive_enable.line, True)

    def start(self) -> None:
        """Start the master task."""
        self._ready()
        self._next_sample = 0
        with self._safe_on_failure(), translated("start", analog_inputs.MASTER):
            self._reset_watchdog()
            self._tasks[analog_inputs.MASTER].start()

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        """Read the next samples; on a fault the outputs are made safe first. Each call resets the watchdog."""
        self._ready()
        with self._safe_on_failure():
            with translated("read", "watchdog"):
                self._reset_watchdog()
            with translated("read", tasks.MOTOR):
                self._tasks[tasks.MOTOR].is_task_done()  # raises if the generation has failed
            return self._read_inputs(n_samples, timeout_s)

    def _read_inputs(self, n_samples: int, timeout_s: float) -> Block:
        block = read_samples.next_block(self._tasks, self._ready(), self._next_sample, n_samples, timeout_s)
        self._next_sample += n_samples
        return block

    def read_positions(self) -> dict[str, tuple[int, int]]:
        """Samples per channel that each input task has handed out and acquired since its start, by the driver."""
        return read_samples.positions(self._tasks, self._ready())

    def safe_stop(self) -> None:
        """Stop all, motor at 0 V, drive disabled; each step is tried, then the first failure raised.

        The tasks stay for the next trial, unreserved, unless a step has failed. Where an output could not be written
        the watchdog is left to expire: the device then makes it safe.
        """
        failures: list[BaseException] = []
        self._live = False
        self._unreserve(tasks.MOTOR, failures)
        if self._watchdog is not None:
            _attempt(self._watchdog.release_outputs, [])  # if the outputs stay locked, the next step reports it
        self._outputs_safe("stop", failures)
        for name in self._tasks:
            self._unreserve(name, failures)
        if self._watchdog is not None and self._safe and not _attempt(self._watchdog.stop, []):
            self._close_watchdog()  # last: until here it watches over the steps above
        if failures:
            self._clear()
            raise failures[0]

    def close(self) -> None:
        """Stop safely and close the connection."""
        try:
            self.safe_stop()
        finally:
            self._clear()
            self._config = None
            if self._channel is not None:
                self._channel.close()

    @contextmanager
    def _safe_on_failure(self) -> Iterator[None]:
        """Make the bench safe when the block fails; its own fault is reported, and no task is used again."""
        try:
            yield
        except BaseException:
            _attempt(self.safe_stop, [])
            self._clear()
            raise

    def _clear(self) -> None:
        """Clear all tasks; the next trial makes them again."""
        self._timing = None
        for name in self._tasks:
            _attempt(partial(self._tasks.clear, name), [])
        _attempt(self._outputs.clear, [])
        self._close_watchdog()

    def _close_watchdog(self) -> None:
        """Close the timer, unless it still has to make the outputs safe."""
        if self._watchdog is not None and self._safe:
            _attempt(self._watchdog.close, [])
            self._watchdog = None

    def _outputs_safe(self, phase: str, failures: list[BaseException]) -> None:
        config = self._config
        if config is None:
            return

        def zero() -> None:
            with translated(phase, f"{config.motor.channel} not put at 0 V, use the emergency stop"):
                self._outputs.put_motor_at_zero(config)

        def disable() -> None:
            if config.drive_enable is not None:
                line = config.drive_enable.line
                with translated(phase, f"{line} not disabled, use the emergency stop"):
                    self._outputs.enable_drive(line, False)

        written = [_attempt(step, failures) for step in (zero, disable)]
        self._safe = all(written)

    def _unreserve(self, name: str, failures: list[BaseException]) -> None:
        def unreserve() -> None:
            with translated("stop", name):
                self._tasks.unreserve(name)

        _attempt(unreserve, failures)
        if name not in self._tasks:
            self._timing = None

    def _reset_watchdog(self) -> None:
        if self._watchdog is not None:
            self._watchdog.reset()

    def _ready(self) -> RigConfig:
        if self._config is None or not self._live:
            raise HardwareFault("the backend is not configured, or has been stopped; call configure first", phase="arm")
        return self._config


def _attempt(step: Callable[[], None], failures: list[BaseException]) -> bool:
    """Try one step towards the safe state; a second Ctrl-C must not prevent the next."""
    try:
        step()
    except BaseException as error:
        failures.append(error)
        return False
    return True
