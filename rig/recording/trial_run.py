"""The trials of a session, from its beginning to their sealed files.

A journal becomes a sealed file part by part: a long trial never is in memory as a whole. Recorder and recovery both
seal trials here, so that a recovered trial is the one that would have been sealed. Here too: how a session is begun,
and what every trial file says of its own origin, so that it stands alone: who, what, with which devices and programs.

A trial is quiet, blow, rest; whatever happens the bench is made safe and the data are stored. The result of one is a
journal, the trial's status, and the exception that ended it, if any. A block is in the journal before any observer
receives it; no sample is kept in memory. The action is at rest again when each encoder stays within ±``counts`` of one
value for a whole window, and the force's mean over the window is within a band about its mean over the quiet time
before the blow. A body that rests slightly off its first position (friction) is at rest all the same.

Recorder and resume record the entries of a plan one after the other. Before a condition with a prompt the operator is
asked; between blows the bench rests as long as the plan says; a warm-up blow is recorded and rejected. What ends a
trial early ends the session: earlier trials and the marked one stay, the exception goes on.
"""

from __future__ import annotations

import contextlib
import functools
import platform
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block, Capabilities, Timing, check_contract, open_backend
from rig.configuration.profile import MotorCommand, Profile, motor_command
from rig.configuration.rig_file import Rig, RigConfig
from rig.errors import HardwareFault, NotPermitted, RecordingFault, RigInputError, SamplesLost
from rig.recording.options import Progress, RecordingOptions, TimeLeft
from rig.recording.trial_plan import Entry, reject_warm_up
from rig.safety.interlocks import Interlocks
from rig.safety.interrupts import deferred, termination_as_interrupt
from rig.session.annotation_file import utc_now
from rig.session.folder import Session, Trial
from rig.session.info import ActionInfo, FileInfo, RoomInfo, SessionInfo
from rig.session.journal import Journal, JournalWriter, TrialHead, scan_journal, stored_blocks
from rig.session.trial_data import TrialData


@contextlib.contextmanager
def new_session(
    out: str | Path, options: RecordingOptions, rig: Rig
) -> Iterator[tuple[Backend, Callable[..., Session]]]:
    """Open the backend of ``options`` where it is an address, and give it with what creates the session of a rig file.

    That takes the copies to keep beside ``session.toml`` and, as keywords, what this kind of session states of itself
    (:class:`SessionInfo`). At the end what was opened here is closed; a session in which nothing was recorded leaves no
    folder behind, one that was there before stays, empty.
    """
    folder, given = Path(out), options.backend
    existed, made = folder.is_dir(), list[Session]()
    backend = open_backend(given, rig.config) if isinstance(given, str) else given

    def create(copies: Mapping[str, str], **stated: Any) -> Session:
        common: dict[str, Any] = {
            "name": folder.name,
            "operator": options.operator,
            "created_utc": utc_now(),
            "simulated": backend.capabilities.simulated,
            "action": options.action or ActionInfo(name=options.action_name),
            "rig": FileInfo(name=rig.config.name, copy_name="rig.toml", sha256=rig.sha256),
            "room": options.room or RoomInfo(),
            "backend": {"name": backend.capabilities.name, **backend.capabilities.description},
            "software": software_versions(),
        }
        notes = {**(options.notes or {}), **stated.pop("notes", {})}
        info = SessionInfo(**{**common, **stated, "notes": notes})
        made.append(Session.create(out, info, {"rig.toml": rig.text, **copies}))
        return made[0]

    check_contract(backend)
    try:
        yield backend, create
    except BaseException:
        if isinstance(given, str):
            with deferred(), contextlib.suppress(HardwareFault):
                backend.close()  # the first fault is the one to report
        raise
    else:
        if isinstance(given, str):
            backend.close()
    finally:
        for session in made:
            with deferred():
                if not session.trials and not session.journals and existed:
                    for path in session.path.iterdir() if session.path.is_dir() else ():
                        path.unlink()
                elif not session.trials and not session.journals:
                    shutil.rmtree(session.path, ignore_errors=True)


PACKAGES = ("piano-action-rig", "numpy", "h5py", "nidaqmx", "grpcio")
JUMP_S = 1.0
"""A wall clock that goes wrong by more against the monotonic one has been set."""


def software_versions() -> dict[str, str]:
    """Return versions of Python, the operating system and the packages a recording depends on."""
    return {"python": platform.python_version(), "system": platform.platform(), **_package_versions()}


@functools.cache  # they are read from files, 20 ms with every trial otherwise; a running program's do not change
def _package_versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def trial_provenance(
    info: SessionInfo, capabilities: Capabilities, config: RigConfig, profile: Profile | None
) -> dict[str, str]:
    """Return the origin of a trial that begins now, by name; what is not known is ``unknown`` or left out.

    Devices come with serial numbers where the driver gives them, software as it runs now: a session may be resumed
    with other versions than it began with.
    """
    force = config.force.certificate
    calibrated = {"force": force, **{f"encoder_{e.name}": e.certificate for e in config.encoders}}
    calibrated |= {channel.name: channel.certificate for channel in config.channels}
    return {
        "session": info.name,
        "operator": info.operator,
        "action": info.action.name,
        "action_key": info.action.key,
        "rig": info.rig.name,
        "rig_sha256": info.rig.sha256,
        **({} if profile is None else {"profile": profile.name, "profile_sha256": profile.sha256}),
        "device": config.device.name,
        "backend": capabilities.name,
        **{f"backend_{key}": value for key, value in capabilities.description.items()},
        **{f"calibration_date_{name}": c.date for name, c in calibrated.items() if c is not None},
        **{f"software_{package}": found for package, found in software_versions().items()},
    }


class ClockWatch:
    """Compares the computer's wall clock with its monotonic one; both are read by ``wall_s`` and ``monotonic_s``."""

    def __init__(self, wall_s: Callable[[], float], monotonic_s: Callable[[], float]) -> None:
        self._wall_s, self._monotonic_s = wall_s, monotonic_s
        self._off_s = wall_s() - monotonic_s()

    def jump(self) -> str:
        """Return in words by how much the wall clock was set since the last call; empty where it was not."""
        off_s = self._wall_s() - self._monotonic_s()
        jump_s, self._off_s = off_s - self._off_s, off_s
        if abs(jump_s) <= JUMP_S:
            return ""
        return (
            f"the computer's clock went {'forward' if jump_s > 0 else 'back'} by {abs(jump_s):.1f} s; times of day "
            "before and after do not compare, the samples' times are those of the device and not affected"
        )


PART_SAMPLES = 5_000


@dataclass(frozen=True)
class Stroke:
    """A stroke: samples from ``first`` up to ``end``, noticed at ``trigger``, and why it ended.

    ``status`` is ``complete``, ``not at rest`` (longer than ``longest_s``) or ``interrupted``.
    """

    first: int
    trigger: int
    end: int
    status: str


def seal_journal(session: Session, file: Path, scanned: Journal, status: str, reason: str) -> Trial:
    """Seal the trial whose journal was scanned; the journal stays.

    A warm-up blow is rejected first: it never counts, whenever the program ends.
    """
    head = scanned.head
    if head is None or not scanned.n_samples:
        raise RigInputError(f"{file}: has no samples")
    about = replace(
        head.part((), 0),
        status=status,
        reason=reason,
        camera=head.camera(stored_blocks(file, scanned), scanned.n_samples),
    )
    reject_warm_up(session, about)
    return session.add_trial_parts(about, scanned.n_samples, _joined(head, stored_blocks(file, scanned)))


NOTICED_LATE_S = 0.05
"""A stroke begins at most so long before it is noticed, by far: the force has to reach the trigger."""


def seal_cut(session: Session, file: Path, cut: Stroke, status: str, reason: str) -> Trial:
    """Seal a stroke that was cut out of a journal: its first sample is time zero, its start time is shifted along."""
    scanned = scan_journal(file)
    head = scanned.head
    end = min(cut.end, scanned.n_samples)
    if head is None or end <= cut.first:
        raise RigInputError(f"{file}: has no samples")
    rate = head.sample_rate_hz
    started = datetime.fromisoformat(head.started_utc) + timedelta(seconds=cut.first / rate)
    head = replace(
        head,
        started_utc=started.isoformat(timespec="milliseconds"),
        blow_start_s=max((cut.trigger - cut.first) / rate - NOTICED_LATE_S, 0.0),
    )
    about = replace(head.part((), 0), status=status, reason=reason)
    blocks = _inside(stored_blocks(file, scanned), cut.first, end)
    return session.add_trial_parts(about, end - cut.first, _joined(head, blocks))


def _inside(blocks: Iterator[Block], first: int, end: int) -> Iterator[Block]:
    """Yield the samples from ``first`` up to ``end``, numbered from 0."""
    for block in blocks:
        low, high = max(first - block.first_sample, 0), min(end - block.first_sample, block.force_n.size)
        if low >= high:
            continue
        values = block.channel_values
        yield Block(
            block.first_sample + low - first,
            block.force_n[low:high],
            block.force_raw[low:high],
            block.encoder_count[low:high],
            None,
            None if values is None else values[low:high],
        )


def _joined(head: TrialHead, blocks: Iterator[Block]) -> Iterator[TrialData]:
    waiting: list[Block] = []
    first = samples = 0
    for block in blocks:
        waiting.append(block)
        samples += block.force_n.size
        if samples - first >= PART_SAMPLES:
            yield head.part(waiting, first)
            waiting, first = [], samples
    if waiting:
        yield head.part(waiting, first)


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
    show = options.progress
    timed = None if show is None else lambda at: show(replace(at, left_s=clock.left_s()))
    observed = replace(options, progress=timed)
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
            sealed_so_far = there + number - first_number
            found = len(session.trials) if session.path.is_dir() else 0
            if found < sealed_so_far or not session.path.is_dir():
                raise RecordingFault(
                    f"{session.path}: {sealed_so_far} trials were sealed here, {found} are left: the folder was "
                    "deleted, moved or unmounted while it was recorded; nothing else is kept elsewhere, record into "
                    "another folder",
                    phase="write",
                )
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
    """Seal a trial from its journal; a failure to seal it is reported together with what had ended the trial."""
    try:
        return seal_journal(session, journal, scan_journal(journal), status, reason)
    except RigInputError as failure:
        if journal.exists():
            advice = f"{failure}; its journal is kept: free some space, then run  pianorig recover {session.path}"
        else:
            advice = f"{journal}: was deleted while it was recorded; the samples of this trial are lost"
        raise RecordingFault("; ".join(filter(None, (reason, advice))), phase="write") from failure


def _nobody(entry: Entry) -> NotPermitted:
    return NotPermitted(
        f"condition {entry.condition} asks the operator: {entry.prompt!r}, and nobody can be asked; record it at a "
        "terminal, or take the prompt out of the plan"
    )
