"""What a recording reserves: every task with its channels, clock, trigger and routes, as rows to print."""

from __future__ import annotations

from dataclasses import dataclass

from rig.backend import Timing
from rig.configuration.rig_file import RigConfig
from rig.daq import tasks
from rig.daq.safe_bench import ANALOG_REACH
from rig.daq.tasks import MASTER


@dataclass(frozen=True)
class TaskPlan:
    """One task: its channel and what it measures or puts out, clock, trigger, and routes (``from -> to``)."""

    task: str
    channel: str
    purpose: str
    clock: str
    trigger: str
    routes: tuple[str, ...] = ()


def recording_plan(config: RigConfig, timing: Timing, n_command: int) -> list[TaskPlan]:
    """Rows to print, one for each task of a recording, from watchdog and inputs to the drive's enable line; ``timing``
    gives the rates of the device, ``n_command`` the samples of the motor's command. Nothing is made."""
    device, rate = config.device.name, timing.sample_rate_hz
    ai_clock, ai_trigger = f"/{device}/ai/SampleClock", f"/{device}/ai/StartTrigger"

    def slave_clock_text(channel: str) -> str:
        return f"{config.clock_of(channel)}, {rate:.10g} Hz"

    def arm_trigger_text(channel: str) -> str:
        start = config.start_of(channel)
        return f"arm start: {start}" if start else "none: its clock starts with AI"

    force = config.force
    rows = []
    if config.watchdog is not None:
        analog = config.device.product in ANALOG_REACH and config.device_of(config.motor.channel) is None
        states = [f"{config.motor.channel} 0 V"] if analog else []
        drive = config.drive_enable
        states += [f"{drive.line} low"] if drive and config.device_of(drive.line) is None else []
        purpose = f"after {config.watchdog.timeout_s:g} s of silence: {', '.join(states) or 'nothing'}"
        rows.append(TaskPlan("watchdog", device, purpose, "device timer", "software, kicked with every block"))
    unit = force.electrical_unit
    rows.append(
        TaskPlan(
            MASTER,
            force.channel,
            f"AI {force.kind}, {force.electrical[0]:g} to {force.electrical[1]:g} {unit} is "
            f"{force.physical_n[0]:g} to {force.physical_n[1]:g} N, delay {timing.force_group_delay_s * 1e3:.4g} ms",
            f"own, {rate:.10g} Hz, continuous",
            "software, starts all others",
            (
                f"{ai_clock} -> counters, motor",
                f"{ai_trigger} -> counters, camera",
                *(f"{ai_clock} -> {d.clock_from} -> wire -> {d.clock_to}" for d in config.devices if d.clock_from),
                *(f"{ai_clock} -> RTSI -> {d.name}" for d in config.devices if d.link == "RTSI"),
            ),
        )
    )
    for further in config.channels:
        line = f"{further.electrical[0]:g} to {further.electrical[1]:g} V is {further.physical[0]:g} to "
        purpose = f"AI voltage, {line}{further.physical[1]:g} {further.unit}, {further.quantity}"
        rows.append(TaskPlan(MASTER, further.channel, purpose, "with the force", "with the force"))
    for encoder in config.encoders:
        rows.append(
            TaskPlan(
                tasks.encoder_task_name(encoder),
                encoder.counter,
                f"CI angular encoder X4, {encoder.counts_per_revolution} counts/rev, sign {encoder.sign:+d}",
                slave_clock_text(encoder.counter),
                arm_trigger_text(encoder.counter),
                (f"{encoder.a_terminal} -> A", f"{encoder.b_terminal} -> B"),
            )
        )
    if (head := config.key_opposite) is not None:
        purpose = f"CI angular encoder X4, second head on the key's scale, sign {head.sign:+d}"
        routes = (f"{head.a_terminal} -> A", f"{head.b_terminal} -> B")
        rows.append(
            TaskPlan(
                tasks.OPPOSITE,
                head.counter,
                purpose,
                slave_clock_text(head.counter),
                arm_trigger_text(head.counter),
                routes,
            )
        )
    motor = config.motor
    purpose = f"AO voltage, {motor.force_per_volt_n:g} N/V, within {motor.voltage_limit_v:g} V"
    clock = f"{slave_clock_text(motor.channel)}, finite, {n_command} samples, last 0 V"
    rows.append(TaskPlan(tasks.MOTOR, motor.channel, purpose, clock, "none: its clock starts with AI"))
    if camera := config.camera:
        if timing.frame_rate_hz is not None and timing.first_pulse_s is not None:
            first_ms = timing.first_pulse_s * 1e3
            purpose = f"CO frame pulses, {timing.frame_rate_hz:.10g} Hz, first after {first_ms:.6g} ms"
            clock, trigger, route = "implicit, continuous", f"start: {ai_trigger}", f"pulse train -> {camera.terminal}"
            rows.append(TaskPlan(tasks.CAMERA, camera.counter, purpose, clock, trigger, (route,)))
        else:
            purpose, route = "CI count of the camera's exposures", f"{camera.terminal} -> counter source"
            clock, trigger = slave_clock_text(camera.counter), arm_trigger_text(camera.counter)
            rows.append(TaskPlan(tasks.EDGES, camera.counter, purpose, clock, trigger, (route,)))
    if config.drive_enable:
        purpose, trigger = "DO, high enables the drive", "software, last to go high, low on every exit"
        rows.append(TaskPlan("drive_enable", config.drive_enable.line, purpose, "on demand", trigger))
    return rows
