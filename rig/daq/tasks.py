"""The tasks that follow the analog inputs' clock: encoders, motor, camera; one function each, every argument given.

AI is the clock master. Counters and the motor output take their sample clock from ``ai/SampleClock``; counters arm on
``ai/StartTrigger`` and the frame pulses start on it. The motor output needs no trigger: its clock does not tick before
AI starts. NI-DAQmx's defaults (volts of range, degrees, 24 pulses) are never relied on.
"""

from __future__ import annotations

import nidaqmx
import nidaqmx.constants as ni
import numpy as np
from nidaqmx.stream_writers import AnalogSingleChannelWriter
from numpy.typing import NDArray

from rig.configuration.channels import CameraConfig, EncoderConfig, OppositeHeadConfig
from rig.configuration.rig_file import RigConfig
from rig.daq.analog_inputs import buffer_samples
from rig.daq.task_set import NewTask
from rig.errors import RigInputError

WRITE_TIMEOUT_S = 5.0
MOTOR, CAMERA, EDGES, OPPOSITE = "motor", "camera", "exposures", "encoder_key_opposite"
"""Names of the tasks."""


def encoder_task_name(encoder: EncoderConfig) -> str:
    """Return the name of an encoder's task."""
    return f"encoder_{encoder.name}"


def encoder_task(new_task: NewTask, config: RigConfig, encoder: EncoderConfig) -> nidaqmx.Task:
    """One counter on one encoder: X4 ticks, latched on the AI sample clock from the AI start trigger on."""
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
    _latched_on_ai(task, config, encoder.counter)
    return task


def opposite_head_task(new_task: NewTask, config: RigConfig, head: OppositeHeadConfig) -> nidaqmx.Task:
    """One counter on the second reading head of the key's scale, as the key's encoder."""
    key = config.encoders[0]
    same = {"counter": head.counter, "a_terminal": head.a_terminal, "b_terminal": head.b_terminal, "sign": head.sign}

    def named(name: str) -> nidaqmx.Task:
        return new_task(OPPOSITE)

    return encoder_task(named, config, key.model_copy(update=same))


def _latched_on_ai(task: nidaqmx.Task, config: RigConfig, counter: str) -> None:
    """Give a counter the AI sample clock, and arm it on the AI start trigger where that reaches its device."""
    rate = config.device.sample_rate_hz
    task.timing.cfg_samp_clk_timing(
        rate,
        source=config.clock_of(counter),
        active_edge=ni.Edge.RISING,
        sample_mode=ni.AcquisitionType.CONTINUOUS,
        samps_per_chan=buffer_samples(rate),
    )
    if (start := config.start_of(counter)) is None:
        return
    trigger = task.triggers.arm_start_trigger
    trigger.trig_type = ni.TriggerType.DIGITAL_EDGE
    trigger.dig_edge_src = start
    trigger.dig_edge_edge = ni.Edge.RISING


def motor_task(new_task: NewTask, config: RigConfig) -> nidaqmx.Task:
    """AO of the motor's command, which :func:`prepare_command` and :func:`load_command` give it."""
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
    writer.write_many_sample(np.ascontiguousarray(command_v, dtype=np.float64), timeout=WRITE_TIMEOUT_S)


def camera_task(new_task: NewTask, config: RigConfig, camera: CameraConfig) -> tuple[nidaqmx.Task, float, float]:
    """CO with the frame pulses, started by the AI start trigger; also its coerced rate, Hz, and first edge, s."""
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
    """One counter counting rising edges on a terminal, latched on the AI sample clock from the AI start trigger on."""
    task = new_task(EDGES)
    channel = task.ci_channels.add_ci_count_edges_chan(
        counter,
        name_to_assign_to_channel="edges",
        edge=ni.Edge.RISING,
        initial_count=0,
        count_direction=ni.CountDirection.COUNT_UP,
    )
    channel.ci_count_edges_term = terminal
    _latched_on_ai(task, config, counter)
    return task


def check_command(config: RigConfig, command_v: NDArray[np.float64]) -> None:
    """Check the motor command once more before it is loaded, whatever was checked before."""
    if command_v.ndim != 1 or command_v.size < 2:
        raise RigInputError(f"motor command has shape {command_v.shape}, allowed one dimension and at least 2 samples")
    if not np.all(np.isfinite(command_v)):
        raise RigInputError(f"motor command is not finite at sample {int(np.argmin(np.isfinite(command_v)))}")
    if command_v[0] != 0.0 or command_v[-1] != 0.0:
        raise RigInputError(f"motor command starts at {command_v[0]:g} V and ends at {command_v[-1]:g} V, allowed 0 V")
    reach = min(config.motor.voltage_limit_v, config.motor.force_limit_n / config.motor.force_per_volt_n)
    worst = float(np.max(np.abs(command_v)))
    if worst > reach * (1 + 1e-9):
        raise RigInputError(f"motor command reaches {worst:g} V, allowed {reach:g} V on {config.motor.channel}")
