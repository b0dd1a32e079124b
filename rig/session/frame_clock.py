"""The frame clock of a trial: from the camera's pulses, or from its counted exposures, to the times of the frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.backend import Timing
from rig.configuration.channels import CameraConfig
from rig.session.trial_data import CameraInfo


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
    def of(cls, camera: CameraConfig | None, timing: Timing) -> FrameClock | None:
        """Return the clock of a configured camera; None without one."""
        if camera is None:
            return None
        if camera.mode == "counted":
            return cls(camera.frame_rate_hz, 0.0, camera.exposure_s, camera.u_time_s, counted=True)
        if timing.frame_rate_hz is None or timing.first_pulse_s is None:
            return None
        return cls(timing.frame_rate_hz, timing.first_pulse_s, camera.exposure_s, camera.u_time_s)

    def frames_counted(self, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> CameraInfo | None:
        """Return the frames of a camera whose exposures were counted at each sample, (n,); None with fewer than three.

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
