"""The options of a recording: one frozen record, made once, handed down unchanged to the single trial."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from rig.backend import Backend, Block
from rig.configuration.profile import Profile
from rig.configuration.rig_file import RecordingConfig, Rig
from rig.recording.trial_plan import Plan
from rig.safety.dry_run import Predict
from rig.safety.permission import Permission
from rig.session.folder import Trial
from rig.session.info import ActionInfo, RoomInfo
from rig.session.journal_writer import JournalWriter, OpenJournal


@dataclass(frozen=True)
class Progress:
    """Trial of trials, time in the trial, and the largest force of the last block, as it is read.

    What was acquired before ``committed_s`` is in the journal and survives whatever happens to the program.
    """

    trial: int
    trials: int
    time_s: float
    blow_end_s: float
    raw_peak_force_n: float
    committed_s: float = 0.0
    left_s: float | None = None
    """Time left for all trials, s; None until it is known."""


class TimeLeft:
    """Estimates the time left from the duration of the trials recorded so far; operator prompts are not counted."""

    def __init__(self, now_s: Callable[[], float], rest_s: float, trials: int) -> None:
        self._now_s, self._rest_s, self._trials = now_s, rest_s, trials
        self._done, self._spent_s, self._began_s = 0, 0.0, now_s()

    def begin(self) -> None:
        self._began_s = self._now_s()

    def end(self) -> None:
        self._spent_s += self._now_s() - self._began_s
        self._done += 1

    def left_s(self) -> float | None:
        """Return the time left, s; None before the first trial has ended."""
        if not self._done:
            return None
        mean_s = self._spent_s / self._done
        after = self._trials - self._done - 1
        return max(mean_s - (self._now_s() - self._began_s), 0.0) + after * (mean_s + self._rest_s)


class BlockFeed:
    """At most ``capacity`` blocks waiting for a viewer; thread-safe."""

    def __init__(self, capacity: int = round(1 / RecordingConfig().block_s)) -> None:  # blocks: one second
        self._blocks: deque[Block] = deque(maxlen=capacity)
        self._lock = threading.Lock()
        self._dropped = 0

    @property
    def n_dropped(self) -> int:
        """Blocks dropped because no viewer took them in time."""
        return self._dropped

    dropped = n_dropped  # its former name, for one release

    def publish(self, block: Block) -> None:
        """Add a block; returns at once."""
        with self._lock:
            if len(self._blocks) == self._blocks.maxlen:
                self._dropped += 1
            self._blocks.append(block)

    def take(self) -> list[Block]:
        """Remove and return all waiting blocks, oldest first."""
        with self._lock:
            blocks = list(self._blocks)
            self._blocks.clear()
            return blocks


class ResumeKeywords(TypedDict, total=False):
    """Keywords of :func:`rig.recording.resume.resume`: what is not in the session already."""

    progress: Callable[[Progress], None] | None
    before_trial: Callable[[int], None] | None
    after_trial: Callable[[Trial], None] | None
    feed: BlockFeed | None
    ask: Callable[[str], str | None] | None
    open_journal: OpenJournal
    predict: Predict | None
    permission: Permission | None
    now_s: Callable[[], float]
    wall_s: Callable[[], float]


class RecordingKeywords(ResumeKeywords, total=False):
    """Keywords of :func:`rig.recording.recorder.record`."""

    profile: Profile | str | Path
    rig_config: Rig | str | Path
    backend: Backend | str
    trials: int
    plan: Plan | None
    operator: str
    action_name: str
    action: ActionInfo | None
    room: RoomInfo | None
    notes: Mapping[str, str] | None


@dataclass(frozen=True)
class RecordingOptions:
    """What is recorded on which bench, who observes, and what must be in order before anything moves.

    Each field is a keyword of :func:`rig.recording.recorder.record`, where it is described.
    """

    profile: Profile | str | Path = "forte"
    rig_config: Rig | str | Path = "virtual"
    backend: Backend | str = "sim://"
    trials: int = 5  # choice: a scatter known to a third
    plan: Plan | None = None
    operator: str = "unknown"
    action_name: str = "unknown"
    action: ActionInfo | None = None
    room: RoomInfo | None = None
    notes: Mapping[str, str] | None = None
    progress: Callable[[Progress], None] | None = None
    before_trial: Callable[[int], None] | None = None
    after_trial: Callable[[Trial], None] | None = None
    feed: BlockFeed | None = None
    ask: Callable[[str], str | None] | None = None
    open_journal: OpenJournal = JournalWriter
    predict: Predict | None = None
    permission: Permission | None = None
    now_s: Callable[[], float] = time.monotonic
    wall_s: Callable[[], float] = time.time
