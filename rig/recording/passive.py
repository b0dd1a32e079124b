"""Recording without a motor: somebody plays, each stroke is cut out of the stream and sealed as a trial.

A stroke begins ``pre_s`` before the sample at which the force has left its level before by ``trigger_n``, or the key
has turned by ``trigger_rad``, for 2 ms. It ends when every encoder has been still for ``rest_s``, the force as well,
and the key is where it was: a key held down goes on, and a finger that stays on the key ends nothing. Levels are means
over the quiet time before, so that a drifting cell does not play. Pure, so that a journal gives the same strokes again.

The motor is put at 0 V, the drive stays disabled and no motor task exists; so neither permission nor self-test is
asked. All samples go through the journal of the next trial, which begins afresh while nobody plays: a program that is
killed loses no stroke, ``watch`` sees the bench alive, and neither memory nor disk fill up.
"""

from __future__ import annotations

import json
from collections import deque
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from rig.backend import CALM_BLOCK_S, Backend, Block, Timing
from rig.configuration.motor_command import MotorCommand
from rig.configuration.rig_file import Rig, RigConfig, load_rig
from rig.errors import RigInputError
from rig.keywords import make_options
from rig.recording.begin_session import new_session
from rig.recording.clock_watch import ClockWatch
from rig.recording.options import Progress, RecordingKeywords, RecordingOptions
from rig.recording.provenance import trial_provenance
from rig.recording.seal_trials import Stroke, seal_cut
from rig.recording.trial_plan import MAX_TRIALS
from rig.recording.trial_run import LATE_S, close_journal, reason_of, status_of
from rig.safety.interlocks import SUSTAINED_S
from rig.safety.interrupts import defer_interrupts, termination_as_interrupt
from rig.session.folder import Session, Trial
from rig.session.info import PASSIVE, FileInfo, PlanInfo, restore_info, take_same_fields
from rig.session.journal_writer import JournalWriter
from rig.session.trial_head import TrialHead

SMOOTH_S = 0.01  # of a mean of the force, by which a stroke ends: noise is divided by seven
BACK = 2.0  # times ``trigger_rad``, within which the key is back


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
    def from_rig(cls, config: RigConfig, rate_hz: float) -> StrokeSettings:
        """Limits by which a stroke played by hand begins and ends, from ``[passive]`` and ``[recording]`` of the rig
        file; ``rate_hz``: the sample rate that the device gave."""
        return take_same_fields(
            cls,
            config.passive,
            rate_hz=rate_hz,
            rad_per_count=tuple(abs(encoder.rad_per_count) for encoder in config.encoders),
            rest_s=config.recording.rest_s,
            rest_n=max(config.recording.rest_force_n, config.passive.trigger_n / 2),
        )

    def to_text(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> StrokeSettings:
        """Restore settings; raises TypeError, ValueError or KeyError for anything else."""
        return restore_info(cls, dict(json.loads(text)))


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
        # a detector that begins here must settle, and a trigger is looked for within the block before
        return max(self._end - max(self._pre, self._rest) - self._sustained, self._quiet_from or 0)

    @property
    def playing(self) -> bool:
        return self._begun is not None

    @property
    def is_settled(self) -> bool:
        """Whether it is quiet or a stroke is under way: what was played since is found."""
        return self.playing or self._quiet_from is not None

    def add(self, block: Block) -> Stroke | None:
        """Take the next block of the stream; return the stroke that it ends (first sample, trigger and end, numbered in
        the stream, and why it ended), or None."""
        new = block.force_n.size
        self._force = np.concatenate((self._force, block.force_n))
        self._count = np.concatenate((self._count, block.encoder_count))
        self._end = block.first_sample + new
        ended = None
        if self._begun is not None:
            ended = self._finish_at_rest()
        elif self._quiet_from is None:
            if self._is_still():
                self._settle()
        elif not self._find_trigger(new):
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

    def _find_trigger(self, new: int) -> bool:
        """Return whether in the ``new`` newest samples force or key have left their level of before for 2 ms; if so,
        note first sample and trigger of the stroke that begins."""
        force_n, count = self._level
        at = max(self._force.size - new - self._sustained + 1, 0)
        is_beyond = np.abs(self._force[at:] - force_n) > self._s.trigger_n
        is_beyond |= np.abs((self._count[at:, 0] - count[0]) * self._rad[0]) > self._s.trigger_rad
        runs = np.convolve(is_beyond, np.ones(self._sustained, dtype=int), "valid") == self._sustained
        if not runs.any():
            return False
        trigger = self._end - self._force.size + at + int(np.argmax(runs))
        self._begun, self._quiet_from = (self._pre_from(trigger), trigger), None
        return True

    def _finish_at_rest(self) -> Stroke | None:
        """Return the stroke under way if it has ended, at rest with the key back, or because it is too long, and wait
        for the next one; None while it goes on."""
        assert self._begun is not None
        first, trigger = self._begun
        back = np.abs((self._count[-1, 0] - self._level[1][0]) * self._rad[0]) <= BACK * self._s.trigger_rad
        if self._end - trigger >= self._rest and back and self._is_still():
            self._begun = None
            self._settle()
            return Stroke(first, trigger, self._end, "complete")
        if self._end - trigger > self._s.longest_s * self._s.rate_hz:
            self._begun = None
            return Stroke(first, trigger, self._end, "not at rest")
        return None

    def _is_still(self) -> bool:
        """Whether over the last ``rest_s`` every encoder stayed in a range of ``still_rad`` and the force, as means
        over 10 ms, in one of ``rest_n``; False while there are fewer samples."""
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


ROTATE_S = 10.0  # without a stroke, after which a journal is begun afresh: it stays below some megabytes


def record_passive(
    out: str | Path,
    *,
    strokes: int | None = None,
    duration_s: float | None = None,
    **keywords: Unpack[RecordingKeywords],
) -> Session:
    """Record in a new session folder the strokes that somebody plays on the key, the motor off; end after ``strokes``
    of them, or ``duration_s`` of the device's time, without either by Ctrl-C. Return the session.

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
    options = make_options(RecordingOptions, "rig.record_passive", keywords)
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
    def __init__(self, session: Session, backend: Backend, config: RigConfig, options: RecordingOptions) -> None:
        self._session, self._backend, self._options = session, backend, options
        self._config = config.model_copy(update={"camera": None, "watchdog": None})  # nothing moves, nothing is filmed
        self._recent: deque[Block] = deque()
        self._journal: _Journal | None = None
        self._number = 1
        self._began = datetime.now(UTC)
        self._clocks = ClockWatch(options.wall_s, options.now_s)

    def run(self, max_strokes: int, duration_s: float) -> None:
        """Record until ``max_strokes`` strokes are sealed or ``duration_s`` of the device's time have passed; then stop
        the bench, seal the stroke under way, and raise what ended the recording early."""
        backend, config = self._backend, self._config
        error: BaseException | None = None
        with termination_as_interrupt():
            try:
                timing = backend.configure(config, None)
                settings = StrokeSettings.from_rig(config, timing.sample_rate_hz)
                detector = StrokeDetector(settings)
                self._open_journal(timing, settings)
                backend.arm(enable_drive=False)
                self._began = datetime.now(UTC)
                backend.start()
                self._record_strokes(timing, settings, detector, max_strokes, duration_s)
            except BaseException as ended:
                error = ended
            with defer_interrupts():
                outputs = "outputs safe"
                try:
                    backend.safe_stop()
                except BaseException as fault:  # nothing may keep the stroke under way from being sealed
                    error, outputs = error or fault, f"OUTPUTS NOT CONFIRMED SAFE, cut the drive's power: {fault}"
                if self._journal is not None:
                    self._end_stroke(detector.finish(), error)
        if isinstance(error, KeyboardInterrupt):
            error.add_note(outputs)
        if error is not None:
            raise error

    def _record_strokes(
        self, timing: Timing, settings: StrokeSettings, detector: StrokeDetector, max_strokes: int, duration_s: float
    ) -> None:
        """Read blocks into the journal and seal each stroke, until there are ``max_strokes`` or the time is over."""
        rate = timing.sample_rate_hz
        shortest = max(
            int(round(self._config.recording.block_s * rate)), int(np.ceil(timing.shortest_block_s * rate)), 1
        )
        calm = max(shortest, int(CALM_BLOCK_S * rate))
        read, sealed = 0, 0
        while sealed < max_strokes and read / rate < duration_s:
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
            self._report_progress(block, committed, rate)
            if stroke is not None:
                with defer_interrupts():
                    late = f"not at rest {settings.longest_s:g} s after it began (passive.longest_s)"
                    trial = self._seal_stroke(stroke, stroke.status, "" if stroke.status == "complete" else late)
                    sealed += 1
                    if sealed < max_strokes:
                        self._open_journal(timing, settings)
                if self._options.after_trial is not None:
                    self._options.after_trial(trial)
            elif not detector.playing and self._journal.samples > ROTATE_S * rate:
                self._drop_journal()
                self._open_journal(timing, settings)

    def _report_progress(self, block: Block, committed: int, rate: float) -> None:
        if self._options.feed is not None:
            self._options.feed.publish(block)
        if self._options.progress is not None:
            peak, time_s = float(np.max(np.abs(block.force_n))), (block.first_sample + block.force_n.size) / rate
            trials = self._session.info.plan.trials
            self._options.progress(Progress(self._number, trials, time_s, time_s, peak, committed / rate))

    def _open_journal(self, timing: Timing, settings: StrokeSettings) -> None:
        """Open the journal file of the next trial and write to it the recent blocks that may belong to a stroke under
        way; its head holds ``settings``, from which a recovery finds the stroke again."""
        command = MotorCommand(np.zeros(2), settings.pre_s, settings.pre_s)
        head = TrialHead.from_rig(
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

    def _seal_stroke(self, stroke: Stroke, status: str, reason: str) -> Trial:
        """Close the journal, seal ``stroke``, its samples numbered in the stream, as the session's next trial with this
        status and reason, and remove the journal; return the trial."""
        assert self._journal is not None
        journal, self._journal = self._journal, None
        failed = close_journal(journal.writer, status, reason)
        if failed is not None:
            raise failed
        base = journal.base
        cut = Stroke(stroke.first - base, stroke.trigger - base, stroke.end - base, status)
        trial = seal_cut(self._session, journal.writer.path, cut, status, reason)
        journal.writer.remove()
        self._number += 1
        if jump := self._clocks.jump():
            self._session.annotate(trial.number, "note", jump, author="recorder")
        return trial

    def _end_stroke(self, stroke: Stroke | None, error: BaseException | None) -> None:
        """At the end of the recording seal the stroke under way, with status and reason from ``error``, or as
        ``interrupted`` without one; where there is no stroke remove the journal."""
        if stroke is None:
            self._drop_journal()
        elif error is None:
            self._seal_stroke(stroke, "interrupted", "the recording ended during this stroke")
        else:
            self._seal_stroke(stroke, status_of(error), reason_of(error))
