"""The entries of a plan recorded one after the other into a session that exists.

Recorder and resume use it. Before a condition with a prompt the operator is asked; between blows the bench rests as
long as the plan says; a warm-up blow is recorded and rejected. What ends a trial early ends the session: earlier trials
and the marked one stay, the exception goes on.
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
from rig.recording.options import RecordingOptions
from rig.recording.progress import Progress, TimeLeft
from rig.recording.provenance import ClockWatch, trial_provenance
from rig.recording.sealing import seal_recorded
from rig.recording.trial_plan import Entry
from rig.recording.trial_run import PlannedTrial, TrialOutcome, run_trial
from rig.safety.interrupts import deferred, termination_as_interrupt
from rig.session.folder import Session, Trial


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
                _prompt(entry, number, options)
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
            _note_jump(session, number, clocks)
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
        return seal_recorded(session, journal, status, reason)
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


def _note_jump(session: Session, number: int, clocks: ClockWatch) -> None:
    """Note a wall clock that was set during the trial, or the rest before it."""
    if (jump := clocks.jump()) and any(trial.number == number for trial in session.trials):
        with contextlib.suppress(RigInputError):  # a note is not worth the session
            session.annotate(number, "note", jump, author="recorder")


def _prompt(entry: Entry, number: int, options: RecordingOptions) -> None:
    if not entry.prompt:
        return
    question = f"Trial {number}, condition {entry.condition}: {entry.prompt}  Press Enter when done: "
    if options.ask is None or options.ask(question) is None:
        raise _nobody(entry)


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
