"""Progress of a recording: what an observer is told after each block, and the time left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Trial of trials, time in the trial, and the largest force of the last block.

    What was acquired before ``committed_s`` is in the journal and survives whatever happens to the program.
    """

    trial: int
    trials: int
    time_s: float
    blow_end_s: float
    peak_force_n: float
    committed_s: float = 0.0
    left_s: float | None = None
    """Time left for all trials, s; None until it is known."""


class TimeLeft:
    """Estimates the time left from the duration of the trials recorded so far; operator prompts are not counted."""

    def __init__(self, now_s: Callable[[], float], rest_s: float, trials: int) -> None:
        self._now_s, self._rest_s, self._trials = now_s, rest_s, trials
        self._done, self._spent_s, self._began_s = 0, 0.0, now_s()

    def begin(self) -> None:
        """Tell that a trial begins."""
        self._began_s = self._now_s()

    def end(self) -> None:
        """Tell that it has ended."""
        self._spent_s += self._now_s() - self._began_s
        self._done += 1

    def left_s(self) -> float | None:
        """Return the time left, s; None before the first trial has ended."""
        if not self._done:
            return None
        mean_s = self._spent_s / self._done
        after = self._trials - self._done - 1
        return max(mean_s - (self._now_s() - self._began_s), 0.0) + after * (mean_s + self._rest_s)
