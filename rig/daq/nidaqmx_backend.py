"""The backend contract (:mod:`rig.backend`) on NI-DAQmx: one set of tasks for all trials, slaves before the master.

Between trials the tasks reserve nothing; after a fault all are cleared and made again. The device is reset before the
first trial and after its watchdog has tripped. Every way out ends at 0 V. Software is the second safety layer only: the
drive's own torque limit, hard stops and emergency stop are the first.

How long one call of the driver takes decides whether the bench can be watched over. A block needs a number of calls one
after the other, and the watchdog is reset between them. Both must fit: the calls of a block into the block's own time,
or the program falls behind the motor; and the longest time between two resets into the watchdog's timeout. It is
measured before anything moves. Blocks are lengthened up to 50 ms for a slow connection; what needs more is refused,
because limits would act too late.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version

import grpc
import nidaqmx
import numpy as np
from nidaqmx.constants import TaskMode
from nidaqmx.stream_readers import AnalogSingleChannelReader
from nidaqmx.system import Device
from numpy.typing import ArrayLike

from rig.arrays import as_numbers
from rig.backend import CALL_TIMEOUT_S, Backend, Block, Capabilities, Expiry, Timing
from rig.configuration.rig_file import RigConfig
from rig.daq import tasks
from rig.daq.discovery import FoundDevice, driver_version, find_device, find_devices
from rig.daq.faults import translate_faults
from rig.daq.safe_bench import SafeBench, leave_running, make_watchdog, worst_failure
from rig.daq.server_claim import ServerClaim
from rig.errors import HardwareFault, NotSupported, RigInputError

PROBES = 5  # calls that are timed: the longest of five is exceeded once in six
CALLS_BETWEEN_RESETS = 4  # most, before the master starts, of the watchdog: the reset among them
RESERVE = 0.5  # of the watchdog's timeout, that those calls may use
BLOCK_RESERVE = 0.8  # of the watchdog's timeout, that a block and its calls may use
RESETS_IN_TIMEOUT = 8  # of the watchdog, while blocks are read: one may fail to come seven times
LENGTHENED_S = 0.05  # longest block that replaces a shorter ``recording.block_s`` without being asked for
DEAR = 0.05  # of a block's time, that its calls may take before blocks are lengthened at 0 V
ADVISED = 1.2  # times what is needed, that a message advises: calls take longer now and then
LONGEST_USEFUL_S = 0.4  # of a block that is advised: limits that act so late protect nothing


@dataclass(frozen=True)
class CallDelay:
    """Time one driver call takes, s: the median, and the longest of a few."""

    usual_s: float
    longest_s: float


def measure_call_delay(call: Callable[[], object], now_s: Callable[[], float]) -> CallDelay:
    """Time a cheap driver call five times by ``now_s``, the clock of the watchdog, s; return median and longest."""
    taken = []
    for _ in range(PROBES):
        began = now_s()
        call()
        taken.append(now_s() - began)
    return CallDelay(float(np.median(taken)), max(taken))


def calls_per_block(config: RigConfig) -> int:
    """Return the driver calls of one block: one read a task, the state of the generation, the watchdog's reset."""
    counted = config.camera is not None and config.camera.mode == "counted"
    further = int(counted) + int(config.key_opposite is not None)
    return 1 + len(config.encoders) + further + 1 + int(config.watchdog is not None)


def calm_block_s(config: RigConfig, delay: CallDelay) -> float:
    """Length, s, of the blocks to read while the motor's command is 0 V, longer so that fewer calls are made; 0, for no
    longer ones, where calls, of measured ``delay``, are cheap or ``recording.block_s`` is as long already.

    Through a server each call costs processor time at both ends; where nothing is commanded the limits may act as late
    as on a slow connection.
    """
    cheap = calls_per_block(config) * delay.usual_s <= DEAR * config.recording.block_s
    longest_s = LENGTHENED_S if config.watchdog is None else min(LENGTHENED_S, RESERVE * config.watchdog.timeout_s)
    return 0.0 if cheap or config.recording.block_s >= longest_s else longest_s


def shortest_block_s(config: RigConfig, delay: CallDelay) -> float:
    """Shortest block, s, whose driver calls, of measured ``delay``, fit into its own time; 0 where
    ``recording.block_s`` is enough. Refuse a connection for which it or the time between two resets of the watchdog
    would be too long."""
    calls, block_s = calls_per_block(config), config.recording.block_s
    longest_s = max(block_s, LENGTHENED_S)
    needed_s = calls * delay.usual_s
    allowed = {f"blocks of at most {longest_s:g} s": longest_s / calls}
    remedy = [f"recording.block_s from {ADVISED * needed_s:.2g} s"]
    if config.watchdog is not None:
        timeout_s = config.watchdog.timeout_s
        between_s = max(CALLS_BETWEEN_RESETS * delay.longest_s, calls * delay.longest_s + max(block_s, needed_s))
        allowed["the watchdog's timeout"] = min(
            RESERVE * timeout_s / CALLS_BETWEEN_RESETS, max(BLOCK_RESERVE * timeout_s - block_s, 0.0) / calls
        )
        remedy.append(f"watchdog.timeout_s from {max(timeout_s, between_s / RESERVE, 2 * ADVISED * needed_s):.2g} s")
    slow = [
        f"{least * 1e3:.3g} ms by {name}"
        for name, least in allowed.items()
        if (delay.longest_s if "watchdog" in name else delay.usual_s) > least
    ]
    if slow:
        advice = "use a faster link"
        if ADVISED * needed_s <= LONGEST_USEFUL_S:
            advice += f", or set {' and '.join(remedy)}: limits then act that much later"
        raise NotSupported(
            f"device {config.device.name}: a driver call takes {delay.usual_s * 1e3:.3g} ms, at most "
            f"{delay.longest_s * 1e3:.3g} ms; allowed {' and '.join(slow)} ({calls} calls a block); nothing has moved; "
            f"{advice}",
            phase="configure",
        )
    return needed_s if needed_s > block_s else 0.0


SHUNT_S = 0.4  # of a mean with the shunt and without: 20 periods of 50 Hz
CLIENT_VERSION = version("nidaqmx")


class NidaqmxBackend(SafeBench, Backend):
    """Acquisition on NI-DAQmx, and what a self-test asks of the hardware.

    Parameters
    ----------
    channel : grpc.Channel or None
        What answers: None is the NI-DAQmx driver of this computer, a channel is a gRPC Device Server or the
        virtual bench.
    name : str
        Shown in reports.
    claim : ServerClaim, optional
        Claim on the rig's sessions at a server that other programs use, too.
    """

    def __init__(self, channel: grpc.Channel | None, *, name: str, claim: ServerClaim | None = None) -> None:
        super().__init__(channel)
        self._claim = claim
        self._name = name
        self._simulated, self._product = False, "unknown"
        self._description: dict[str, str] = {}
        self._generating = False
        """The motor's command has not ended yet, as far as is known."""

    @property
    def capabilities(self) -> Capabilities:
        """What this is."""
        description = {"client": f"nidaqmx {CLIENT_VERSION}", "product": self._product, **self._description}
        return Capabilities(self._name, self._simulated, description, watchdog=True, hardware=True)

    def identify(self, config: RigConfig) -> None:
        """Read product, serial numbers and driver version of the rig's devices and keep them for `capabilities`; refuse
        another product than the rig file states.

        Raises
        ------
        RigInputError
            When it is another product than the rig file says.
        HardwareFault
            When the driver, server or device does not answer.
        """
        found = find_device(self._channel, config.device.name)
        self._product, self._simulated = found.product, found.simulated
        self._description = {
            "driver": f"NI-DAQmx {driver_version(self._channel)}",
            "serial_number": found.serial,
            **{f"slot_{m.slot}": f"{m.product}, {m.name}, serial number {m.serial}" for m in found.modules},
        }
        stated: list[tuple[str, str, FoundDevice]] = [("device.product", config.device.product, found)]
        for further in config.devices:
            other = find_device(self._channel, further.name)
            self._description[f"device_{further.name}"] = f"{other.product}, serial number {other.serial}"
            self._simulated = self._simulated or other.simulated
            stated.append(("devices: product", further.product, other))
        for key, product, there in stated:
            if there.product != product:
                raise RigInputError(
                    f"{key} = {product!r}: device {there.name} is a {there.product}; correct the rig file"
                )

    def devices(self) -> list[FoundDevice]:
        """Return every card and chassis that the driver or server has, with modules and serial numbers."""
        return find_devices(self._channel)

    def configure(self, config: RigConfig, command_v: ArrayLike | None) -> Timing:
        """Check the command (n,), V (None: no motor task), make the outputs safe, reserve all channels, start the
        watchdog, load the command; return the timing that the device gave. Nothing moves; a failure leaves the bench
        safe."""
        if command_v is not None:
            command_v = as_numbers(command_v, "motor command", 1)
            tasks.check_command(config, command_v)
        if self._live or not self._safe:
            self.safe_stop()
        if config != self._config or self._timing is None or (command_v is not None) != (tasks.MOTOR in self._tasks):
            self._clear()
        if self._claim is not None:
            self._claim.take(config)
        self._config = config
        with self._safe_on_failure():
            delay = self._begin_safely(config)
            self._live = True
            # all that takes calls comes before the watchdog starts: no task is reserved by it, as a chassis demands
            timing = self._timing = replace(
                self._timing or self._make_tasks(config, motor=command_v is not None),
                shortest_block_s=shortest_block_s(config, delay),
                calm_block_s=calm_block_s(config, delay),
            )
            if command_v is not None:
                with translate_faults("configure", config.motor.channel):
                    tasks.prepare_command(self._tasks[tasks.MOTOR], config, command_v.size)
            if config.watchdog is not None:
                with translate_faults("configure", "watchdog"):
                    self._watchdog = self._watchdog or make_watchdog(self._channel, config)
                    self._watchdog.start()
                    self._reset_watchdog()
            if command_v is not None:
                with translate_faults("configure", config.motor.channel):
                    tasks.load_command(self._tasks[tasks.MOTOR], command_v)
            for name in self._tasks:
                with translate_faults("configure", name):
                    self._reset_watchdog()
                    self._tasks[name].control(TaskMode.TASK_COMMIT)
        return timing

    def _begin_safely(self, config: RigConfig) -> CallDelay:
        """Put the outputs in their safe state, reset the device if that was not done yet, refuse a slow connection;
        return how long a driver call takes."""
        failures: list[BaseException] = []
        self._make_outputs_safe("configure", failures)
        if failures:
            raise worst_failure(failures)
        if not self._was_reset:
            self._reset_device("configure")
            self._make_outputs_safe("configure", failures)
            if failures:
                raise worst_failure(failures)
        with translate_faults("configure", f"device {config.device.name}"):
            device = Device(config.device.name, grpc_options=tasks.session_options(self._channel))
            delay = measure_call_delay(lambda: device.is_simulated, self._now_s)
        shortest_block_s(config, delay)
        return delay

    def _make_tasks(self, config: RigConfig, *, motor: bool) -> Timing:
        """Make every task of the rig file, the motor's only if ``motor``, reserving nothing; return the timing that the
        device gave. Refuse a sample rate that the device does not have."""
        frame_rate_hz = first_pulse_s = None
        with translate_faults("configure", config.force.channel):
            inputs = tasks.inputs_task(self._tasks.make, config)
            rate = float(inputs.timing.samp_clk_rate)
            scaling = tasks.device_scaling(inputs)
        if abs(rate - config.device.sample_rate_hz) > 1e-6 * rate:
            raise RigInputError(
                f"device.sample_rate_hz = {config.device.sample_rate_hz:g} Hz: {config.force.module} gives {rate:.6g} "
                "Hz; write a rate the module has"
            )
        for encoder in config.encoders:
            with translate_faults("configure", encoder.counter):
                tasks.encoder_task(self._tasks.make, config, encoder)
        if config.key_opposite is not None:
            with translate_faults("configure", config.key_opposite.counter):
                tasks.opposite_head_task(self._tasks.make, config, config.key_opposite)
        if motor:
            with translate_faults("configure", config.motor.channel):
                tasks.motor_task(self._tasks.make, config)
        if config.camera is not None:
            with translate_faults("configure", config.camera.counter):
                if config.camera.mode == "counted":
                    tasks.edge_task(self._tasks.make, config, config.camera.counter, config.camera.terminal)
                else:
                    _, frame_rate_hz, first_pulse_s = tasks.camera_task(self._tasks.make, config, config.camera)
        return Timing(rate, config.force.group_delay(rate), frame_rate_hz, first_pulse_s, force_device_scaling=scaling)

    def arm(self, *, enable_drive: bool = True) -> None:
        """Start all tasks but the master, on whose clock and trigger they wait; enable the drive last, at 0 V, where
        there is a motor task and ``enable_drive`` is true. A failure leaves the bench safe."""
        config = self._require_configured()
        with self._safe_on_failure():
            for name in self._tasks:
                if name != tasks.MASTER:
                    with translate_faults("arm", name):
                        self._reset_watchdog()
                        self._tasks[name].start()
            self._generating = tasks.MOTOR in self._tasks
            if config.drive_enable is not None and enable_drive and self._generating:
                with translate_faults("arm", config.drive_enable.line):
                    self._reset_watchdog()
                    self._outputs.enable_drive(config.drive_enable.line, True)

    def start(self) -> None:
        self._require_configured()
        self._next_sample = self._reset_at_sample = 0
        with self._safe_on_failure(), translate_faults("start", tasks.MASTER):
            self._reset_watchdog()
            self._tasks[tasks.MASTER].start()

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        """Return the next ``n_samples`` of every input, waiting at most ``timeout_s`` for each, and reset the watchdog
        as needed; on a fault the outputs are made safe before it is raised."""
        config = self._require_configured()
        with self._safe_on_failure():
            with translate_faults("read", "watchdog"):
                watchdog_s = 0.0 if config.watchdog is None else config.watchdog.timeout_s
                interval_s = watchdog_s / RESETS_IN_TIMEOUT
                # by the device's time, which is in the samples, and by ours, in which a block may be late
                read_s = (self._next_sample - self._reset_at_sample) / config.device.sample_rate_hz
                self._reset_watchdog(at_least_every_s=interval_s if read_s < interval_s else 0.0)
            if self._generating:
                with translate_faults("read", tasks.MOTOR):  # raises if the generation has failed
                    self._generating = not self._tasks[tasks.MOTOR].is_task_done()
            return self._read_inputs(n_samples, timeout_s)

    def _read_inputs(self, n_samples: int, timeout_s: float) -> Block:
        block = tasks.read_inputs(self._tasks, self._require_configured(), self._next_sample, n_samples, timeout_s)
        self._next_sample += n_samples
        return block

    def read_positions(self) -> dict[str, tuple[int, int]]:
        """Samples per channel that each input task has handed out and acquired since its start, by the driver."""
        return tasks.read_positions(self._tasks, self._require_configured())

    @contextlib.contextmanager
    def _temporary_tasks(self) -> Iterator[tasks.NewTask]:
        """Yield a function that makes a self-test's own task by name; at the end these tasks are closed, the last
        first."""
        with contextlib.ExitStack() as made:

            def new_task(name: str) -> nidaqmx.Task:
                task = self._new_task(tasks.CHECK.format(name))
                made.callback(task.close)
                return task

            yield new_task

    def shunt_step(self, config: RigConfig) -> float:
        """Return by how much the bridge's reading changes when the module's shunt resistor is switched in, mV/V."""
        n, readings = int(SHUNT_S * config.device.sample_rate_hz), []
        for shunt in (False, True):
            with translate_faults("read", config.force.channel), self._temporary_tasks() as new_task:
                task = tasks.force_task(new_task, config)
                task.ai_channels[0].ai_bridge_shunt_cal_enable = shunt
                task.start()
                values = np.empty(n)
                AnalogSingleChannelReader(task.in_stream).read_many_sample(values, n, CALL_TIMEOUT_S)
            settled = values[n // 4 :]  # after the step response of the module's filter
            readings.append(float(np.mean(tasks.volts_of_force(config, settled))))
        return readings[1] - readings[0]

    def count_edges(self, config: RigConfig, counter: str, terminal: str, duration_s: float, pulses: bool) -> int:
        """Count the rising edges on ``terminal`` with ``counter`` during ``duration_s`` of the sample clock; with
        ``pulses`` the camera's counter puts out its frame pulses meanwhile."""
        n = int(round(duration_s * config.device.sample_rate_hz))
        with translate_faults("read", counter), self._temporary_tasks() as new_task:
            edges = tasks.edge_task(new_task, config, counter, terminal)
            made = [edges]
            if pulses and config.camera is not None:
                made.append(tasks.camera_task(new_task, config, config.camera)[0])
            made.append(tasks.force_task(new_task, config))
            for task in made:
                task.start()
            counted = edges.read(n, timeout=CALL_TIMEOUT_S)
        return int(counted[-1]) - int(counted[0])

    def read_loopback(self, config: RigConfig, channel: str, command_v: ArrayLike) -> np.ndarray:
        """Put out the command (n,), V, and return what the voltage input ``channel``, wired to the motor's output,
        reads meanwhile, (n,), V; the output is then put at 0 V."""
        command_v = as_numbers(command_v, "motor command", 1)
        values = np.empty(command_v.size)
        with translate_faults("read", channel), contextlib.ExitStack() as then:
            then.callback(self._outputs.put_motor_at_zero, config)
            new_task = then.enter_context(self._temporary_tasks())
            motor = tasks.motor_task(new_task, config)
            tasks.prepare_command(motor, config, command_v.size)
            tasks.load_command(motor, command_v)
            loop = tasks.voltage_task(new_task, config, channel)
            motor.start()
            loop.start()
            AnalogSingleChannelReader(loop.in_stream).read_many_sample(values, values.size, CALL_TIMEOUT_S)
        return values

    def let_watchdog_expire(self, n_samples: int, blocks: int) -> Expiry:
        """Read at most ``blocks`` blocks of ``n_samples`` without resetting the watchdog; return them, and from which
        block on it had expired. A chassis gives none after that.

        The bench is then stopped by ``safe_stop``, which resets a device whose watchdog has expired.
        """
        read: list[Block] = []
        tripped: int | None = None
        for index in range(blocks):
            try:
                read.append(self._read_inputs(n_samples, CALL_TIMEOUT_S))
            except HardwareFault:
                if not self._has_expired():
                    raise
                return Expiry(read, index if tripped is None else tripped, locked=True)
            if tripped is None and self._has_expired():
                tripped = index
        return Expiry(read, tripped)

    def _has_expired(self) -> bool:
        with translate_faults("read", "watchdog"):
            return self._watchdog is not None and bool(self._watchdog.expired)

    def close(self) -> None:
        """Stop safely, close all; where an output could not be made safe, the watchdog is left to expire."""
        try:
            self.safe_stop()
        finally:
            self._clear()
            if self._watchdog is not None:
                leave_running(self._watchdog)
            self._watchdog = self._config = None
            if self._claim is not None:
                self._claim.release()
            if self._channel is not None:
                self._channel.close()

    def _require_configured(self) -> RigConfig:
        if self._config is None or not self._live:
            raise HardwareFault("the backend is not configured, or has been stopped; call configure first", phase="arm")
        return self._config
