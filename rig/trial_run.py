"""One trial on a backend: quiet, blow, rest; whatever happens the bench is made safe and what was recorded is kept.

Place in the data flow: recorder → this → backend; returns the trial's data with a status, and the exception that
ended it, if any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block, Timing
from rig.config import RigConfig
from rig.errors import HardwareFault, InputError
from rig.feed import BlockFeed
from rig.interrupts import deferred
from rig.profile import Profile
from rig.rest import RestDetector
from rig.session.annotation_file import utc_now
from rig.session.records import CameraInfo, EncoderInfo, ForceInfo, TrialData

READ_TIMEOUT_S = 2.0
"""How long a block may be late before the motor is stopped; a block takes 20 ms."""


@dataclass(frozen=True)
class Progress:
    """Where the recording is: trial of trials, time in the trial, and the largest force of the last block."""

    trial: int
    trials: int
    time_s: float
    blow_end_s: float
    peak_force_n: float


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """Data of a trial (None when not one sample came) and what ended it early."""

    data: TrialData | None
    error: BaseException | None


@dataclass(frozen=True, eq=False)
class MotorCommand:
    """Volts for a whole trial: quiet zeros, then the profile; ends at 0 V."""

    volts: NDArray[np.float64]
    blow_start_s: float
    blow_end_s: float


def motor_command(profile: Profile, config: RigConfig) -> MotorCommand:
    """Check a profile against the rig's limits and turn it into volts on the sample clock.

    Raises
    ------
    InputError
        When the profile exceeds the limits of force, slew rate or output voltage.
    """
    rate, motor = config.device.sample_rate_hz, config.motor
    profile.check_limits(motor.force_limit_n, motor.slew_limit_n_per_s, rate)
    volts = profile.sample(rate) / motor.force_per_volt_n
    if np.max(np.abs(volts)) > motor.voltage_limit_v:
        raise InputError(f"{profile.name}: needs {np.max(np.abs(volts)):g} V, allowed {motor.voltage_limit_v:g} V")
    quiet = int(np.ceil(config.recording.quiet_s * rate))
    whole = np.concatenate((np.zeros(quiet), volts))
    start_s = quiet / rate
    return MotorCommand(whole, start_s + profile.onset_s, start_s + profile.duration_s)


def run_trial(
    backend: Backend,
    config: RigConfig,
    command: MotorCommand,
    number: int,
    trials: int,
    *,
    progress: Callable[[Progress], None] | None = None,
    feed: BlockFeed | None = None,
) -> TrialOutcome:
    """Record one trial; never raises for what happens on the bench, the outcome carries it."""
    blocks: list[Block] = []
    started = utc_now()
    status, reason = "fault", ""
    error: BaseException | None = None
    timing: Timing | None = None
    try:
        timing = backend.configure(config, command.volts)
        backend.arm()
        started = utc_now()
        backend.start()
        status = _read_until_rest(backend, config, command, timing, blocks, number, trials, progress, feed)
    except KeyboardInterrupt as interrupt:
        status, reason, error = "interrupted", "stopped by the operator", interrupt
    except BaseException as fault:
        status, reason, error = "fault", _one_line(fault), fault
    finally:
        with deferred():
            try:
                backend.safe_stop()
            except HardwareFault as fault:
                status, reason, error = "fault", _one_line(fault), error or fault
    if status == "not at rest":
        reason = f"not at rest {config.recording.longest_s:g} s after the blow"
    if not blocks or timing is None:
        return TrialOutcome(None, error)
    simulated = backend.capabilities.simulated
    return TrialOutcome(_trial_data(config, command, timing, blocks, number, started, status, reason, simulated), error)


def _read_until_rest(
    backend: Backend,
    config: RigConfig,
    command: MotorCommand,
    timing: Timing,
    blocks: list[Block],
    number: int,
    trials: int,
    progress: Callable[[Progress], None] | None,
    feed: BlockFeed | None,
) -> str:
    rate, recording = timing.sample_rate_hz, config.recording
    size = max(int(round(recording.block_s * rate)), 1)
    earliest = command.volts.size + int(np.ceil(timing.force_group_delay_s * rate))
    longest = command.volts.size + int(np.ceil(recording.longest_s * rate))
    detector = RestDetector(
        window=int(np.ceil(recording.rest_s * rate)),
        earliest=earliest,
        baseline=int(command.blow_start_s * rate),
        counts=recording.rest_counts,
        force_n=recording.rest_force_n,
    )
    read = 0
    while True:
        block = backend.read_block(size, READ_TIMEOUT_S)
        blocks.append(block)
        read += size
        if feed is not None:
            feed.publish(block)
        if progress is not None:
            peak = float(np.max(np.abs(block.force_n)))
            progress(Progress(number, trials, read / rate, command.blow_end_s, peak))
        if detector.add(block.force_n, block.encoder_count):
            return "complete"
        if read >= longest:
            return "not at rest"


def _joined(blocks: list[Block]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    return np.concatenate([b.force_n for b in blocks]), np.concatenate([b.encoder_count for b in blocks])


def _one_line(error: BaseException) -> str:
    text = f"{type(error).__name__}: {error}".replace("\0", " ")  # HDF5 text cannot hold a null
    return " ".join(text.split())


def _trial_data(
    config: RigConfig,
    command: MotorCommand,
    timing: Timing,
    blocks: list[Block],
    number: int,
    started: str,
    status: str,
    reason: str,
    simulated: bool,
) -> TrialData:
    force_n, count = _joined(blocks)
    n, rate = force_n.size, timing.sample_rate_hz
    if [block.first_sample for block in blocks] != list(np.cumsum([0, *(b.force_n.size for b in blocks[:-1])])):
        raise HardwareFault(f"trial {number}: the blocks read do not follow each other without a gap")
    volts = np.zeros(n)
    volts[: min(n, command.volts.size)] = command.volts[:n]
    return TrialData(
        number=number,
        status=status,
        reason=reason,
        started_utc=started,
        simulated=simulated,
        sample_rate_hz=rate,
        time_s=np.arange(n) / rate,
        force_n=force_n,
        force_raw=np.concatenate([block.force_raw for block in blocks]),
        motor_command_v=volts,
        encoder_count=count,
        encoders=_encoders(config),
        force_info=_force_info(config, timing),
        camera=_camera(config, timing, (n - 1) / rate),
        blow_start_s=command.blow_start_s,
    )


def _encoders(config: RigConfig) -> tuple[EncoderInfo, ...]:
    return tuple(
        EncoderInfo(e.name, e.counts_per_revolution, e.sign, e.counter, e.u_scale_relative) for e in config.encoders
    )


def _force_info(config: RigConfig, timing: Timing) -> ForceInfo:
    force = config.force
    return ForceInfo(
        sensor=force.sensor,
        calibration=force.calibration,
        electrical=force.electrical,
        physical_n=force.physical_n,
        electrical_unit=force.electrical_unit,
        channel=force.channel,
        excitation_v=force.excitation_v,
        group_delay_s=timing.force_group_delay_s,
        u_group_delay_s=force.u_group_delay_s,
        u_noise_n=force.u_noise_n,
        u_gain_relative=force.u_gain_relative,
        preload_n=force.preload_n,
        u_preload_n=force.u_preload_n,
        mains_frequency_hz=config.mains_frequency_hz,
    )


def _camera(config: RigConfig, timing: Timing, end_s: float) -> CameraInfo | None:
    if config.camera is None or timing.frame_rate_hz is None or timing.first_pulse_s is None:
        return None
    exposure_s = config.camera.exposure_s
    # a frame counts when its exposure ended within the record
    frames = int(np.floor((end_s - timing.first_pulse_s - exposure_s) * timing.frame_rate_hz + 1e-9)) + 1
    return CameraInfo(
        frame_rate_hz=timing.frame_rate_hz,
        first_frame_time_s=timing.first_pulse_s + exposure_s / 2,
        exposure_s=exposure_s,
        n_frames=max(frames, 0),
        u_time_s=config.camera.u_time_s,
    )
