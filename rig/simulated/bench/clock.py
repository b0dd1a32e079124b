"""The bench's clock: it just counts, or also waits, so that the bench runs at wall-clock speed or a multiple of it."""

from __future__ import annotations

import time
from collections.abc import Callable

POLL_S = 0.01  # between two looks of a call that waits, or of a bench that follows the wall clock


class VirtualClock:
    paced = False
    """Whether the clock follows the wall clock."""

    def __init__(self) -> None:
        self._now_s = 0.0

    @property
    def now_s(self) -> float:
        return self._now_s

    @property
    def elapsed_s(self) -> float:
        """Time since the clock was made, as a watchdog timer counts it: also while nothing is read, s."""
        return self._now_s

    @property
    def due_s(self) -> float:
        """Time that should have passed by itself when a client only asks what is available, s: a little."""
        return POLL_S

    def begin(self) -> None:
        """Begin an acquisition: time in which nothing ran is not caught up on; here there is none."""

    def advance(self, duration_s: float) -> None:
        self._now_s += duration_s


class PacedClock(VirtualClock):
    """Virtual time that never runs ahead of ``speed`` times the wall clock."""

    paced = True

    def __init__(
        self,
        speed: float = 1.0,
        *,
        wall_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__()
        self._speed = speed
        self._wall_s = wall_s
        self._wait = wait
        self._origin_s = wall_s()

    @property
    def elapsed_s(self) -> float:
        """Wall-clock time, s, slowed down with the bench but never sped up; goes on while nothing is read."""
        return (self._wall_s() - self._origin_s) * min(self._speed, 1.0)

    @property
    def due_s(self) -> float:
        """How far the time is behind the wall clock, s."""
        return max((self._wall_s() - self._origin_s) * self._speed - self._now_s, 0.0)

    def begin(self) -> None:
        """Catch up with the wall clock, so that what follows takes its time."""
        self._now_s = max(self._now_s, (self._wall_s() - self._origin_s) * self._speed)

    def advance(self, duration_s: float) -> None:
        """Add ``duration_s`` to the time, then wait until the wall clock has caught up."""
        self._now_s += duration_s
        ahead_s = self._now_s / self._speed - (self._wall_s() - self._origin_s)
        if ahead_s > 0:
            self._wait(ahead_s)
