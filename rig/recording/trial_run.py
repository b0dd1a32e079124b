"""One trial on a backend: quiet, blow, rest; whatever happens the bench is made safe and the data acquired are stored.

The result is the trial's data with a status, and the exception that ended it, if any. A block is in the journal before
any observer receives it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.backend import Backend, Block, Timing
from rig.configuration.motor_command import MotorCommand
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault, SamplesLost
from rig.recording.options import RecordingOptions
from rig.recording.progress import Progress
from rig.recording.rest_detector import RestDetector
from rig.safety.interlocks import Interlocks
from rig.safety.interrupts import deferred
from rig.session.journal.trial_head import TrialHead
from rig.session.journal.writer import JournalWriter
from rig.session.trial_data import TrialData

LATE_S = 0.2
"""How long a block may be late where there is no watchdog: without a sample clock the motor holds its last voltage."""
LATE_IN_TIMEOUT = 0.76
"""How long a block may take with a watchdog, in its timeout: the driver's buffer keeps 20 s, but the watchdog, which is
reset only by data, ends the trial sooner."""


@dataclass(frozen=True, eq=False)
class PlannedTrial:
    """One trial to be recorded: its number (of ``trials``), command, journal, condition and entry of the plan."""

    number: int
    trials: int
    command: MotorCommand
    journal_path: Path
    condition: str = ""
    plan_entry: int = 0


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """Data of a trial (None without a sample), the exception that ended it early, its journal, the reason."""

    data: TrialData | None
    error: BaseException | None
    journal: JournalWriter | None = None
    reason: str = ""


def run_trial(backend: Backend, config: RigConfig, trial: PlannedTrial, options: RecordingOptions) -> TrialOutcome:
    """Record one trial; never raises for what happens on the bench, the outcome carries it.

    The closed journal stays on disk: the caller removes it once the trial is sealed.
    """
    blocks: list[Block] = []
    status, reason = "fault", ""
    error: BaseException | None = None
    head: TrialHead | None = None
    journal: JournalWriter | None = None
    command = trial.command
    try:
        timing = backend.configure(config, command.volts)
        head = TrialHead.of(
            config, timing, command,
            number=trial.number, simulated=backend.capabilities.simulated,
            condition=trial.condition, plan_entry=trial.plan_entry,
        )  # fmt: skip
        size, longest = _lengths(config, command, timing)
        interlocks = Interlocks(config, timing, command.volts, command.blow_start_s)
        journal = options.open_journal(trial.journal_path, head, longest + size, longest // size + 2)
        backend.arm()
        backend.start()

        def store(block: Block) -> None:
            blocks.append(block)
            committed = journal.append(block)
            interlocks.check(block)
            if options.feed is not None:
                options.feed.publish(block)
            if options.progress is not None:
                peak = float(np.max(np.abs(block.force_n)))
                rate, read = timing.sample_rate_hz, block.first_sample + block.force_n.size
                options.progress(
                    Progress(trial.number, trial.trials, read / rate, command.blow_end_s, peak, committed / rate)
                )

        status = _read_until_rest(backend, config, command, timing, store)
        _check_sample_count(backend, sum(block.force_n.size for block in blocks))
        if status == "complete" or trial.number < trial.trials:
            interlocks.check_returned()  # or there is no further blow
    except KeyboardInterrupt as interrupt:
        status, reason, error = "interrupted", str(interrupt) or "stopped by the operator", interrupt
    except BaseException as fault:
        status, reason, error = "fault", _one_line(fault), fault
    finally:
        try:
            with deferred():
                try:
                    backend.safe_stop()
                except HardwareFault as fault:
                    reason = "; ".join(filter(None, (reason, _one_line(fault))))
                    status, error = "fault", error or fault
                if status == "not at rest":
                    reason = f"not at rest {config.recording.longest_s:g} s after the blow"
                if journal is not None:
                    try:
                        journal.close(status, reason)
                    except HardwareFault as fault:
                        if error is None:
                            status, reason, error = "fault", _one_line(fault), fault
        except KeyboardInterrupt as late:  # it came while the bench was made safe: the trial stays as it is
            error = error or late
    if not blocks or head is None:
        if journal is not None:
            journal.remove()
        return TrialOutcome(None, error, reason=reason)
    return TrialOutcome(head.assemble(blocks, status, reason), error, journal, reason)


def _check_sample_count(backend: Backend, stored: int) -> None:
    """Compare the number of samples stored with the driver's own count, where the backend reports one.

    Raises SamplesLost when a task has handed out more or fewer samples than are stored.
    """
    for name, (handed_out, acquired) in backend.read_positions().items():
        if handed_out != stored or acquired < stored:
            raise SamplesLost(
                f"{name}: the driver has acquired {acquired} and handed out {handed_out} samples per channel, {stored} "
                "are stored; samples are missing or doubled"
            )


def _lengths(config: RigConfig, command: MotorCommand, timing: Timing) -> tuple[int, int]:
    """Return samples per block, and of the longest trial."""
    rate, recording = timing.sample_rate_hz, config.recording
    size = max(int(round(recording.block_s * rate)), int(np.ceil(timing.shortest_block_s * rate)), 1)
    return size, command.volts.size + int(np.ceil(recording.longest_s * rate))


def _read_until_rest(
    backend: Backend, config: RigConfig, command: MotorCommand, timing: Timing, store: Callable[[Block], None]
) -> str:
    rate, recording = timing.sample_rate_hz, config.recording
    size, longest = _lengths(config, command, timing)
    detector = RestDetector(
        window=int(np.ceil(recording.rest_s * rate)),
        earliest=command.volts.size + int(np.ceil(timing.force_group_delay_s * rate)),
        baseline=int(command.blow_start_s * rate),
        counts=recording.rest_counts,
        force_n=recording.rest_force_n,
    )
    read = 0
    late_s = LATE_S if config.watchdog is None else LATE_IN_TIMEOUT * config.watchdog.timeout_s - size / rate
    while True:
        block = backend.read_block(size, size / rate + late_s)
        store(block)
        read += size
        if detector.add(block.force_n, block.encoder_count):
            return "complete"
        if read >= longest:
            return "not at rest"


def _one_line(error: BaseException) -> str:
    text = f"{type(error).__name__}: {error}".replace("\0", " ")  # HDF5 text cannot hold a null
    return " ".join(text.split())
