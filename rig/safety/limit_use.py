"""How much of its limits a trial has used: the largest force, rate, travel and speed beside what the rig file allows.

For lamps and records; it stops nothing. What ends a trial is :mod:`rig.safety.interlocks`, which computes the same
values from the same samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration.channels import BODIES
from rig.configuration.rig_file import RigConfig
from rig.safety.interlocks import SPEED_OVER_S


@dataclass(frozen=True)
class LimitUse:
    """One limit: the largest value so far, at ``time_s`` of the trial, and what is allowed.

    ``what`` is ``force``, ``force rate``, ``travel`` or ``speed``; of the last two ``where`` is the body that has used
    most. ``share`` is value over limit.
    """

    what: str
    where: str
    value: float
    limit: float
    unit: str
    time_s: float
    share: float


class LimitWatch:
    """The largest values of one trial; stores no samples but the last few.

    Parameters
    ----------
    config : RigConfig
    sample_rate_hz : float
    first_count : ndarray, shape (n_encoders,)
        Counts of the trial's first sample.
    """

    def __init__(self, config: RigConfig, sample_rate_hz: float, first_count: NDArray[np.int64]) -> None:
        self._limits, self._rate = config.limits, sample_rate_hz
        self._rad = np.array([e.sign * 2 * np.pi / e.counts_per_revolution for e in config.encoders])
        self._zero = np.asarray(first_count)
        self._step = max(int(round(SPEED_OVER_S * sample_rate_hz)), 1)
        self._force, self._angle = np.empty(0), np.empty((0, len(BODIES)))
        self._end = 0
        self._most: dict[str, LimitUse] = {}

    def add(self, first_sample: int, force_n: NDArray[np.float64], encoder_count: NDArray[np.int64]) -> None:
        """Take samples; after a gap, rate and speed begin anew."""
        if first_sample != self._end:
            self._force, self._angle = np.empty(0), np.empty((0, len(BODIES)))
        old = self._force.size
        first = first_sample - old
        force = np.concatenate((self._force, force_n))
        angle = np.concatenate((self._angle, (encoder_count - self._zero) * self._rad))
        limits = self._limits
        limit = np.where(force_n < 0, -limits.force_min_n, limits.force_max_n)
        self._note("force", "", force_n, limit, "N", first_sample)
        rate = np.abs(np.diff(force[max(old - 1, 0) :])) * self._rate
        self._note("force rate", "", rate, limits.force_rate_n_per_s, "N/s", first_sample + int(old == 0))
        speed = np.abs(angle[self._step :] - angle[: -self._step]) * (self._rate / self._step)
        for body, name in enumerate(BODIES):
            self._note("travel", name, angle[old:, body], limits.travel_rad[body], "rad", first_sample)
            self._note("speed", name, speed[:, body], limits.speed_rad_per_s[body], "rad/s", first + self._step)
        self._force, self._angle = force[-self._step :], angle[-self._step :]
        self._end = first_sample + force_n.size

    def _note(self, what: str, where: str, values: NDArray[np.float64], limit: object, unit: str, first: int) -> None:
        if not values.size:
            return
        allowed = np.broadcast_to(np.asarray(limit, dtype=float), values.shape)
        share = np.abs(values) / allowed
        at = int(np.argmax(np.where(np.isnan(share), np.inf, share)))  # no number is beyond every limit
        before = self._most.get(what)
        now = float(share[at]) if np.isfinite(share[at]) else np.inf
        if before is None or now > before.share:
            value, limit_here = float(values[at]), float(allowed[at])
            self._most[what] = LimitUse(what, where, value, limit_here, unit, (first + at) / self._rate, now)

    @property
    def uses(self) -> list[LimitUse]:
        """One for each kind of limit that samples were seen for."""
        return list(self._most.values())
