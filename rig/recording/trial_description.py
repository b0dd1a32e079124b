"""What a trial's file says of its channels: the tables of the rig file and the device's timing, as the trial's head.

Place in the data flow: rig file and configured backend → this → :mod:`rig.recording.trial_run`, before the motor moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.backend import Timing
from rig.configuration.channels import CertificateConfig
from rig.configuration.rig_file import RigConfig
from rig.session.annotation_file import utc_now
from rig.session.records import ChannelInfo, EncoderInfo, ForceInfo
from rig.session.trial_head import FrameClock, TrialHead


def trial_head(
    config: RigConfig,
    timing: Timing,
    command_v: NDArray[np.float64],
    blow_start_s: float,
    simulated: bool,
    number: int,
) -> TrialHead:
    """Return the head of trial ``number``, which begins now and plays ``command_v`` (n,), V."""
    return TrialHead(
        number=number,
        started_utc=utc_now(),
        simulated=simulated,
        sample_rate_hz=timing.sample_rate_hz,
        blow_start_s=blow_start_s,
        command_v=command_v,
        encoders=_encoders(config),
        force_info=_force_info(config, timing),
        frame_clock=_frame_clock(config, timing),
        channels=_channels(config),
    )


def _calibration(text: str, certificate: CertificateConfig | None) -> str:
    return "; ".join(filter(None, (text, str(certificate or ""))))


def _channels(config: RigConfig) -> tuple[ChannelInfo, ...]:
    return tuple(
        ChannelInfo(
            name=channel.name,
            quantity=channel.quantity,
            unit=channel.unit,
            sensor=channel.sensor,
            calibration=_calibration(channel.calibration, channel.certificate),
            electrical=channel.electrical,
            physical=channel.physical,
            channel=channel.channel,
            group_delay_s=channel.group_delay_s,
            u_noise=channel.u_noise,
            u_gain_relative=channel.u_gain_relative,
        )
        for channel in config.channels
    )


def _encoders(config: RigConfig) -> tuple[EncoderInfo, ...]:
    return tuple(
        EncoderInfo(
            name=e.name,
            counts_per_revolution=e.counts_per_revolution,
            sign=e.sign,
            channel=e.counter,
            u_scale_relative=e.u_scale_relative,
            u_interpolation_rad=e.u_interpolation_rad,
            u_eccentricity_rad=e.u_eccentricity_rad,
            u_pivot_shift_rad=e.u_pivot_shift_rad,
            calibration=str(e.certificate or ""),
        )
        for e in config.encoders
    )


def _force_info(config: RigConfig, timing: Timing) -> ForceInfo:
    force = config.force
    return ForceInfo(
        sensor=force.sensor,
        calibration=_calibration(force.calibration, force.certificate),
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


def _frame_clock(config: RigConfig, timing: Timing) -> FrameClock | None:
    if config.camera is None:
        return None
    if config.camera.mode == "counted":
        camera = config.camera
        return FrameClock(camera.frame_rate_hz, 0.0, camera.exposure_s, camera.u_time_s, counted=True)
    if timing.frame_rate_hz is None or timing.first_pulse_s is None:
        return None
    return FrameClock(timing.frame_rate_hz, timing.first_pulse_s, config.camera.exposure_s, config.camera.u_time_s)
