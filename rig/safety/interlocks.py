"""Interlocks in software: every block of samples is checked before the next one is read.

:mod:`rig.recording.trial_run` hands in each block once it is in the journal; a value outside the limits raises
:class:`rig.errors.LimitExceeded`, which ends the trial with the motor at 0 V and the drive disabled and becomes the
trial's reason. Checked: force and its rate, travel and speed of each body, sensors that are stuck or open, force
missing while the motor is commanded to push; before the blow: everything still, force near zero, the arm's preload
present (where the unloaded reading is known); after it: encoders back.

This is the second layer only. It acts one block, the force's delay and a round trip after the event, 30 to 50 ms,
longer than a blow takes. The first layer is hardware: torque limit and stop chain of the drive, hard stops,
emergency stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block, Timing
from rig.configuration.rig_file import BODIES, RigConfig
from rig.errors import LimitExceeded

SUSTAINED_S = 2e-3  # that a departure from rest must hold: a spike on a wire is no stroke
SPEED_OVER_S = 1e-3  # over which a speed is a difference: a count of 8192 a turn is then below 1 rad/s
STUCK_OVER_S = 0.01  # in which an encoder is stuck whose count does not change
STUCK_WHILE_RAD = 0.01  # that another body turns meanwhile: both move together in a blow
FORCE_GONE_N = 0.3  # above the baseline, less is no force: choice below what moves a key


class Interlocks:
    """The limits of one trial; stores only the samples the longest window needs.

    Parameters
    ----------
    config : ``limits`` and scales
    timing : rate and force delay
    command_v : (n,) the whole motor command, V
    blow_start_s : when the motor first leaves zero
    """

    def __init__(self, config: RigConfig, timing: Timing, command_v: NDArray[np.float64], blow_start_s: float) -> None:
        self._config, self._limits, self._rate = config, config.limits, timing.sample_rate_hz
        self._command_n = command_v * config.motor.force_per_volt_n
        self._delay = int(np.ceil(timing.force_group_delay_s * self._rate)) + 1
        self._blow = int(blow_start_s * self._rate)
        self._rad = np.array([encoder.rad_per_count for encoder in config.encoders])
        self._keep = self._samples(max(config.recording.rest_s, self._limits.stuck_s, self._limits.no_force_s))
        self._force, self._count = np.empty(0), np.empty((0, len(BODIES)), dtype=np.int64)
        self._zero: NDArray[np.int64] | None = None
        self._baseline_n: float | None = None
        self._noisy = False
        self._since_exposure = 0
        self._exposed = 0

    def check(self, block: Block) -> None:
        """Check the next block of the trial against every limit; raise LimitExceeded, naming channel, value, limit and
        time, and leave it to the caller to stop the bench."""
        if self._zero is None:
            self._zero = block.encoder_count[0].copy()
        old = self._force.size
        self._force = np.concatenate((self._force, block.force_n))
        self._count = np.concatenate((self._count, block.encoder_count))
        first = block.first_sample - old
        self._check_force(first, old)
        self._check_motion(first, old)
        if block.exposure_count is not None:
            self._check_exposures(block, block.exposure_count)
        self._check_stuck(first, old)
        end = block.first_sample + block.force_n.size
        if self._baseline_n is None and end + block.force_n.size > self._blow:
            self._check_before_blow()
        elif self._baseline_n is not None:
            self._check_pushes(first, self._baseline_n)
        self._force, self._count = self._force[-self._keep :], self._count[-self._keep :]

    def check_returned(self) -> None:
        """After the blow refuse, by LimitExceeded, an encoder that is more than ``return_rad`` from where the trial
        began: it lost counts, or a part moved."""
        if self._zero is None:
            return
        off = (self._count[-1] - self._zero) * self._rad
        for body, angle in enumerate(off):
            if abs(angle) > self._limits.return_rad:
                self._stop(
                    f"{BODIES[body]} encoder rests {angle:.4f} rad from where it began, allowed "
                    f"{self._limits.return_rad:g} rad; look for lost counts or a part out of place"
                )

    def _samples(self, duration_s: float) -> int:
        return max(int(round(duration_s * self._rate)), 1)

    def _stop(self, message: str) -> None:
        raise LimitExceeded(message, phase="interlock")

    def _check_force(self, first: int, n_checked: int) -> None:
        """Raise LimitExceeded at a force or rate of force beyond the limits; ``first``: number in the trial of the
        first sample kept, of which ``n_checked`` were checked before."""
        limits, force = self._limits, self._force
        new = force[n_checked:]
        outside = ~((new >= limits.force_min_n) & (new <= limits.force_max_n))  # NaN is outside
        if outside.any():
            at = int(np.argmax(outside))
            at_s = (first + n_checked + at) / self._rate
            self._stop(
                f"{self._config.force.channel}: force {new[at]:.4g} N at {at_s:.4f} s, "
                f"allowed {limits.force_min_n:g} to {limits.force_max_n:g} N; look for overload or an open bridge"
            )
        rate = np.abs(np.diff(force[max(n_checked - 1, 0) :])) * self._rate
        if rate.size and rate.max() > limits.force_rate_n_per_s:
            at_s = (first + n_checked + int(np.argmax(rate))) / self._rate
            self._stop(
                f"{self._config.force.channel}: force changes by {rate.max():.4g} N/s at {at_s:.4f} s, "
                f"allowed {limits.force_rate_n_per_s:g} N/s"
            )

    def _check_motion(self, first: int, n_checked: int) -> None:
        """Raise LimitExceeded at a travel or speed of a body beyond the limits; ``first``: number in the trial of the
        first sample kept, of which ``n_checked`` were checked before."""
        step = self._samples(SPEED_OVER_S)
        since = max(n_checked - step, 0)
        for body, name in enumerate(BODIES):
            angle = (self._count[since:, body] - self._zero[body]) * self._rad[body]  # type: ignore[index]
            beyond = np.abs(angle) > self._limits.travel_rad[body]
            if beyond.any():
                at = int(np.argmax(beyond))
                self._stop(
                    f"{name} encoder: {angle[at]:.4f} rad from rest at {(first + since + at) / self._rate:.4f} s, "
                    f"allowed {self._limits.travel_rad[body]:g} rad"
                )
            speed = np.abs(angle[step:] - angle[:-step]) * (self._rate / step)
            beyond = speed > self._limits.speed_rad_per_s[body]
            if beyond.any():
                at = int(np.argmax(beyond))
                self._stop(
                    f"{name} encoder: {speed[at]:.4g} rad/s at {(first + since + step + at) / self._rate:.4f} s, "
                    f"allowed {self._limits.speed_rad_per_s[body]:g} rad/s"
                )

    def _check_exposures(self, block: Block, count: NDArray[np.int64]) -> None:
        """Raise LimitExceeded where a free-running camera makes no exposure for 1.5 frames, as its film would be
        misread from there on; ``count`` (n,): exposures by each sample of ``block``."""
        camera = self._config.camera
        if camera is None:
            return
        period = self._rate / camera.frame_rate_hz
        line = np.concatenate(([self._exposed], count))
        still = np.concatenate((np.ones(self._since_exposure, dtype=bool), np.diff(line) == 0))
        if longest_run(still) > 1.5 * period + 1:
            self._stop(
                f"{camera.terminal}: no exposure for more than {1.5 / camera.frame_rate_hz * 1e3:.3g} ms before "
                f"{(block.first_sample + count.size) / self._rate:.3f} s; the camera drops frames or is not running"
            )
        exposures = np.flatnonzero(~still)
        self._since_exposure = still.size - 1 - int(exposures[-1]) if exposures.size else still.size
        self._exposed = int(count[-1])

    def _check_stuck(self, first: int, n_checked: int) -> None:
        """Raise LimitExceeded where the force keeps one value too long, or an encoder stands still while another turns;
        ``first``: number in the trial of the first sample kept, of which ``n_checked`` were checked before."""
        need = self._samples(self._limits.stuck_s)
        if self._noisy and longest_run(np.diff(self._force[max(n_checked - need, 0) :]) == 0) >= need:
            self._stop(
                f"{self._config.force.channel}: the same force, {self._force[-1]:.4g} N, for {self._limits.stuck_s:g} s"
                f" about {(first + n_checked) / self._rate:.3f} s, allowed shorter; the input is saturated or stuck"
            )
        span = self._samples(STUCK_OVER_S)
        ends = np.arange(max(n_checked, span), self._force.size + 1, max(span // 2, 1))
        if not ends.size:
            return
        windows = np.lib.stride_tricks.sliding_window_view(self._count, span, axis=0)[ends - span]
        turned = np.ptp(windows, axis=-1)  # of each window and body
        for end, still, moved in zip(ends, turned == 0, turned * np.abs(self._rad), strict=True):
            # key and whippen always move together, and neither far without the hammer's shank
            for body, witness in ((0, 1), (1, 0), (2, 1)):
                if still[body] and moved[witness] > STUCK_WHILE_RAD * (1 if body < 2 else 3):
                    self._stop(
                        f"{BODIES[body]} encoder does not move while the {BODIES[witness]} turns by "
                        f"{moved[witness]:.3f} rad before {(first + end) / self._rate:.4f} s; it is stuck or unplugged"
                    )

    def _check_before_blow(self) -> None:
        """Keep the mean force as the baseline; raise LimitExceeded where the action still moves, the force is out of
        its range, or the arm does not press on the key."""
        self._baseline_n = float(self._force.mean())
        # a cell that had noise before the blow has noise during it
        self._noisy = longest_run(np.diff(self._force) == 0) < self._samples(self._limits.stuck_s)
        still_s = self._config.recording.rest_s
        recent = self._count[-self._samples(still_s) :]
        wander = np.ptp(recent, axis=0)
        worst = int(np.argmax(wander))
        if wander[worst] > 2 * self._config.recording.rest_counts:
            self._stop(
                f"{BODIES[worst]} encoder moved by {wander[worst]} counts in the {still_s:g} s before the blow, "
                f"allowed {2 * self._config.recording.rest_counts}; wait until the action is still"
            )
        low, high = self._limits.baseline_n
        if not low <= self._baseline_n <= high:
            self._stop(
                f"{self._config.force.channel}: force {self._baseline_n:.3g} N before the blow, allowed {low:g} to "
                f"{high:g} N; put the arm on the key and null the bridge"
            )
        unloaded_n, least_n = self._config.force.offset_n, self._limits.least_preload_n
        if unloaded_n is not None and least_n is not None and self._baseline_n - unloaded_n < least_n:
            self._stop(
                f"{self._config.force.channel}: {self._baseline_n - unloaded_n:.3g} N above the unloaded reading of "
                f"{unloaded_n:.3g} N before the blow, allowed from {least_n:g} N; the arm is not on the key"
            )

    def _check_pushes(self, first: int, baseline_n: float) -> None:
        """Raise LimitExceeded where the motor is told to push and no force above ``baseline_n``, N, the mean before the
        blow, comes; ``first``: number in the trial of the first sample kept."""
        n = self._force.size
        commanded_n = np.zeros(n)
        at = first + np.arange(n) - self._delay
        inside = (at >= 0) & (at < self._command_n.size)
        commanded_n[inside] = self._command_n[at[inside]]
        gone = (commanded_n > self._limits.push_n) & (self._force - baseline_n < FORCE_GONE_N)
        if longest_run(gone) > self._samples(self._limits.no_force_s):
            self._stop(
                f"{self._config.force.channel}: no force for {self._limits.no_force_s:g} s before "
                f"{(first + n) / self._rate:.3f} s while the motor was told to push with {commanded_n.max():.3g} N; "
                "the arm has left the key, or drive or load cell are off"
            )


def longest_run(mask: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0
