"""What is known of a trial before its first sample, and how head and blocks become a trial.

The head opens the journal. Recorder and recovery both assemble trials here, so that a recovered trial is the one that
would have been sealed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block, Timing
from rig.configuration.motor_command import MotorCommand
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault
from rig.session.annotation_file import utc_now
from rig.session.frame_clock import FrameClock
from rig.session.trial_data import CameraInfo, ChannelInfo, EncoderInfo, ForceInfo, TrialData


@dataclass(frozen=True, eq=False)
class TrialHead:
    """Everything of a trial but what the inputs read; ``command_v`` is the whole motor command, V."""

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

    @classmethod
    def of(
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
        """Return the head of trial ``number``, which begins now, from the rig file and the device's timing."""
        return cls(
            number=number,
            started_utc=utc_now(),
            simulated=simulated,
            sample_rate_hz=timing.sample_rate_hz,
            blow_start_s=command.blow_start_s,
            command_v=command.volts,
            encoders=tuple(EncoderInfo.of(encoder) for encoder in config.encoders),
            force_info=ForceInfo.of(config, timing.force_group_delay_s),
            frame_clock=FrameClock.of(config.camera, timing),
            condition=condition,
            plan_entry=plan_entry,
            channels=tuple(ChannelInfo.of(channel) for channel in config.channels),
        )

    def to_plain(self) -> dict[str, Any]:
        """Return all but the command as numbers, text and lists."""
        return {
            "number": self.number,
            "started_utc": self.started_utc,
            "simulated": self.simulated,
            "sample_rate_hz": self.sample_rate_hz,
            "blow_start_s": self.blow_start_s,
            "encoders": [asdict(encoder) for encoder in self.encoders],
            "force_info": asdict(self.force_info),
            "frame_clock": asdict(self.frame_clock) if self.frame_clock else None,
            "condition": self.condition,
            "plan_entry": self.plan_entry,
            "channels": [asdict(channel) for channel in self.channels],
        }

    @classmethod
    def from_plain(cls, plain: dict[str, Any], command_v: NDArray[np.float64]) -> TrialHead:
        """Undo :meth:`to_plain`; raises KeyError, TypeError or ValueError for anything else."""
        force: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in plain["force_info"].items()
        }
        clock = plain["frame_clock"]
        return cls(
            number=int(plain["number"]),
            started_utc=str(plain["started_utc"]),
            simulated=bool(plain["simulated"]),
            sample_rate_hz=float(plain["sample_rate_hz"]),
            blow_start_s=float(plain["blow_start_s"]),
            command_v=command_v,
            encoders=tuple(EncoderInfo(**encoder) for encoder in plain["encoders"]),
            force_info=ForceInfo(**force),
            frame_clock=FrameClock(**clock) if clock else None,
            condition=str(plain.get("condition", "")),
            plan_entry=int(plain.get("plan_entry", 0)),
            channels=tuple(ChannelInfo.from_plain(channel) for channel in plain.get("channels", [])),
        )

    def assemble(self, blocks: Sequence[Block], status: str, reason: str) -> TrialData:
        """Join the blocks to a trial.

        Raises
        ------
        HardwareFault
            When they do not follow each other without a gap from sample 0.
        """
        wanted = 0
        for block in blocks:
            if block.first_sample != wanted:
                raise HardwareFault(
                    f"trial {self.number}: a block starts at sample {block.first_sample}, expected {wanted}; "
                    "samples are missing"
                )
            wanted += block.force_n.size
        rate = self.sample_rate_hz
        volts = np.zeros(wanted)
        volts[: min(wanted, self.command_v.size)] = self.command_v[:wanted]
        return TrialData(
            number=self.number,
            status=status,
            reason=reason,
            started_utc=self.started_utc,
            simulated=self.simulated,
            sample_rate_hz=rate,
            time_s=np.arange(wanted) / rate,
            force_n=np.concatenate([block.force_n for block in blocks]),
            force_raw=np.concatenate([block.force_raw for block in blocks]),
            motor_command_v=volts,
            encoder_count=np.concatenate([block.encoder_count for block in blocks]),
            encoders=self.encoders,
            force_info=self.force_info,
            camera=self._camera(blocks, wanted),
            blow_start_s=self.blow_start_s,
            condition=self.condition,
            plan_entry=self.plan_entry,
            channels=self.channels,
            channel_values=np.concatenate([block.channel_values for block in blocks]) if self.channels else None,
        )

    def _camera(self, blocks: Sequence[Block], wanted: int) -> CameraInfo | None:
        if self.frame_clock is None:
            return None
        if not self.frame_clock.counted:
            return self.frame_clock.frames_until((wanted - 1) / self.sample_rate_hz)
        counts = [block.exposure_count for block in blocks if block.exposure_count is not None]
        if len(counts) != len(blocks) or not counts:
            return None
        return self.frame_clock.frames_counted(np.arange(wanted) / self.sample_rate_hz, np.concatenate(counts))
