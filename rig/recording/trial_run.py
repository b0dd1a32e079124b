"""One trial on a backend: quiet, blow, rest; whatever happens the bench is made safe and what was recorded is kept.

Place in the data flow: recorder → this → backend and journal; returns the trial's data with a status, and the
exception that ended it, if any. A block is in the journal before anybody is told of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block, Timing
from rig.configuration.profile import Profile
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault, InputError, SamplesLost
from rig.recording.feed import BlockFeed
from rig.recording.interlocks import Interlocks, rms_force_n
from rig.recording.interrupts import deferred
from rig.recording.rest import RestDetector
from rig.recording.trial_description import trial_head
from rig.session.journal import JournalWriter
from rig.session.records import TrialData
from rig.session.trial_head import TrialHead

LATE_S = 0.2
"""How long a block may be late before the motor is stopped, which holds its volts when the clock stands still."""


@dataclass(frozen=True)
class Progress:
    """Where the recording is: trial of trials, time in the trial, and the largest force of the last block.

    What lies before ``committed_s`` is in the journal and survives whatever happens to the program.
    """

    trial: int
    trials: int
    time_s: float
    blow_end_s: float
    peak_force_n: float
    committed_s: float = 0.0
    left_s: float | None = None
    """Time left for all trials, s; None as long as it is not known."""


class OpenJournal(Protocol):
    """Creates the journal of a trial: path, head, largest number of samples and of blocks."""

    def __call__(self, path: Path, head: TrialHead, most_samples: int, most_blocks: int) -> JournalWriter:
        """Create it."""
        ...


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """Data of a trial (None when not one sample came), its journal, and what ended it early, with its one line."""

    data: TrialData | None
    error: BaseException | None
    journal: JournalWriter | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class MotorCommand:
    """Volts for a whole trial: quiet zeros, then the profile; ends at 0 V."""

    volts: NDArray[np.float64]
    blow_start_s: float
    blow_end_s: float


def motor_command(profile: Profile, config: RigConfig) -> MotorCommand:
    """Check a profile against the rig's limits and turn it into volts on the sample clock.

    Raises
    ------
    InputError
        When the profile exceeds the limits of force, slew rate or output voltage.
    """
    rate, motor = config.device.sample_rate_hz, config.motor
    profile.check_limits(motor.force_limit_n, motor.slew_limit_n_per_s, rate)
    force_n = profile.sample(rate)
    heating_n = rms_force_n(force_n, rate, motor.rms_over_s)
    if heating_n > motor.rms_force_limit_n:
        raise InputError(
            f"{profile.source or profile.name}: RMS force {heating_n:.3g} N over {motor.rms_over_s:g} s heats the "
            f"motor, allowed {motor.rms_force_limit_n:g} N; shorten the profile or raise motor.rms_force_limit_n"
        )
    volts = force_n / motor.force_per_volt_n
    if np.max(np.abs(volts)) > motor.voltage_limit_v:
        raise InputError(f"{profile.name}: needs {np.max(np.abs(volts)):g} V, allowed {motor.voltage_limit_v:g} V")
    quiet = int(np.ceil(config.recording.quiet_s * rate))
    whole = np.concatenate((np.zeros(quiet), volts))
    start_s = quiet / rate
    return MotorCommand(whole, start_s + profile.onset_s, start_s + profile.duration_s)


def run_trial(
    backend: Backend,
    config: RigConfig,
    command: MotorCommand,
    number: int,
    trials: int,
    journal_path: Path,
    *,
    condition: str = "",
    entry: int = 0,
    progress: Callable[[Progress], None] | None = None,
    feed: BlockFeed | None = None,
    open_journal: OpenJournal = JournalWriter,
) -> TrialOutcome:
    """Record one trial; never raises for what happens on the bench, the outcome carries it.

    The journal at ``journal_path`` is closed but still there: the caller removes it once the trial is sealed.
    """
    blocks: list[Block] = []
    status, reason = "fault", ""
    error: BaseException | None = None
    head: TrialHead | None = None
    journal: JournalWriter | None = None
    try:
        timing = backend.configure(config, command.volts)
        head = trial_head(config, timing, command.volts, command.blow_start_s, backend.capabilities.simulated, number)
        head = replace(head, condition=condition, plan_entry=entry)
        size, longest = _lengths(config, command, timing)
        interlocks = Interlocks(config, timing, command.volts, command.blow_start_s)
        journal = open_journal(journal_path, head, longest + size, longest // size + 2)
        backend.arm()
        backend.start()

        def keep(block: Block) -> None:
            blocks.append(block)
            committed = journal.append(block)
            interlocks.check(block)
            if feed is not None:
                feed.publish(block)
            if progress is not None:
                peak = float(np.max(np.abs(block.force_n)))
                rate, read = timing.sample_rate_hz, block.first_sample + block.force_n.size
                progress(Progress(number, trials, read / rate, command.blow_end_s, peak, committed / rate))

        status = _read_until_rest(backend, config, command, timing, keep)
        _prove_whole(backend, sum(block.force_n.size for block in blocks))
        if status == "complete" or number < trials:
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
        except KeyboardInterrupt as late:  # it came while the bench was made safe: the trial is kept as it is
            error = error or late
    if not blocks or head is None:
        if journal is not None:
            journal.remove()
        return TrialOutcome(None, error, reason=reason)
    return TrialOutcome(head.assemble(blocks, status, reason), error, journal, reason)


def _prove_whole(backend: Backend, stored: int) -> None:
    """Hold what is stored against the driver's own count of samples, where the backend can tell it.

    Raises
    ------
    SamplesLost
        When a task has handed out more or fewer samples than are stored.
    """
    positions = getattr(backend, "read_positions", dict)
    for name, (handed_out, acquired) in positions().items():
        if handed_out != stored or acquired < stored:
            raise SamplesLost(
                f"{name}: the driver has acquired {acquired} and handed out {handed_out} samples per channel, {stored} "
                "are stored; samples are missing or doubled"
            )


def _lengths(config: RigConfig, command: MotorCommand, timing: Timing) -> tuple[int, int]:
    """Return samples per block, and of the longest trial."""
    rate, recording = timing.sample_rate_hz, config.recording
    size = max(int(round(recording.block_s * rate)), 1)
    return size, command.volts.size + int(np.ceil(recording.longest_s * rate))


def _read_until_rest(
    backend: Backend, config: RigConfig, command: MotorCommand, timing: Timing, keep: Callable[[Block], None]
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
    while True:
        block = backend.read_block(size, size / rate + LATE_S)
        keep(block)
        read += size
        if detector.add(block.force_n, block.encoder_count):
            return "complete"
        if read >= longest:
            return "not at rest"


def _one_line(error: BaseException) -> str:
    text = f"{type(error).__name__}: {error}".replace("\0", " ")  # HDF5 text cannot hold a null
    return " ".join(text.split())
