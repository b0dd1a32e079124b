"""The options of a recording: one frozen record, made once, handed down unchanged to the single trial."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from rig.backend import Backend
from rig.configuration.profile import Profile
from rig.configuration.rig_file import Rig
from rig.recording.feed import BlockFeed
from rig.recording.progress import Progress
from rig.recording.trial_plan import Plan
from rig.safety.dry_run import Predict
from rig.safety.permission import Permission
from rig.session.folder import Trial
from rig.session.info import ActionInfo, RoomInfo
from rig.session.journal.writer import JournalWriter, OpenJournal


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
    trials: int = 5
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
