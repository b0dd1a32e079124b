"""What is known of a trial before its first sample, and makes a trial of blocks.

Recorder and recovery both assemble trials here, so that a recovered trial is the one that would have been sealed. The
frame clock leads from the camera's pulses, or from its counted exposures, to the times of the frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block, Timing
from rig.configuration.motor_command import MotorCommand
from rig.configuration.rig_file import CameraConfig, RigConfig
from rig.errors import HardwareFault
from rig.session.annotation_file import utc_now
from rig.session.info import ChannelInfo, EncoderInfo, ForceInfo, restore_info
from rig.session.trial_data import CameraInfo, TrialData

PERIODS = 801  # of a frame clock that are tried: the interval of a possible one is known to a four-hundredth


@dataclass(frozen=True)
class FrameClock:
    """Clock of the frame pulses: rate, Hz; first rising edge, exposure and standard uncertainty of the times, s."""

    frame_rate_hz: float
    first_pulse_s: float
    exposure_s: float
    u_time_s: float
    counted: bool = False
    """The camera runs by itself; rate and first pulse are nominal, the counted exposures tell the real ones."""

    @classmethod
    def from_camera(cls, camera: CameraConfig | None, timing: Timing) -> FrameClock | None:
        """Clock of a camera: nominal, from its configuration, where frames are counted, else from the recorded pulses;
        None without a camera, or where rate or first pulse was not recorded."""
        if camera is None:
            return None
        if camera.mode == "counted":
            return cls(camera.frame_rate_hz, 0.0, camera.exposure_s, camera.u_time_s, counted=True)
        if timing.frame_rate_hz is None or timing.first_pulse_s is None:
            return None
        return cls(timing.frame_rate_hz, timing.first_pulse_s, camera.exposure_s, camera.u_time_s)

    def frames_counted(self, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> CameraInfo | None:
        """Frame rate and times of a camera that runs by itself, fitted to the number of exposures counted (n,) at times
        (n,), s; None with fewer than three, or where no even clock fits the counts.

        The k-th exposure began within the sample interval in which the count passed k. Every straight line through
        all these intervals is possible: the middle one is taken, and the standard uncertainty is that of a time that
        is anywhere between the extreme ones. Where no line fits, the camera was irregular and has no frame clock. When
        those before the first sample began is not known: a counter without a start trigger counts once it is armed.
        """
        at = np.flatnonzero(np.diff(count, prepend=count[:1]) > 0)
        number = (count[at] - 1).astype(float)
        if at.size < 3 or number[-1] <= number[0]:
            return None
        interval_s = float(time_s[1] - time_s[0])
        late_s, early_s = time_s[at], time_s[at] - interval_s
        span = number[-1] - number[0]
        guess_s = np.polyfit(number, late_s - interval_s / 2, 1)[0]
        periods = guess_s + np.linspace(-2.0, 2.0, PERIODS) * interval_s / span
        lowest = np.array([np.max(early_s - period * number) for period in periods])
        highest = np.array([np.min(late_s - period * number) for period in periods])
        possible = lowest <= highest
        if not possible.any():
            return None
        periods, lowest, highest = periods[possible], lowest[possible], highest[possible]
        ends = [(lowest + periods * k, highest + periods * k) for k in (number[0], number[-1])]
        middle = [(low.min() + high.max()) / 2 for low, high in ends]
        half_s = max((high.max() - low.min()) / 2 for low, high in ends)
        period_s = (middle[1] - middle[0]) / span
        return CameraInfo(
            frame_rate_hz=float(1.0 / period_s),
            first_frame_time_s=float(middle[0] - number[0] * period_s) + self.exposure_s / 2,
            exposure_s=self.exposure_s,
            n_frames=int(count[-1]),
            u_time_s=float(np.hypot(self.u_time_s, half_s / np.sqrt(3.0))),
        )

    def frames_until(self, end_s: float) -> CameraInfo:
        """The camera with the frames (rate, first time, number) whose exposure has ended by ``end_s``, s since the
        start trigger."""
        frames = int(np.floor((end_s - self.first_pulse_s - self.exposure_s) * self.frame_rate_hz + 1e-9)) + 1
        return CameraInfo(
            frame_rate_hz=self.frame_rate_hz,
            first_frame_time_s=self.first_pulse_s + self.exposure_s / 2,
            exposure_s=self.exposure_s,
            n_frames=max(frames, 0),
            u_time_s=self.u_time_s,
        )


@dataclass(frozen=True, eq=False)
class TrialHead:
    """All of a trial except the input samples; ``command_v`` is the whole motor command, V."""

    number: int
    started_utc: str
    simulated: bool
    sample_rate_hz: float
    blow_start_s: float
    command_v: NDArray[np.float64]
    encoders: tuple[EncoderInfo, ...]
    force_info: ForceInfo
    frame_clock: FrameClock | None = None
    condition: str = ""
    plan_entry: int = 0
    channels: tuple[ChannelInfo, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_rig(
        cls,
        config: RigConfig,
        timing: Timing,
        command: MotorCommand,
        *,
        number: int,
        simulated: bool,
        condition: str = "",
        plan_entry: int = 0,
    ) -> TrialHead:
        """Return the head of trial ``number`` (all of a trial but its samples) from rig file, timing and motor command,
        started now; ``plan_entry``: number of the plan's entry, from 1, or 0 without a plan."""
        return cls(
            number=number,
            started_utc=utc_now(),
            simulated=simulated,
            sample_rate_hz=timing.sample_rate_hz,
            blow_start_s=command.blow_start_s,
            command_v=command.volts,
            encoders=tuple(EncoderInfo.from_config(encoder) for encoder in config.encoders),
            force_info=replace(
                ForceInfo.from_config(config, timing.force_group_delay_s), device_scaling=timing.force_device_scaling
            ),
            frame_clock=FrameClock.from_camera(config.camera, timing),
            condition=condition,
            plan_entry=plan_entry,
            channels=(
                *(ChannelInfo.from_config(channel) for channel in config.channels),
                *([ChannelInfo.opposite_head(config)] if config.key_opposite is not None else []),
            ),
        )

    def to_plain(self) -> dict[str, Any]:
        plain = asdict(replace(self, command_v=np.empty(0)))
        del plain["command_v"]
        return plain

    @classmethod
    def from_plain(cls, plain: dict[str, Any], command_v: NDArray[np.float64]) -> TrialHead:
        """Restore a head from the dict of `to_plain` and the motor command (n,), V; KeyError, TypeError or ValueError
        for anything else."""
        clock = plain["frame_clock"]
        return cls(
            number=int(plain["number"]),
            started_utc=str(plain["started_utc"]),
            simulated=bool(plain["simulated"]),
            sample_rate_hz=float(plain["sample_rate_hz"]),
            blow_start_s=float(plain["blow_start_s"]),
            command_v=command_v,
            encoders=tuple(EncoderInfo(**encoder) for encoder in plain["encoders"]),
            force_info=restore_info(ForceInfo, plain["force_info"]),
            frame_clock=FrameClock(**clock) if clock else None,
            condition=str(plain.get("condition", "")),
            plan_entry=int(plain.get("plan_entry", 0)),
            channels=tuple(ChannelInfo.from_plain(channel) for channel in plain.get("channels", [])),
            provenance={str(key): str(value) for key, value in plain.get("provenance", {}).items()},
        )

    def assemble(self, blocks: Sequence[Block], status: str, reason: str) -> TrialData:
        part = self.part(blocks, 0)
        return replace(part, status=status, reason=reason, camera=self.camera(blocks, part.n_valid))

    def part(self, blocks: Sequence[Block], first_sample: int) -> TrialData:
        """Samples of successive ``blocks`` as trial data from ``first_sample`` on, status ``incomplete``, without
        camera; the command is 0 V past its end. HardwareFault where samples are missing."""
        end = first_sample
        for block in blocks:
            if block.first_sample != end:
                raise HardwareFault(
                    f"trial {self.number}: a block starts at sample {block.first_sample}, expected {end}; "
                    "samples are missing"
                )
            end += block.force_n.size
        volts = np.zeros(end - first_sample)
        commanded = self.command_v[first_sample:end]
        volts[: commanded.size] = commanded
        known = {one.name: getattr(self, one.name) for one in fields(self)}
        del known["command_v"], known["frame_clock"]
        joined = blocks or (self._no_samples(first_sample),)
        return TrialData(
            **known,
            status="incomplete",
            time_s=np.arange(first_sample, end) / self.sample_rate_hz,
            raw_force_n=np.concatenate([block.force_n for block in joined]),
            force_raw=np.concatenate([block.force_raw for block in joined]),
            motor_command_v=volts,
            encoder_count=np.concatenate([block.encoder_count for block in joined]),
            channel_values=np.concatenate([block.channel_values for block in joined]) if self.channels else None,
        )

    def _no_samples(self, first_sample: int) -> Block:
        none = np.empty(0)
        values = np.empty((0, len(self.channels))) if self.channels else None
        return Block(first_sample, none, none, np.empty((0, len(self.encoders)), dtype=np.int64), None, values)

    def camera(self, blocks: Iterable[Block], n_samples: int) -> CameraInfo | None:
        """The camera's frames in a trial of ``n_samples``: by the clock pulses it was sent, or, where it runs by
        itself, fitted to the exposures counted in ``blocks``; None without a camera or counts."""
        if self.frame_clock is None:
            return None
        if not self.frame_clock.counted:
            return self.frame_clock.frames_until((n_samples - 1) / self.sample_rate_hz)
        counts = [block.exposure_count for block in blocks]
        if not counts or any(count is None for count in counts):
            return None
        counted = np.concatenate([count for count in counts if count is not None])
        return self.frame_clock.frames_counted(np.arange(n_samples) / self.sample_rate_hz, counted)
