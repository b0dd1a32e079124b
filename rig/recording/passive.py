"""Recording without a motor: somebody plays, each stroke is cut out of the stream and sealed as a trial.

The motor is put at 0 V, the drive stays disabled and no motor task exists; so neither permission nor self-test is
asked. All samples go through the journal of the next trial, which begins afresh while nobody plays: a program that is
killed loses no stroke, ``watch`` sees the bench alive, and neither memory nor disk fill up.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Unpack

import numpy as np

from rig.backend import Backend, Block, Timing
from rig.configuration.profile import MotorCommand
from rig.configuration.rig_file import Rig, RigConfig, load_rig
from rig.errors import RigInputError
from rig.recording.options import Progress, RecordingKeywords, RecordingOptions
from rig.recording.sealing import (
    PASSIVE,
    ClockWatch,
    Cut,
    new_session,
    seal_cut,
    trial_provenance,
)
from rig.recording.strokes import Stroke, StrokeDetector, StrokeSettings
from rig.recording.trial_plan import MAX_TRIALS
from rig.recording.trial_run import LATE_S, closed, reason_of, status_of
from rig.safety.interrupts import deferred, termination_as_interrupt
from rig.session.folder import Session, Trial
from rig.session.info import FileInfo, PlanInfo
from rig.session.journal.trial_head import TrialHead
from rig.session.journal.writer import JournalWriter

CALM_BLOCK_S = 0.1
"""Length of a block while nobody plays."""
ROTATE_S = 10.0
"""A journal in which nobody has played for so long is begun afresh."""


def record_passive(
    out: str | Path,
    *,
    strokes: int | None = None,
    duration_s: float | None = None,
    **keywords: Unpack[RecordingKeywords],
) -> Session:
    """Record what somebody plays.

    Parameters
    ----------
    out : path
        Session folder to create; must not exist, or be empty.
    strokes, duration_s : int, float, optional
        End after so many strokes, or so much time of the device, s; a stroke under way is waited for no longer. Without
        either it ends with Ctrl-C.
    **keywords
        ``rig_config``, ``backend``, ``operator``, ``action_name``, ``action``, ``room``, ``notes``, ``progress``,
        ``after_trial``, ``feed``, ``open_journal``, ``now_s`` and ``wall_s`` as for
        :func:`rig.recording.recorder.record`. The rig file's ``[passive]`` says what a stroke is.

    Returns
    -------
    Session

    Raises
    ------
    RigInputError
        Bad rig file, limits or path; nothing is left behind.
    HardwareFault
        The bench stopped; strokes sealed so far and the one under way are kept.
    KeyboardInterrupt
        The operator stopped; likewise.

    Examples
    --------
    >>> import rig
    >>> session = rig.record_passive("sessions/played", strokes=2, backend="sim://?hand=plays")
    >>> [trial.number for trial in session.trials]
    [1, 2]
    """
    options = RecordingOptions(**keywords)
    if strokes is not None and not 1 <= strokes <= MAX_TRIALS:
        raise RigInputError(f"strokes = {strokes}, allowed 1 to {MAX_TRIALS}")
    if duration_s is not None and not 0 < duration_s < float("inf"):
        raise RigInputError(f"duration_s = {duration_s:g}, allowed above 0")
    rig = options.rig_config if isinstance(options.rig_config, Rig) else load_rig(options.rig_config)
    with new_session(out, options, rig) as (backend, create):
        session = create(
            {},
            profile=FileInfo(name=PASSIVE),
            plan=PlanInfo(trials=strokes or MAX_TRIALS),
            notes={"recording": "passive: somebody played, the motor was at 0 V"},
        )
        _Stream(session, backend, rig.config, options).run(strokes or MAX_TRIALS, duration_s or float("inf"))
    return session


@dataclass(eq=False)
class _Journal:
    """The journal of the next trial, which begins at sample ``base`` of the stream."""

    writer: JournalWriter
    base: int
    samples: int = 0

    def append(self, block: Block) -> int:
        self.samples += block.force_n.size
        return self.writer.append(replace(block, first_sample=block.first_sample - self.base))


class _Stream:
    """The stream of one recording."""

    def __init__(self, session: Session, backend: Backend, config: RigConfig, options: RecordingOptions) -> None:
        self._session, self._backend, self._options = session, backend, options
        self._config = config.model_copy(update={"camera": None, "watchdog": None})  # nothing moves, nothing is filmed
        self._recent: deque[Block] = deque()
        self._journal: _Journal | None = None
        self._number = 1
        self._began = datetime.now(UTC)
        self._clocks = ClockWatch(options.wall_s, options.now_s)

    def run(self, most: int, duration_s: float) -> None:
        """Record until ``most`` strokes are sealed or ``duration_s`` has passed."""
        backend, config = self._backend, self._config
        error: BaseException | None = None
        with termination_as_interrupt():
            try:
                timing = backend.configure(config, None)
                settings = StrokeSettings.of(config, timing.sample_rate_hz)
                detector = StrokeDetector(settings)
                self._open_journal(timing, settings)
                backend.arm(enable_drive=False)
                self._began = datetime.now(UTC)
                backend.start()
                self._follow(timing, settings, detector, most, duration_s)
            except BaseException as ended:
                error = ended
            with deferred():
                outputs = "outputs safe"
                try:
                    backend.safe_stop()
                except BaseException as fault:  # nothing may keep the stroke under way from being sealed
                    error, outputs = error or fault, f"OUTPUTS NOT CONFIRMED SAFE, cut the drive's power: {fault}"
                if self._journal is not None:
                    self._end(detector.finish(), error)
        if isinstance(error, KeyboardInterrupt):
            error.add_note(outputs)
        if error is not None:
            raise error

    def _follow(
        self, timing: Timing, settings: StrokeSettings, detector: StrokeDetector, most: int, duration_s: float
    ) -> None:
        rate = timing.sample_rate_hz
        shortest = max(
            int(round(self._config.recording.block_s * rate)), int(np.ceil(timing.shortest_block_s * rate)), 1
        )
        calm = max(shortest, int(CALM_BLOCK_S * rate))
        read, sealed = 0, 0
        while sealed < most and read / rate < duration_s:
            # nothing moves that a limit could stop: what nobody plays is read in few calls
            size = shortest if detector.playing else calm
            block = self._backend.read_block(size, size / rate + LATE_S)
            read += size
            assert self._journal is not None
            committed = self._journal.base + self._journal.append(block)
            self._recent.append(block)
            stroke = detector.add(block)
            while self._recent[0].first_sample + self._recent[0].force_n.size <= detector.needed_from:
                self._recent.popleft()
            self._tell(block, committed, rate)
            if stroke is not None:
                with deferred():
                    late = f"not at rest {settings.longest_s:g} s after it began (passive.longest_s)"
                    trial = self._seal(stroke, stroke.status, "" if stroke.status == "complete" else late)
                    sealed += 1
                    if sealed < most:
                        self._open_journal(timing, settings)
                if self._options.after_trial is not None:
                    self._options.after_trial(trial)
            elif not detector.playing and self._journal.samples > ROTATE_S * rate:
                self._drop_journal()
                self._open_journal(timing, settings)

    def _tell(self, block: Block, committed: int, rate: float) -> None:
        if self._options.feed is not None:
            self._options.feed.publish(block)
        if self._options.progress is not None:
            peak, time_s = float(np.max(np.abs(block.force_n))), (block.first_sample + block.force_n.size) / rate
            trials = self._session.info.plan.trials
            self._options.progress(Progress(self._number, trials, time_s, time_s, peak, committed / rate))

    def _open_journal(self, timing: Timing, settings: StrokeSettings) -> None:
        """Begin the journal of the next trial with what may belong to it already."""
        command = MotorCommand(np.zeros(2), settings.pre_s, settings.pre_s)
        head = TrialHead.of(
            self._config, timing, command, number=self._number, simulated=self._backend.capabilities.simulated
        )
        origin = trial_provenance(self._session.info, self._backend.capabilities, self._config, None)
        most = int((2 * ROTATE_S + settings.pre_s + settings.longest_s) * settings.rate_hz)
        base = self._recent[0].first_sample if self._recent else 0
        began = self._began + timedelta(seconds=base / settings.rate_hz)  # by the device's clock
        head = replace(
            head,
            started_utc=began.isoformat(timespec="milliseconds"),
            provenance={**origin, PASSIVE: settings.to_text()},
        )
        path = self._session.journal_path(self._number)
        blocks = most // max(int(self._config.recording.block_s * settings.rate_hz), 1)
        self._journal = _Journal(self._options.open_journal(path, head, most, blocks), base)
        for block in self._recent:
            self._journal.append(block)

    def _drop_journal(self) -> None:
        assert self._journal is not None
        self._journal.writer.close("empty", "nobody played")
        self._journal.writer.remove()
        self._journal = None

    def _seal(self, stroke: Stroke, status: str, reason: str) -> Trial:
        assert self._journal is not None
        journal, self._journal = self._journal, None
        failed = closed(journal.writer, status, reason)
        if failed is not None:
            raise failed
        cut = Cut(stroke.first - journal.base, stroke.trigger - journal.base, stroke.end - journal.base)
        trial = seal_cut(self._session, journal.writer.path, cut, status, reason)
        journal.writer.remove()
        self._number += 1
        if jump := self._clocks.jump():
            self._session.annotate(trial.number, "note", jump, author="recorder")
        return trial

    def _end(self, stroke: Stroke | None, error: BaseException | None) -> None:
        """Seal the stroke under way as what ended it, or drop the journal of silence."""
        if stroke is None:
            self._drop_journal()
        elif error is None:
            self._seal(stroke, "interrupted", "the recording ended during this stroke")
        else:
            self._seal(stroke, status_of(error), reason_of(error))
