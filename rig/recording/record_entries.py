"""Record the entries of a plan one after the other, and seal each trial.

Before a condition with a prompt the operator is asked; between blows the bench rests as long as the plan says; a
warm-up blow is recorded and rejected. What ends a trial early ends the session: earlier trials and the marked one stay,
the exception goes on.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rig.backend import Backend
from rig.configuration.motor_command import motor_command
from rig.configuration.rig_file import RigConfig
from rig.errors import NotPermitted, RecordingFault, RigInputError
from rig.recording.clock_watch import ClockWatch
from rig.recording.options import RecordingOptions, TimeLeft
from rig.recording.provenance import trial_provenance
from rig.recording.seal_trials import seal_journal
from rig.recording.trial_plan import Entry
from rig.recording.trial_run import PlannedTrial, TrialOutcome, run_trial
from rig.safety.interrupts import defer_interrupts, termination_as_interrupt
from rig.session.folder import Session, Trial
from rig.session.journal_records import scan_journal


def record_entries(
    session: Session,
    backend: Backend,
    config: RigConfig,
    entries: Sequence[Entry],
    options: RecordingOptions,
    *,
    first_number: int = 1,
) -> None:
    """Record a plan's entries as trials from ``first_number`` on, with rests and prompts to the operator, and seal each
    in the session; what ends a trial early is raised once that trial is sealed."""
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
            _store_outcome(session, trial, outcome, options)
            if (jump := clocks.jump()) and any(sealed.number == number for sealed in session.trials):
                with contextlib.suppress(RigInputError):  # a note is not worth the session
                    session.annotate(number, "note", jump, author="recorder")
            if outcome.error is not None:
                raise outcome.error
            clock.end()


def _store_outcome(session: Session, trial: PlannedTrial, outcome: TrialOutcome, options: RecordingOptions) -> None:
    """Seal a trial's journal into the session and remove it; or note in the session that the trial did not begin."""
    if outcome.journal is not None:
        with defer_interrupts():
            sealed = seal(session, outcome.journal.path, outcome.status, outcome.reason)
            outcome.journal.remove()
        if outcome.error is None and options.after_trial is not None:
            options.after_trial(sealed)
    elif session.trials:
        with contextlib.suppress(RigInputError):  # the fault itself is raised in any case
            session.annotate(0, "note", f"trial {trial.number} did not begin: {outcome.reason}", author="recorder")


def seal(session: Session, journal: Path, status: str, reason: str) -> Trial:
    """Seal a trial of the session from its journal file, which stays, with this status and reason; where that fails a
    RecordingFault also says what had ended the trial."""
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
