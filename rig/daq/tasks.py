"""The tasks of a bench: analog inputs, and what follows their clock: encoders, motor, camera; one function each.

AI is the clock master. Counters and the motor output take their sample clock from ``ai/SampleClock``; counters arm on
``ai/StartTrigger`` and the frame pulses start on it. The motor output needs no trigger: its clock does not tick before
AI starts. NI-DAQmx's defaults (pounds, 2.5 V, degrees, 24 pulses) are never relied on: every argument is given.

Tasks are made once and used for every trial: stopped and unreserved in between, cleared only at the end. This follows
the state model of NI-DAQmx (verified → committed → running and back). An unreserved task keeps its settings and
reserves no hardware: the watchdog of a chassis can start before the others, and other tasks can have the channels.
Errors are those of ``nidaqmx``, translated by the caller.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import grpc
import nidaqmx
import nidaqmx.constants as ni
import numpy as np
from nidaqmx import GrpcSessionOptions
from nidaqmx.constants import TaskMode
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter
from numpy.typing import NDArray

from rig.backend import CALL_TIMEOUT_S, Block
from rig.configuration.rig_file import CameraConfig, EncoderConfig, OppositeHeadConfig, RigConfig
from rig.daq.faults import translate_faults
from rig.errors import HardwareFault, RigInputError, refuse

AUTO = SessionInitializationBehavior.AUTO
NEW = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
ATTACHED = SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION


def session_options(
    channel: grpc.Channel | None, name: str = "", behavior: SessionInitializationBehavior = AUTO
) -> GrpcSessionOptions | None:
    """Return the client's options for a session at a server; None on the driver of this computer."""
    return None if channel is None else GrpcSessionOptions(channel, name, initialization_behavior=behavior)


NewTask = Callable[[str], nidaqmx.Task]
"""Makes an empty task with the given name on the driver or server in use."""


class TaskSet:
    """Open tasks by name in the order they were made; registered as soon as they exist, so that none is lost.

    Parameters
    ----------
    end_left : ends what a server may still have of a task of ours that could not be cleared, by its name
    """

    def __init__(self, new_task: NewTask, end_left: Callable[[str], None]) -> None:
        self._new_task, self._end_left = new_task, end_left
        self._tasks: dict[str, nidaqmx.Task] = {}
        self._left: set[str] = set()
        """Names of tasks whose clearing failed: a server may still have them, and refuses another of the name."""

    def __contains__(self, name: str) -> bool:
        return name in self._tasks

    def __getitem__(self, name: str) -> nidaqmx.Task:
        return self._tasks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(tuple(self._tasks))

    def make(self, name: str) -> nidaqmx.Task:
        """Make an empty task and register it; one of that name that could not be cleared is cleared now."""
        if name in self._left:
            self._end_left(name)
            self._left.discard(name)
        self._tasks[name] = task = self._new_task(name)
        return task

    def unreserve(self, name: str) -> None:
        """Stop a task and unreserve its hardware, or clear it where that fails; nothing happens without the task."""
        if name not in self._tasks:
            return
        task = self._tasks[name]
        try:
            with _early_stop_expected():
                task.stop()
            task.control(TaskMode.TASK_UNRESERVE)
        except nidaqmx.errors.Error:
            self.clear(name)  # e.g. a generation that failed reports it when it is stopped

    def clear(self, name: str) -> None:
        """Clear the task of this name, if any, and forget it; where the driver refuses the error is raised, and its
        session is ended before another of the name is made."""
        task = self._tasks.pop(name, None)
        if task is not None:
            self._left.add(name)
            with _early_stop_expected():
                task.close()
            self._left.discard(name)


@contextmanager
def _early_stop_expected() -> Iterator[None]:
    """The driver warns (200010) when a finite generation is stopped before its end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", nidaqmx.errors.DaqWarning)
        yield


BUFFER_S = 20.0  # of the driver's buffers: how late the program may read before samples are lost
MASTER = "force"
"""Name of the master task."""


def inputs_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """Make the master task, by ``new_task`` from its name: analog inputs of the load cell, then of the further
    channels, continuous on its own clock, which is exported to devices joined by a wire."""
    task = force_task(new_task, config)
    for further in config.channels:
        ends_v = _interpolate_line(np.array([further.least, further.most]), further.physical, further.electrical)
        _add_voltage(task, further.channel, further.name, ends_v)
    for device in config.devices:
        if device.clock_from is not None:
            task.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, device.clock_from)
    return task


def force_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """Make the task of the load cell's analog input alone, in N for a bridge and V for a voltage, continuous on its own
    clock; unread samples are never overwritten."""
    task = new_task(MASTER)
    force = config.force
    if force.kind == "bridge":
        task.ai_channels.add_ai_force_bridge_two_point_lin_chan(
            force.channel,
            name_to_assign_to_channel="force",
            min_val=force.min_n,
            max_val=force.max_n,
            units=ni.ForceUnits.NEWTONS,
            bridge_config=ni.BridgeConfiguration.FULL_BRIDGE,
            voltage_excit_source=ni.ExcitationSource.INTERNAL,
            voltage_excit_val=force.excitation_v,
            nominal_bridge_resistance=force.bridge_resistance_ohm,
            first_electrical_val=force.electrical[0],
            second_electrical_val=force.electrical[1],
            electrical_units=ni.BridgeElectricalUnits.MILLIVOLTS_PER_VOLT,
            first_physical_val=force.physical_n[0],
            second_physical_val=force.physical_n[1],
            physical_units=ni.BridgePhysicalUnits.NEWTONS,
            custom_scale_name="",
        )
    else:
        ends = volts_of_force(config, np.array([force.min_n, force.max_n]))
        _add_voltage(task, force.channel, "force", ends)
    _set_sample_clock(task, config)
    task.in_stream.overwrite = ni.OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
    return task


def device_scaling(task: nidaqmx.Task) -> tuple[float, ...]:
    """Return the polynomial by which the driver scales codes of the force channel; empty where it does not say."""
    with contextlib.suppress(nidaqmx.errors.DaqError):
        return tuple(float(one) for one in task.ai_channels[0].ai_dev_scaling_coeff)
    return ()


def voltage_task(new_task: NewTask, config: RigConfig, channel: str) -> nidaqmx.Task:
    """AI on one voltage input within the motor's range, continuous, on its own clock."""
    task, limit = new_task(VOLTAGE), config.motor.voltage_limit_v
    _add_voltage(task, channel, "voltage", np.array([-limit, limit]))
    _set_sample_clock(task, config)
    return task


def _add_voltage(task: nidaqmx.Task, channel: str, name: str, ends_v: NDArray[np.float64]) -> None:
    """Add a differential voltage input with the range ``ends_v`` (two ends, V)."""
    task.ai_channels.add_ai_voltage_chan(
        channel,
        name_to_assign_to_channel=name,
        terminal_config=ni.TerminalConfiguration.DIFF,
        min_val=float(ends_v.min()),
        max_val=float(ends_v.max()),
        units=ni.VoltageUnits.VOLTS,
        custom_scale_name="",
    )


def _set_sample_clock(task: nidaqmx.Task, config: RigConfig, source: str = "") -> None:
    """Make a task sample continuously, on its own clock or on the one at the terminal ``source``."""
    rate = config.device.sample_rate_hz
    task.timing.cfg_samp_clk_timing(
        rate,
        source=source,
        active_edge=ni.Edge.RISING,
        sample_mode=ni.AcquisitionType.CONTINUOUS,
        samps_per_chan=int(BUFFER_S * rate),
    )


Points = tuple[float, float]


def _interpolate_line(value: NDArray[np.float64], x: Points, y: Points) -> NDArray[np.float64]:
    return y[0] + (value - x[0]) * ((y[1] - y[0]) / (x[1] - x[0]))


def volts_of_force(config: RigConfig, force_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Electrical reading (mV/V or V) that the calibration line gives for a force."""
    return _interpolate_line(force_n, config.force.physical_n, config.force.electrical)


MOTOR, CAMERA, EDGES, OPPOSITE, VOLTAGE = "motor", "camera", "exposures", "encoder_key_opposite", "voltage"
"""Names of the tasks."""
CHECK = "check_{}"
"""Name of the same task, where it is a self-test's own."""


def encoder_task_name(encoder: EncoderConfig) -> str:
    return f"encoder_{encoder.name}"


def encoder_task(new_task: NewTask, config: RigConfig, encoder: EncoderConfig) -> nidaqmx.Task:
    """Make the task of one encoder's counter, X4 ticks of its A and B terminals, latched on the AI sample clock and
    armed by the AI start trigger where that reaches its device."""
    task = new_task(encoder_task_name(encoder))
    channel = task.ci_channels.add_ci_ang_encoder_chan(
        encoder.counter,
        name_to_assign_to_channel=encoder.name,
        decoding_type=ni.EncoderType.X_4,
        zidx_enable=False,
        zidx_val=0.0,
        zidx_phase=ni.EncoderZIndexPhase.AHIGH_BHIGH,
        units=ni.AngleUnits.TICKS,
        pulses_per_rev=encoder.pulses_per_revolution,
        initial_angle=0.0,
        custom_scale_name="",
    )
    channel.ci_encoder_a_input_term = encoder.a_terminal
    channel.ci_encoder_b_input_term = encoder.b_terminal
    if encoder.filter_min_pulse_s > 0:
        channel.ci_encoder_a_input_dig_fltr_enable = True
        channel.ci_encoder_a_input_dig_fltr_min_pulse_width = encoder.filter_min_pulse_s
        channel.ci_encoder_b_input_dig_fltr_enable = True
        channel.ci_encoder_b_input_dig_fltr_min_pulse_width = encoder.filter_min_pulse_s
    _latch_on_ai(task, config, encoder.counter)
    return task


def opposite_head_task(new_task: NewTask, config: RigConfig, head: OppositeHeadConfig) -> nidaqmx.Task:
    """One counter on the second reading head of the key's scale, as the key's encoder."""
    key = config.encoders[0]
    same = {"counter": head.counter, "a_terminal": head.a_terminal, "b_terminal": head.b_terminal, "sign": head.sign}
    return encoder_task(lambda name: new_task(OPPOSITE), config, key.model_copy(update=same))


def _latch_on_ai(task: nidaqmx.Task, config: RigConfig, counter: str) -> None:
    """Give a counter the AI sample clock, and arm it on the AI start trigger where that reaches its device."""
    _set_sample_clock(task, config, config.clock_of(counter))
    if (start := config.start_of(counter)) is None:
        return
    trigger = task.triggers.arm_start_trigger
    trigger.trig_type = ni.TriggerType.DIGITAL_EDGE
    trigger.dig_edge_src = start
    trigger.dig_edge_edge = ni.Edge.RISING


def motor_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """Make the task of the motor's analog output, V, within the rig file's voltage limit, without clock or samples;
    `prepare_command` and `load_command` give it these."""
    task = new_task(MOTOR)
    limit = config.motor.voltage_limit_v
    task.ao_channels.add_ao_voltage_chan(
        config.motor.channel,
        name_to_assign_to_channel="motor",
        min_val=-limit,
        max_val=limit,
        units=ni.VoltageUnits.VOLTS,
        custom_scale_name="",
    )
    return task


def prepare_command(task: nidaqmx.Task, config: RigConfig, n_samples: int) -> None:
    """Set clock and buffer for a command of ``n_samples``, finite, one sample per AI clock edge; reserves nothing."""
    task.timing.cfg_samp_clk_timing(
        config.device.sample_rate_hz,
        source=config.clock_of(config.motor.channel),
        active_edge=ni.Edge.RISING,
        sample_mode=ni.AcquisitionType.FINITE,
        samps_per_chan=n_samples,
    )
    task.out_stream.output_buf_size = n_samples


def load_command(task: nidaqmx.Task, command_v: NDArray[np.float64]) -> None:
    """Load the whole command, which :func:`prepare_command` has prepared for; the last sample is 0 V."""
    writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
    writer.verify_array_shape = False  # saves a call
    writer.write_many_sample(np.ascontiguousarray(command_v, dtype=np.float64), timeout=CALL_TIMEOUT_S)


def camera_task(new_task: NewTask, config: RigConfig, camera: CameraConfig) -> tuple[nidaqmx.Task, float, float]:
    """Make the task of the camera's frame pulses, which the AI start trigger starts; return it, the coerced frame rate,
    Hz, and the first rising edge after the trigger, s."""
    task = new_task(CAMERA)
    channel = task.co_channels.add_co_pulse_chan_freq(
        camera.counter,
        name_to_assign_to_channel="camera",
        units=ni.FrequencyUnits.HZ,
        idle_state=ni.Level.LOW,
        initial_delay=camera.start_delay_s,
        freq=camera.frame_rate_hz,
        duty_cycle=0.5,
    )
    channel.co_pulse_term = camera.terminal
    task.timing.cfg_implicit_timing(sample_mode=ni.AcquisitionType.CONTINUOUS, samps_per_chan=1000)
    task.triggers.start_trigger.cfg_dig_edge_start_trig(
        f"/{config.device.name}/ai/StartTrigger", trigger_edge=ni.Edge.RISING
    )
    return task, float(channel.co_pulse_freq), float(channel.co_pulse_freq_initial_delay)


def edge_task(new_task: NewTask, config: RigConfig, counter: str, terminal: str) -> nidaqmx.Task:
    """Make the task in which ``counter`` counts rising edges on ``terminal`` up from 0, latched on the AI sample clock
    and armed by the AI start trigger where that reaches its device."""
    task = new_task(EDGES)
    channel = task.ci_channels.add_ci_count_edges_chan(
        counter,
        name_to_assign_to_channel="edges",
        edge=ni.Edge.RISING,
        initial_count=0,
        count_direction=ni.CountDirection.COUNT_UP,
    )
    channel.ci_count_edges_term = terminal
    _latch_on_ai(task, config, counter)
    return task


def check_command(config: RigConfig, command_v: NDArray[np.float64]) -> None:
    """Refuse a command (n,), V, that is not finite, starts or ends off 0 V, or exceeds the voltage or force limit."""
    if command_v.ndim != 1 or command_v.size < 2:
        raise RigInputError(f"motor command has shape {command_v.shape}, allowed one dimension and at least 2 samples")
    finite, (first, last) = np.isfinite(command_v), command_v[[0, -1]]
    reach = min(config.motor.voltage_limit_v, config.motor.force_limit_n / config.motor.force_per_volt_n)
    worst = float(np.max(np.abs(command_v)))
    refuse(
        RigInputError,
        (not finite.all(), f"motor command is not finite at sample {int(np.argmin(finite))}"),
        (first != 0.0 or last != 0.0, f"motor command starts at {first:g} V and ends at {last:g} V, allowed 0 V"),
        (
            worst > reach * (1 + 1e-9),
            f"motor command reaches {worst:g} V, allowed {reach:g} V on {config.motor.channel}",
        ),
    )


def read_inputs(open_tasks: TaskSet, config: RigConfig, first_sample: int, n_samples: int, timeout_s: float) -> Block:
    """Read the next ``n_samples`` of every input, each within ``timeout_s``, and return them as a block that begins at
    sample number ``first_sample``: force, counts, exposures, further channels in their units."""
    values = np.empty((1 + len(config.channels), n_samples))
    with translate_faults("read", MASTER):
        reader = AnalogMultiChannelReader(open_tasks[MASTER].in_stream)
        reader.verify_array_shape = False  # saves a round trip to the server per read
        reader.read_many_sample(values, n_samples, timeout_s)
    if config.force.kind == "bridge":
        force_n, raw = values[0], volts_of_force(config, values[0])
    else:
        force_n, raw = _interpolate_line(values[0], config.force.electrical, config.force.physical_n), values[0]
    further = [_interpolate_line(values[k], one.electrical, one.physical) for k, one in enumerate(config.channels, 1)]
    count = np.empty((n_samples, len(config.encoders)), dtype=np.int64)
    for column, encoder in enumerate(config.encoders):
        count[:, column] = _read_ticks(open_tasks, encoder_task_name(encoder), n_samples, timeout_s)
    if OPPOSITE in open_tasks and config.key_opposite is not None:
        per_tick = config.key_opposite.sign * 2 * np.pi / config.encoders[0].counts_per_revolution
        further.append(np.asarray(_read_ticks(open_tasks, OPPOSITE, n_samples, timeout_s) * per_tick, dtype=np.float64))
    exposures = _read_ticks(open_tasks, EDGES, n_samples, timeout_s) if EDGES in open_tasks else None
    return Block(first_sample, force_n, raw, count, exposures, np.column_stack(further) if further else None)


def _read_ticks(open_tasks: TaskSet, name: str, n_samples: int, timeout_s: float) -> NDArray[np.int64]:
    """Return the next ``n_samples`` ticks, (n_samples,), of the counter task ``name``, waiting at most ``timeout_s``;
    HardwareFault where they are not whole numbers."""
    ticks = np.empty(n_samples)
    with translate_faults("read", name):
        reader = CounterReader(open_tasks[name].in_stream)
        reader.verify_array_shape = False
        reader.read_many_sample_double(ticks, n_samples, timeout_s)
    whole = np.rint(ticks)
    if not np.array_equal(whole, ticks):
        raise HardwareFault(f"{name}: counts are not whole numbers; the task is not in ticks", phase="read")
    return whole.astype(np.int64)


def read_positions(open_tasks: TaskSet, config: RigConfig) -> dict[str, tuple[int, int]]:
    """Return by the name of each input task the samples per channel that the driver has handed out and those that it
    has acquired since its start, (handed out, acquired)."""
    found = {}
    encoders = map(encoder_task_name, config.encoders)
    for name in (MASTER, *encoders, OPPOSITE, EDGES):
        if name in open_tasks:
            with translate_faults("read", name):
                stream = open_tasks[name].in_stream
                found[name] = (int(stream.curr_read_pos), int(stream.total_samp_per_chan_acquired))
    return found
