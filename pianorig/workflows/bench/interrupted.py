"""What Ctrl-C did to a recording: the outputs, the trial under way, and where the session is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pianorig.console.failures import Interrupted, how_stopped
from rig import RigInputError, Session
from rig.recording.sealing import PASSIVE


@contextmanager
def interrupts_told(folder: Path, *, resumed: bool = False) -> Iterator[None]:
    """Turn Ctrl-C during a recording into ``folder`` into a message that says what it did.

    Raises
    ------
    Interrupted : in place of KeyboardInterrupt
    """
    others = folder.is_dir() and any(folder.iterdir()) and not resumed  # the recorder would have refused it
    try:
        yield
    except KeyboardInterrupt as interrupt:
        outputs = "; ".join(getattr(interrupt, "__notes__", ()))  # added by rig.recording.trial_run
        left = "nothing was recorded" if others else _left(folder)
        told = [how_stopped(interrupt), *([outputs] if outputs else []), left]
        raise Interrupted("; ".join(told)) from interrupt


def _left(folder: Path) -> str:
    """What the recording left in its folder."""
    if not folder.is_dir():
        return "nothing was recorded and no session was made"
    try:
        session = Session.open(folder, require_trials=False)
        trials, journals = session.trials, session.journals
        states = [trial.status for trial in trials]
    except RigInputError as problem:
        return f"session at {folder} cannot be read ({problem})"
    if journals:
        return f"trial {max(journals)} is in its journal, seal it with  pianorig recover {folder}; session at {folder}"
    if not trials:
        return f"no trial was recorded; session at {folder}"
    last, planned = trials[-1].number, session.info.plan.trials
    unplanned = session.info.profile.name == PASSIVE or session.info.kind == "felt"
    lacking = 0 if unplanned else planned - states.count("complete")
    more = f", {lacking} of {planned} trials to go: pianorig record --resume {folder}" if lacking > 0 else ""
    return f"trial {last} sealed as {states[-1]}; session at {folder}{more}"
