"""Where the strokes of a player begin and end in a stream of samples: force or key leave their rest, and are back.

A stroke begins ``pre_s`` before the sample at which the force has left its level before by ``trigger_n``, or the key
has turned by ``trigger_rad``, for 2 ms. It ends when every encoder has been still for ``rest_s``, the force as well,
and the key is where it was: a key held down goes on, and a finger that stays on the key ends nothing. Levels are means
over the quiet time before, so that a drifting cell does not play. Pure, so that a journal gives the same strokes again.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block
from rig.configuration.rig_file import RigConfig

SUSTAINED_S = 2e-3
"""How long a trigger must hold: a spike on a wire is no stroke."""
SMOOTH_S = 0.01
BACK = 2.0
"""The key is back within so many times ``trigger_rad``."""


@dataclass(frozen=True)
class StrokeSettings:
    """What a stroke is; ``rad_per_count`` of the key, whippen and hammer (signs do not matter)."""

    rate_hz: float
    rad_per_count: tuple[float, ...]
    pre_s: float
    rest_s: float
    rest_n: float
    trigger_n: float
    trigger_rad: float
    still_rad: float
    longest_s: float

    @classmethod
    def of(cls, config: RigConfig, rate_hz: float) -> StrokeSettings:
        """Return the settings of a rig file."""
        passive, recording = config.passive, config.recording
        return cls(
            rate_hz,
            tuple(abs(encoder.rad_per_count) for encoder in config.encoders),
            pre_s=passive.pre_s,
            rest_s=recording.rest_s,
            rest_n=max(recording.rest_force_n, passive.trigger_n / 2),
            trigger_n=passive.trigger_n,
            trigger_rad=passive.trigger_rad,
            still_rad=passive.still_rad,
            longest_s=passive.longest_s,
        )

    def to_text(self) -> str:
        """Return the settings as JSON, for the head of a journal."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> StrokeSettings:
        """Restore settings; raises TypeError, ValueError or KeyError for anything else."""
        plain = json.loads(text)
        return cls(**{**plain, "rad_per_count": tuple(plain["rad_per_count"])})


@dataclass(frozen=True)
class Stroke:
    """A stroke: samples from ``first`` up to ``end``, ``trigger`` among them, and why it ended.

    ``status`` is ``complete``, ``not at rest`` (longer than ``longest_s``) or ``interrupted``.
    """

    first: int
    trigger: int
    end: int
    status: str


class StrokeDetector:
    """Follows a stream block by block; keeps only the samples of the longest window."""

    def __init__(self, settings: StrokeSettings) -> None:
        self._s = settings
        self._rad = np.array(settings.rad_per_count)
        rate = settings.rate_hz
        self._rest, self._pre = int(np.ceil(settings.rest_s * rate)), int(np.ceil(settings.pre_s * rate))
        self._sustained = max(int(round(SUSTAINED_S * rate)), 1)
        self._force, self._count = np.empty(0), np.empty((0, len(self._rad)), dtype=np.int64)
        self._end = 0
        self._quiet_from: int | None = None
        """Since when it is quiet; None before the first rest, and during a stroke."""
        self._level: tuple[float, NDArray[np.float64]] = (0.0, np.zeros(len(self._rad)))
        self._begun: tuple[int, int] | None = None
        """First sample and trigger of the stroke under way."""

    @property
    def needed_from(self) -> int:
        """First sample of the stream that a stroke under way, or the next one, may need."""
        if self._begun is not None:
            return self._begun[0]
        return max(self._end - self._pre, 0) if self._quiet_from is None else self._pre_from(self._end)

    @property
    def playing(self) -> bool:
        """Whether a stroke is under way."""
        return self._begun is not None

    def add(self, block: Block) -> Stroke | None:
        """Take the next samples; return the stroke that they end, if any."""
        new = block.force_n.size
        self._force = np.concatenate((self._force, block.force_n))
        self._count = np.concatenate((self._count, block.encoder_count))
        self._end = block.first_sample + new
        ended = None
        if self._begun is not None:
            ended = self._ended()
        elif self._quiet_from is None:
            if self._still():
                self._settle()
        elif not self._triggered(new):
            self._update_level()
        keep = max(self._rest, self._pre) + self._sustained
        self._force, self._count = self._force[-keep:], self._count[-keep:]
        return ended

    def finish(self) -> Stroke | None:
        """End the stream; return the stroke that is under way, if any."""
        if self._begun is None:
            return None
        (first, trigger), self._begun = self._begun, None
        return Stroke(first, trigger, self._end, "interrupted")

    def _pre_from(self, trigger: int) -> int:
        assert self._quiet_from is not None
        return max(self._quiet_from, trigger - self._pre)

    def _triggered(self, new: int) -> bool:
        force_n, count = self._level
        at = max(self._force.size - new - self._sustained + 1, 0)
        moved = np.abs(self._force[at:] - force_n) > self._s.trigger_n
        moved |= np.abs((self._count[at:, 0] - count[0]) * self._rad[0]) > self._s.trigger_rad
        runs = np.convolve(moved, np.ones(self._sustained, dtype=int), "valid") == self._sustained
        if not runs.any():
            return False
        trigger = self._end - self._force.size + at + int(np.argmax(runs))
        self._begun, self._quiet_from = (self._pre_from(trigger), trigger), None
        return True

    def _ended(self) -> Stroke | None:
        assert self._begun is not None
        first, trigger = self._begun
        back = np.abs((self._count[-1, 0] - self._level[1][0]) * self._rad[0]) <= BACK * self._s.trigger_rad
        if self._end - trigger >= self._rest and back and self._still():
            self._begun = None
            self._settle()
            return Stroke(first, trigger, self._end, "complete")
        if self._end - trigger > self._s.longest_s * self._s.rate_hz:
            self._begun = None
            return Stroke(first, trigger, self._end, "not at rest")
        return None

    def _still(self) -> bool:
        """Whether encoders and force have kept their values for ``rest_s``."""
        if self._force.size < self._rest:
            return False
        if np.any(np.ptp(self._count[-self._rest :], axis=0) * self._rad > self._s.still_rad):
            return False
        n = max(int(SMOOTH_S * self._s.rate_hz), 1)
        window = self._force[-self._rest :]
        mean = window[window.size % n :].reshape(-1, n).mean(axis=1)
        return bool(np.ptp(mean) <= self._s.rest_n)

    def _settle(self) -> None:
        """From the last ``rest_s`` on it is quiet."""
        self._quiet_from = self._end - self._rest
        self._update_level()

    def _update_level(self) -> None:
        assert self._quiet_from is not None
        n = min(self._end - self._quiet_from, self._pre, self._force.size)
        self._level = float(self._force[-n:].mean()), self._count[-n:].mean(axis=0)
