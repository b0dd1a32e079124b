"""Record one trial: quiet, blow, rest; whatever happens the bench is made safe and the data are stored.

The result is a journal, the trial's status, and the exception that ended it, if any. A block is in the journal before
any observer receives it; no sample is kept in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rig.backend import Backend, Block, Timing
from rig.configuration.motor_command import MotorCommand
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault, SamplesLost
from rig.recording.options import Progress, RecordingOptions
from rig.recording.rest_detector import RestDetector
from rig.safety.interlocks import Interlocks
from rig.safety.interrupts import defer_interrupts
from rig.session.journal_writer import JournalWriter
from rig.session.trial_head import TrialHead

LATE_S = 0.2  # of a block where there is no watchdog: without a sample clock the motor holds its last voltage
LATE_IN_TIMEOUT = 0.76  # of the watchdog's timeout, that a block may take: data reset it, and it ends the trial first


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
    """Record one trial; what happens on the bench or in a program is not raised but told by the outcome.

    The samples are in the closed journal, not in memory; the caller seals the trial and removes the journal.
    """
    status, reason, outputs = "defect", "", ""
    error: BaseException | None = None
    journal: JournalWriter | None = None
    read = 0
    command = trial.command
    try:
        timing = backend.configure(config, command.volts)
        head = TrialHead.from_rig(
            config, timing, command,
            number=trial.number, simulated=backend.capabilities.simulated,
            condition=trial.condition, plan_entry=trial.plan_entry,
        )  # fmt: skip
        head = replace(head, provenance=trial.provenance)
        lengths = _Lengths.from_command(config, command, timing)
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
            with defer_interrupts():
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
                    failed = close_journal(journal, status, reason)
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
    if isinstance(error, KeyboardInterrupt):
        return str(error) or "stopped by the operator"
    return one_line(error)


def close_journal(journal: JournalWriter, status: str, reason: str) -> BaseException | None:
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
    def from_command(cls, config: RigConfig, command: MotorCommand, timing: Timing) -> _Lengths:
        """Numbers of samples by a motor command: of a block, of a longer one for while it is 0 V, of the longest trial;
        and the samples between which it moves the motor, and from which on the trial may end."""
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

    def next_read(self, read: int) -> int:
        """Return how many samples to read next, after ``read`` of the trial."""
        before, behind = read + self.calm <= self.moves_from, read >= self.moves_until
        return self.calm if before or (behind and read + self.calm <= self.may_end) else self.block


def _earliest_rest(command: MotorCommand, timing: Timing) -> int:
    return command.volts.size + int(np.ceil(timing.force_group_delay_s * timing.sample_rate_hz))


def _read_until_rest(
    backend: Backend, config: RigConfig, command: MotorCommand, timing: Timing, store: Callable[[Block], None]
) -> str:
    """Read and store blocks until the action rests: ``complete``, or ``not at rest`` where that takes too long."""
    rate, recording = timing.sample_rate_hz, config.recording
    lengths = _Lengths.from_command(config, command, timing)
    detector = RestDetector(
        window=int(np.ceil(recording.rest_s * rate)),
        earliest=_earliest_rest(command, timing),
        baseline=int(command.blow_start_s * rate),
        counts=recording.rest_counts,
        force_n=recording.rest_force_n,
    )
    read = 0
    while True:
        size = lengths.next_read(read)
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
