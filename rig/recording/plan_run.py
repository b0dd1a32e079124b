"""Playing the entries of a plan one after the other into a session that exists.

Place in the data flow: recorder and resume → this → :mod:`rig.recording.trial_run` for each blow. Before a condition
that asks for it the operator is prompted; between blows the plan's rest is kept; a warm-up blow is recorded and
rejected. What ends a trial early ends the session: earlier trials and the marked one are kept, the exception goes on.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rig.backend import Backend
from rig.configuration.rig_file import RigConfig
from rig.errors import InputError, NotPermitted, RecordingFault
from rig.recording.feed import BlockFeed
from rig.recording.interrupts import deferred, termination_as_interrupt
from rig.recording.trial_plan import Entry, reject_warm_up
from rig.recording.trial_run import OpenJournal, Progress, motor_command, run_trial
from rig.session import Session, Trial
from rig.session.journal import JournalWriter
from rig.session.records import TrialData


@dataclass(frozen=True)
class Attendance:
    """Who watches, and what is done around the blows.

    Attributes
    ----------
    progress : callable, optional
        Called after each block with a :class:`rig.recording.trial_run.Progress`; an exception in it stops the trial
        safely.
    after_trial : callable, optional
        Called with each sealed trial while the backend is still open, e.g. to save a film.
    feed : BlockFeed, optional
        Bounded feed for a live view.
    ask : callable, optional
        Shows an operator prompt and returns what was typed, None when nobody can be asked.
    open_journal : callable
        Creates each trial's journal; tests put a bad disk here.
    now_s : callable
        Clock of the time left, s.
    """

    progress: Callable[[Progress], None] | None = None
    after_trial: Callable[[Trial], None] | None = None
    feed: BlockFeed | None = None
    ask: Callable[[str], str | None] | None = None
    open_journal: OpenJournal = JournalWriter
    now_s: Callable[[], float] = time.monotonic


def play(
    session: Session,
    backend: Backend,
    config: RigConfig,
    entries: Sequence[Entry],
    first_number: int,
    rest_s: float,
    attendance: Attendance,
) -> None:
    """Record ``entries`` as the trials from ``first_number`` on.

    Raises
    ------
    HardwareFault
        The bench stopped; ``NotPermitted`` when a prompt found nobody.
    KeyboardInterrupt
        The operator stopped.
    """
    prompts = [entry for entry in entries if entry.prompt]
    if prompts and attendance.ask is None:
        raise _nobody(prompts[0])  # before the first blow, not in the middle of the plan
    wait: Callable[[float], None] = getattr(backend, "wait", time.sleep)
    commands = {entry.condition: motor_command(entry.profile, config) for entry in entries}
    last = first_number + len(entries) - 1
    prompted: str | None = None
    clock = _TimeLeft(attendance.now_s, rest_s, len(entries))
    with termination_as_interrupt():
        for number, entry in enumerate(entries, first_number):
            if number > first_number and rest_s:
                wait(rest_s)
            if entry.condition != prompted:
                _prompt(entry, number, attendance)
                prompted = entry.condition
            clock.begin()
            outcome = run_trial(
                backend, config, commands[entry.condition], number, last, session.journal_path(number),
                condition=entry.condition, entry=entry.number if entry.condition else 0,
                progress=_with_time_left(attendance, clock), feed=attendance.feed,
                open_journal=attendance.open_journal,
            )  # fmt: skip
            if outcome.data is not None:
                with deferred():
                    trial = _seal(session, outcome.data)
                    if outcome.journal is not None:
                        outcome.journal.remove()
                if outcome.error is None and attendance.after_trial is not None:
                    attendance.after_trial(trial)
            elif session.trials:
                with contextlib.suppress(InputError):  # the fault itself is raised in any case
                    session.annotate(0, "note", f"trial {number} did not begin: {outcome.reason}", author="recorder")
            if outcome.error is not None:
                raise outcome.error
            clock.end()


def _seal(session: Session, data: TrialData) -> Trial:
    """Seal a trial; what keeps it from being sealed is told together with what had ended it."""
    try:
        reject_warm_up(session, data)  # first: a warm-up blow never counts, whenever the program ends
        return session.add_trial(data)
    except InputError as failure:
        kept = f"{failure}; its journal is kept: free some space, then run  pianorig recover {session.path}"
        raise RecordingFault("; ".join(filter(None, (data.reason, kept))), phase="write") from failure


def _prompt(entry: Entry, number: int, attendance: Attendance) -> None:
    if not entry.prompt:
        return
    question = f"Trial {number}, condition {entry.condition}: {entry.prompt}  Press Enter when done: "
    if attendance.ask is None or attendance.ask(question) is None:
        raise _nobody(entry)


def _nobody(entry: Entry) -> NotPermitted:
    return NotPermitted(
        f"condition {entry.condition} asks the operator: {entry.prompt!r}, and nobody can be asked; record it at a "
        "terminal, or take the prompt out of the plan"
    )


def _with_time_left(attendance: Attendance, clock: _TimeLeft) -> Callable[[Progress], None] | None:
    show = attendance.progress
    if show is None:
        return None
    return lambda at: show(replace(at, left_s=clock.left_s()))


class _TimeLeft:
    """Time left from the time the trials so far have taken, prompts not counted."""

    def __init__(self, now_s: Callable[[], float], rest_s: float, trials: int) -> None:
        self._now_s, self._rest_s, self._trials = now_s, rest_s, trials
        self._done, self._spent_s, self._began_s = 0, 0.0, now_s()

    def begin(self) -> None:
        """A trial begins."""
        self._began_s = self._now_s()

    def end(self) -> None:
        """It has ended."""
        self._spent_s += self._now_s() - self._began_s
        self._done += 1

    def left_s(self) -> float | None:
        """Return the time left, s; None before the first trial has ended."""
        if not self._done:
            return None
        mean_s = self._spent_s / self._done
        after = self._trials - self._done - 1
        return max(mean_s - (self._now_s() - self._began_s), 0.0) + after * (mean_s + self._rest_s)
