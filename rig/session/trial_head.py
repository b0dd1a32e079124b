"""What is known of a trial before its first sample, and how head and blocks become a trial.

Place in the data flow: the head opens the journal; recorder and recovery both put trials together here, so that a
recovered trial is the one that would have been sealed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block
from rig.errors import HardwareFault
from rig.session.records import CameraInfo, ChannelInfo, EncoderInfo, ForceInfo, TrialData


@dataclass(frozen=True)
class FrameClock:
    """The camera's pulses: rate, Hz; first rising edge and exposure, s; standard uncertainty of their times, s."""

    frame_rate_hz: float
    first_pulse_s: float
    exposure_s: float
    u_time_s: float
    counted: bool = False
    """The camera runs by itself; rate and first pulse are nominal, the counted exposures tell the real ones."""

    def frames_counted(self, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> CameraInfo | None:
        """Return the frames whose exposures were counted by each sample, (n,); None with fewer than three.

        The k-th exposure began within the sample interval in which the count passed k. Every straight line through
        all these intervals is possible: the middle one is taken, and the standard uncertainty is that of a time that
        is anywhere between the extreme ones. Where no line fits, the camera was irregular and has no frame clock.
        """
        before = np.concatenate(([0], count[:-1]))
        at = np.flatnonzero(count > before)
        number = (count[at] - 1).astype(float)
        if at.size < 3 or number[-1] <= number[0]:
            return None
        interval_s = float(time_s[1] - time_s[0])
        late_s, early_s = time_s[at], time_s[at] - interval_s
        span = number[-1] - number[0]
        guess_s = np.polyfit(number, late_s - interval_s / 2, 1)[0]
        periods = guess_s + np.linspace(-2.0, 2.0, 801) * interval_s / span
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
        """Return the frames whose exposure ended by ``end_s``."""
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
