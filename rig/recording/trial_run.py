"""The trials of a session, each quiet, blow, rest; whatever happens the bench is made safe and the data are stored.

The result of one is a journal, the trial's status, and the exception that ended it, if any. A block is in the journal
before any observer receives it; no sample is kept in memory. The action is at rest again when each encoder stays within
±``counts`` of one value for a whole window, and the force's mean over the window is within a band about its mean over
the quiet time before the blow. A body that rests slightly off its first position (friction) is at rest all the same.

Recorder and resume record the entries of a plan one after the other. Before a condition with a prompt the operator is
asked; between blows the bench rests as long as the plan says; a warm-up blow is recorded and rejected. What ends a
trial early ends the session: earlier trials and the marked one stay, the exception goes on.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block, Timing
from rig.configuration.profile import MotorCommand, motor_command
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault, NotPermitted, RecordingFault, RigInputError, SamplesLost
from rig.recording.options import Progress, RecordingOptions, TimeLeft
from rig.recording.sealing import ClockWatch, seal_journal, trial_provenance
from rig.recording.trial_plan import Entry
from rig.safety.interlocks import Interlocks
from rig.safety.interrupts import deferred, termination_as_interrupt
from rig.session.folder import Session, Trial
from rig.session.journal.format import scan_journal
from rig.session.journal.trial_head import TrialHead
from rig.session.journal.writer import JournalWriter


class RestDetector:
    """Examines the last ``window`` samples once sample ``earliest`` has passed; stores only those.

    Parameters
    ----------
    window : int
        Samples that must be at rest.
    earliest : int
        First sample that may belong to the rest.
    baseline : int
        Samples at the beginning of the trial whose mean force is the reference.
    counts : int
        Allowed deviation of each encoder from the middle, counts.
    force_n : float
        Half width of the band for the mean force, N.
    """

    def __init__(self, *, window: int, earliest: int, baseline: int, counts: int, force_n: float) -> None:
        self._window, self._earliest, self._baseline = window, earliest, baseline
        self._counts, self._force_n = counts, force_n
        self._samples = 0
        self._baseline_sum_n = 0.0
        self._recent: deque[tuple[NDArray[np.float64], NDArray[np.int64]]] = deque()

    def add(self, force_n: NDArray[np.float64], encoder_count: NDArray[np.int64]) -> bool:
        """Take the next samples, force (m,) and counts (m, 3); return whether they end a window at rest."""
        if (missing := self._baseline - self._samples) > 0:
            self._baseline_sum_n += float(force_n[:missing].sum())
        self._samples += force_n.shape[0]
        self._recent.append((force_n, encoder_count))
        while sum(force.shape[0] for force, _ in self._recent) - self._recent[0][0].shape[0] >= self._window:
            self._recent.popleft()
        if self._samples < max(self._earliest + self._window, self._baseline):
            return False
        count = np.concatenate([count for _, count in self._recent])[-self._window :]
        if np.any(count.max(axis=0) - count.min(axis=0) > 2 * self._counts):
            return False
        force = np.concatenate([force for force, _ in self._recent])[-self._window :]
        return bool(abs(force.mean() - self._baseline_sum_n / self._baseline) <= self._force_n)


LATE_S = 0.2
"""How long a block may be late where there is no watchdog: without a sample clock the motor holds its last voltage."""
LATE_IN_TIMEOUT = 0.76
"""How long a block may take with a watchdog, in its timeout: the driver's buffer keeps 20 s, but the watchdog, which is
reset only by data, ends the trial sooner."""


@dataclass(frozen=True, eq=False)
class PlannedTrial:
    """One trial to be recorded: its number (of ``trials``), command, journal, place in the plan, and origin."""

    number: int
    trials: int
    command: MotorCommand
    journal_path: Path
    condition: str = ""
    plan_entry: int = 0
    provenance: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """What is in a trial's journal, how it ended, and the exception that ended it early.

    ``journal`` is None, and ``samples`` 0, where the trial has no sample.
    """

    status: str
    reason: str = ""
    error: BaseException | None = None
    journal: JournalWriter | None = None
    samples: int = 0


def run_trial(backend: Backend, config: RigConfig, trial: PlannedTrial, options: RecordingOptions) -> TrialOutcome:
    """Record one trial; never raises for what happens on the bench or in a program, the outcome carries it.

    The samples are in the closed journal, not in memory; the caller seals the trial and removes the journal.
    """
    status, reason, outputs = "defect", "", ""
    error: BaseException | None = None
    journal: JournalWriter | None = None
    read = 0
    command = trial.command
    try:
        timing = backend.configure(config, command.volts)
        head = TrialHead.of(
            config, timing, command,
            number=trial.number, simulated=backend.capabilities.simulated,
            condition=trial.condition, plan_entry=trial.plan_entry,
        )  # fmt: skip
        head = replace(head, provenance=trial.provenance)
        lengths = _Lengths.of(config, command, timing)
        interlocks = Interlocks(config, timing, command.volts, command.blow_start_s)
        written = journal = options.open_journal(
            trial.journal_path, head, lengths.longest + lengths.calm, lengths.longest // lengths.block + 2
        )
        backend.arm()
        backend.start()

        def store(block: Block) -> None:
            nonlocal read
            committed = written.append(block)
            read += block.force_n.size
            interlocks.check(block)
            if options.feed is not None:
                options.feed.publish(block)
            if options.progress is not None:
                peak, rate = float(np.max(np.abs(block.force_n))), timing.sample_rate_hz
                options.progress(
                    Progress(trial.number, trial.trials, read / rate, command.blow_end_s, peak, committed / rate)
                )

        status = _read_until_rest(backend, config, command, timing, store)
        for name, (handed_out, acquired) in backend.read_positions().items():
            if handed_out != read or acquired < read:
                raise SamplesLost(
                    f"{name}: the driver has acquired {acquired} and handed out {handed_out} samples per channel, "
                    f"{read} are stored; samples are missing or doubled"
                )
        if status == "complete" or trial.number < trial.trials:
            interlocks.check_returned()  # or there is no further blow
    except BaseException as ended:
        error, status, reason = ended, status_of(ended), reason_of(ended)
    finally:
        try:
            with deferred():
                outputs = "outputs safe"
                try:
                    backend.safe_stop()
                except BaseException as unsafe:  # nothing may keep the journal from being closed
                    outputs = f"OUTPUTS NOT CONFIRMED SAFE, cut the drive's power: {one_line(unsafe)}"
                    reason = "; ".join(filter(None, (reason, one_line(unsafe))))
                    status, error = status_of(unsafe), error or unsafe
                if status == "not at rest":
                    reason = f"not at rest {config.recording.longest_s:g} s after the blow"
                if journal is not None:
                    failed = closed(journal, status, reason)
                    if error is None and failed is not None:
                        status, reason, error = status_of(failed), one_line(failed), failed
        except KeyboardInterrupt as late:  # it came while the bench was made safe: the trial stays as it is
            error = error or late
    if isinstance(error, KeyboardInterrupt) and outputs:
        error.add_note(outputs)  # for whoever tells the operator what the interrupt did
    if journal is not None and not read:
        journal.remove()
        journal = None
    return TrialOutcome(status, reason, error, journal, read)


def status_of(error: BaseException) -> str:
    """Return the status of a trial that an exception ended: only the bench and the disk have faults."""
    if isinstance(error, HardwareFault):
        return "fault"
    return "defect" if isinstance(error, Exception) else "interrupted"


def reason_of(error: BaseException) -> str:
    """Return why a trial ended early, in one line."""
    if isinstance(error, KeyboardInterrupt):
        return str(error) or "stopped by the operator"
    return one_line(error)


def closed(journal: JournalWriter, status: str, reason: str) -> BaseException | None:
    """Close a journal; return what prevented it."""
    try:
        journal.close(status, reason)
    except Exception as failure:
        return failure
    return None


@dataclass(frozen=True)
class _Lengths:
    """Samples of a block, of one in which the motor's command is 0 V, and of the longest trial.

    A long block is a whole number of short ones, and none is read once the trial may end: where it ends does not
    depend on them.
    """

    block: int
    calm: int
    longest: int
    moves_from: int
    moves_until: int
    may_end: int
    """The command is 0 V before ``moves_from`` and from ``moves_until`` on; the trial lasts until ``may_end``."""

    @classmethod
    def of(cls, config: RigConfig, command: MotorCommand, timing: Timing) -> _Lengths:
        rate, recording = timing.sample_rate_hz, config.recording
        block = max(int(round(recording.block_s * rate)), int(np.ceil(timing.shortest_block_s * rate)), 1)
        moves = np.flatnonzero(command.volts)
        first, last = (int(moves[0]), int(moves[-1]) + 1) if moves.size else (command.volts.size, 0)
        return cls(
            block,
            max(int(timing.calm_block_s * rate * (1 + 1e-9)) // block, 1) * block,
            command.volts.size + int(np.ceil(recording.longest_s * rate)),
            first,
            last,
            _earliest_rest(command, timing) + int(np.ceil(recording.rest_s * rate)),
        )

    def next(self, read: int) -> int:
        """Return how many samples to read next, after ``read`` of the trial."""
        before, behind = read + self.calm <= self.moves_from, read >= self.moves_until
        return self.calm if before or (behind and read + self.calm <= self.may_end) else self.block


def _earliest_rest(command: MotorCommand, timing: Timing) -> int:
    """Return the first sample that may belong to the rest."""
    return command.volts.size + int(np.ceil(timing.force_group_delay_s * timing.sample_rate_hz))


def _read_until_rest(
    backend: Backend, config: RigConfig, command: MotorCommand, timing: Timing, store: Callable[[Block], None]
) -> str:
    rate, recording = timing.sample_rate_hz, config.recording
    lengths = _Lengths.of(config, command, timing)
    detector = RestDetector(
        window=int(np.ceil(recording.rest_s * rate)),
        earliest=_earliest_rest(command, timing),
        baseline=int(command.blow_start_s * rate),
        counts=recording.rest_counts,
        force_n=recording.rest_force_n,
    )
    read = 0
    while True:
        size = lengths.next(read)
        late_s = LATE_S if config.watchdog is None else LATE_IN_TIMEOUT * config.watchdog.timeout_s - size / rate
        block = backend.read_block(size, size / rate + late_s)
        store(block)
        read += size
        if detector.add(block.force_n, block.encoder_count):
            return "complete"
        if read >= lengths.longest:
            return "not at rest"


def one_line(error: BaseException) -> str:
    """Return an exception's type and text in one line."""
    text = f"{type(error).__name__}: {error}".replace("\0", " ")  # HDF5 text cannot hold a null
    return " ".join(text.split())


def record_entries(
    session: Session,
    backend: Backend,
    config: RigConfig,
    entries: Sequence[Entry],
    options: RecordingOptions,
    *,
    first_number: int = 1,
) -> None:
    """Record ``entries`` as the trials from ``first_number`` on, resting as the session's plan says.

    Raises
    ------
    HardwareFault
        The bench stopped; ``NotPermitted`` when a prompt found nobody.
    KeyboardInterrupt
        The operator stopped.
    """
    prompts = [entry for entry in entries if entry.prompt]
    if prompts and options.ask is None:
        raise _nobody(prompts[0])  # before the first blow, not in the middle of the plan
    rest_s = session.info.plan.rest_s
    commands = {entry.condition: motor_command(entry.profile, config) for entry in entries}
    last = first_number + len(entries) - 1
    prompted: str | None = None
    there = len(session.trials)
    clocks = ClockWatch(options.wall_s, options.now_s)
    clock = TimeLeft(options.now_s, rest_s, len(entries))
    observed = _with_time_left(options, clock)
    with termination_as_interrupt():
        for number, entry in enumerate(entries, first_number):
            if number > first_number and rest_s:
                backend.wait(rest_s)
            if entry.condition != prompted:
                question = f"Trial {number}, condition {entry.condition}: {entry.prompt}  Press Enter when done: "
                if entry.prompt and (options.ask is None or options.ask(question) is None):
                    raise _nobody(entry)
                prompted = entry.condition
            if options.before_trial is not None:
                options.before_trial(number)
            clock.begin()
            check_still_there(session, there + number - first_number)
            trial = PlannedTrial(
                number, last, commands[entry.condition], session.journal_path(number),
                entry.condition, entry.number if entry.condition else 0,
                trial_provenance(session.info, backend.capabilities, config, entry.profile),
            )  # fmt: skip
            outcome = run_trial(backend, config, trial, observed)
            _store(session, trial, outcome, options)
            if (jump := clocks.jump()) and any(sealed.number == number for sealed in session.trials):
                with contextlib.suppress(RigInputError):  # a note is not worth the session
                    session.annotate(number, "note", jump, author="recorder")
            if outcome.error is not None:
                raise outcome.error
            clock.end()


def _store(session: Session, trial: PlannedTrial, outcome: TrialOutcome, options: RecordingOptions) -> None:
    if outcome.journal is not None:
        with deferred():
            sealed = seal(session, outcome.journal.path, outcome.status, outcome.reason)
            outcome.journal.remove()
        if outcome.error is None and options.after_trial is not None:
            options.after_trial(sealed)
    elif session.trials:
        with contextlib.suppress(RigInputError):  # the fault itself is raised in any case
            session.annotate(0, "note", f"trial {trial.number} did not begin: {outcome.reason}", author="recorder")


def seal(session: Session, journal: Path, status: str, reason: str) -> Trial:
    """Seal a trial from its journal; a failure to seal it is reported together with what had ended the trial.

    Raises RecordingFault, which says whether the journal is still there.
    """
    try:
        return seal_journal(session, journal, scan_journal(journal), status, reason)
    except RigInputError as failure:
        if journal.exists():
            advice = f"{failure}; its journal is kept: free some space, then run  pianorig recover {session.path}"
        else:
            advice = f"{journal}: was deleted while it was recorded; the samples of this trial are lost"
        raise RecordingFault("; ".join(filter(None, (reason, advice))), phase="write") from failure


def check_still_there(session: Session, sealed: int) -> None:
    """Refuse to go on recording into a folder that was deleted or unmounted, or lost trials that were ``sealed``."""
    found = len(session.trials) if session.path.is_dir() else 0
    if found < sealed or not session.path.is_dir():
        raise RecordingFault(
            f"{session.path}: {sealed} trials were sealed here, {found} are left: the folder was deleted, moved or "
            "unmounted while it was recorded; nothing else is kept elsewhere, record into another folder",
            phase="write",
        )


def _nobody(entry: Entry) -> NotPermitted:
    return NotPermitted(
        f"condition {entry.condition} asks the operator: {entry.prompt!r}, and nobody can be asked; record it at a "
        "terminal, or take the prompt out of the plan"
    )


def _with_time_left(options: RecordingOptions, clock: TimeLeft) -> RecordingOptions:
    show = options.progress
    if show is None:
        return options

    def progress(at: Progress) -> None:
        show(replace(at, left_s=clock.left_s()))

    return replace(options, progress=progress)
