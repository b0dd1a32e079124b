"""The backend contract on NI-DAQmx: one set of tasks per trial, slaves before the master, 0 V on every exit.

Place in the data flow: recorder → this class → ``nidaqmx`` client → driver, gRPC Device Server, or the
virtual bench. The contract is in :mod:`rig.backend`. Software is the second safety layer only: the drive's own
torque limit, hard stops and emergency stop are the first.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.metadata import version

import grpc
import nidaqmx
import numpy as np
from nidaqmx import GrpcSessionOptions
from nidaqmx.constants import TaskMode
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.stream_readers import AnalogSingleChannelReader, CounterReader
from nidaqmx.system import Device
from numpy.typing import NDArray

from rig.backend import Block, Capabilities, Timing
from rig.config import RigConfig
from rig.daq import tasks
from rig.daq.bench_checks import BenchChecks
from rig.daq.faults import translated
from rig.daq.watchdog import Watchdog
from rig.errors import HardwareFault, InputError


class NidaqmxBackend(BenchChecks):
    """Acquisition on NI-DAQmx; what only a self-test does is in :mod:`rig.daq.bench_checks`.

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
        self._tasks: dict[str, nidaqmx.Task] = {}
        """Open tasks by name in the order they were made; kept from the moment they exist, so that none is lost."""
        self._watchdog: Watchdog | None = None
        self._next_sample = 0

    @property
    def capabilities(self) -> Capabilities:
        """What this is."""
        description = {"client": f"nidaqmx {version('nidaqmx')}", "product": self._product}
        return Capabilities(self._name, self._simulated, description, watchdog=True, hardware=True)

    def identify(self, config: RigConfig) -> None:
        """Ask the device what it is; a simulated one is marked so in every session.

        Raises
        ------
        InputError
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
            raise InputError(
                f"device.product = {config.device.product!r}: device {name} is a {self._product}; correct the rig file"
            )

    def _kept_task(self, name: str) -> nidaqmx.Task:
        self._tasks[name] = task = self._new_task(name)
        return task

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
        if self._tasks or self._watchdog:
            self.safe_stop()
        self._config = config
        frame_rate_hz = first_pulse_s = None
        try:
            failures: list[BaseException] = []
            self._outputs_safe("configure", failures)
            if failures:
                raise failures[0]
            if config.watchdog is not None:
                with translated("configure", "watchdog"):
                    self._watchdog = Watchdog(self._channel, config)
            with translated("configure", config.force.channel):
                rate = float(tasks.force_task(self._kept_task, config).timing.samp_clk_rate)
            if abs(rate - config.device.sample_rate_hz) > 1e-6 * rate:
                raise InputError(
                    f"device.sample_rate_hz = {config.device.sample_rate_hz:g} Hz: "
                    f"{config.force.module} gives {rate:.6g} Hz; "
                    "write a rate the module has"
                )
            for encoder in config.encoders:
                with translated("configure", encoder.counter):
                    tasks.encoder_task(self._kept_task, config, encoder)
            with translated("configure", config.motor.channel):
                tasks.motor_task(self._kept_task, config, command_v)
            if config.camera is not None:
                with translated("configure", config.camera.counter):
                    if config.camera.mode == "counted":
                        tasks.edge_task(self._kept_task, config, config.camera.counter, config.camera.terminal)
                    else:
                        _, frame_rate_hz, first_pulse_s = tasks.camera_task(self._kept_task, config, config.camera)
            for name, task in self._tasks.items():
                with translated("configure", name):
                    self._kick()
                    task.control(TaskMode.TASK_COMMIT)
        except BaseException:
            self._stop_quietly()
            raise
        return Timing(rate, config.force.group_delay(rate), frame_rate_hz, first_pulse_s)

    def arm(self, *, enable_drive: bool = True) -> None:
        """Start all slaves, which wait for the master's clock and trigger; enable the drive last, at 0 V."""
        config = self._ready()
        try:
            for name, task in self._tasks.items():
                if name != tasks.MASTER:
                    with translated("arm", name):
                        self._kick()
                        task.start()
            if config.drive_enable is not None and enable_drive:
                with translated("arm", config.drive_enable.line):
                    tasks.write_drive_enable(self._new_task, config.drive_enable.line, True)
        except BaseException:
            self._stop_quietly()
            raise

    def start(self) -> None:
        """Start the master task."""
        self._ready()
        self._next_sample = 0
        try:
            with translated("start", tasks.MASTER):
                self._kick()
                self._tasks[tasks.MASTER].start()
        except BaseException:
            self._stop_quietly()
            raise

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        """Read the next samples; on a fault the outputs are made safe first. Asking keeps the watchdog quiet."""
        self._ready()
        try:
            with translated("read", "watchdog"):
                self._kick()
            with translated("read", tasks.MOTOR):
                self._tasks[tasks.MOTOR].is_task_done()  # raises if the generation has failed
            return self._read_inputs(n_samples, timeout_s)
        except BaseException:
            self._stop_quietly()
            raise

    def _read_inputs(self, n_samples: int, timeout_s: float) -> Block:
        config = self._ready()
        values = np.empty(n_samples)
        with translated("read", tasks.MASTER):
            reader = AnalogSingleChannelReader(self._tasks[tasks.MASTER].in_stream)
            reader.read_many_sample(values, n_samples, timeout_s)
        if config.force.kind == "bridge":
            force_n, raw = values, tasks.volts_of_force(config, values)
        else:
            force_n, raw = tasks.force_of_volts(config, values), values
        count = np.empty((n_samples, len(config.encoders)), dtype=np.int64)
        for column, encoder in enumerate(config.encoders):
            count[:, column] = self._read_ticks(tasks.encoder_task_name(encoder), n_samples, timeout_s)
        counted = tasks.EDGES in self._tasks
        exposures = self._read_ticks(tasks.EDGES, n_samples, timeout_s) if counted else None
        block = Block(self._next_sample, force_n, raw, count, exposures)
        self._next_sample += n_samples
        return block

    def _read_ticks(self, name: str, n_samples: int, timeout_s: float) -> NDArray[np.int64]:
        ticks = np.empty(n_samples)
        with translated("read", name):
            reader = CounterReader(self._tasks[name].in_stream)
            reader.verify_array_shape = False  # saves a round trip to the server per read
            reader.read_many_sample_double(ticks, n_samples, timeout_s)
        whole = np.rint(ticks)
        if not np.array_equal(whole, ticks):
            raise HardwareFault(f"{name}: counts are not whole numbers; the task is not in ticks", phase="read")
        return whole.astype(np.int64)

    def read_positions(self) -> dict[str, tuple[int, int]]:
        """Samples per channel that each input task has handed out and acquired since its start, by the driver."""
        positions = {}
        for name in (tasks.MASTER, *map(tasks.encoder_task_name, self._ready().encoders), tasks.EDGES):
            if name in self._tasks:
                with translated("read", name):
                    stream = self._tasks[name].in_stream
                    positions[name] = (int(stream.curr_read_pos), int(stream.total_samp_per_chan_acquired))
        return positions

    def safe_stop(self) -> None:
        """Stop all, motor at 0 V, drive disabled; each step is tried, then the first failure raised."""
        failures: list[BaseException] = []
        self._release(tasks.MOTOR, failures)
        if self._watchdog is not None:
            _attempt(self._watchdog.release_outputs, [])  # what stays locked is reported by the next step
        self._outputs_safe("stop", failures)
        for name in list(self._tasks):
            self._release(name, failures)
        if self._watchdog is not None and _attempt(self._watchdog.close, []):
            self._watchdog = None  # last: until here it watches over the steps above
        if failures:
            raise failures[0]

    def close(self) -> None:
        """Stop safely and close the connection."""
        try:
            self.safe_stop()
        finally:
            self._config = None
            if self._channel is not None:
                self._channel.close()

    def _stop_quietly(self) -> None:
        """Make safe while another fault is on its way; that one is reported."""
        _attempt(self.safe_stop, [])

    def _outputs_safe(self, phase: str, failures: list[BaseException]) -> None:
        config = self._config
        if config is None:
            return

        def zero() -> None:
            with translated(phase, f"{config.motor.channel} not put at 0 V, use the emergency stop"):
                tasks.write_zero(self._new_task, config)

        def disable() -> None:
            if config.drive_enable is not None:
                line = config.drive_enable.line
                with translated(phase, f"{line} not disabled, use the emergency stop"):
                    tasks.write_drive_enable(self._new_task, line, False)

        _attempt(zero, failures)
        _attempt(disable, failures)

    def _release(self, name: str, failures: list[BaseException]) -> None:
        task = self._tasks.pop(name, None)
        if task is None:
            return

        def close() -> None:
            with translated("stop", name), warnings.catch_warnings():
                # the driver warns (200010) when a finite generation is stopped before its end
                warnings.simplefilter("ignore", nidaqmx.errors.DaqWarning)
                task.close()

        _attempt(close, failures)

    def _kick(self) -> None:
        if self._watchdog is not None:
            self._watchdog.kick()

    def _ready(self) -> RigConfig:
        if self._config is None or tasks.MOTOR not in self._tasks:
            raise HardwareFault("the backend is not configured, or has been stopped; call configure first", phase="arm")
        return self._config


def _attempt(step: Callable[[], None], failures: list[BaseException]) -> bool:
    """Try one step of making safe; a second Ctrl-C must not keep the next from happening."""
    try:
        step()
    except BaseException as error:
        failures.append(error)
        return False
    return True
