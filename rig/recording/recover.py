"""Trials made from the journals that a killed program, a crash or a full disk left behind.

They are marked ``incomplete`` unless the journal has its closing record. A journal is deleted only after its contents
are sealed and read back; one that is damaged in its middle is renamed ``.journal.damaged``, a sealed file that was
damaged while its journal was still there ``.h5.damaged``. A second run changes nothing more.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.errors import RigInputError
from rig.recording.trial_plan import reject_warm_up
from rig.session import Session
from rig.session.journal.format import Journal, read_journal
from rig.session.trial_data import TrialData
from rig.storage import platform_calls
from rig.storage.file_errors import refused


@dataclass(frozen=True)
class Recovered:
    """Outcome of one journal: the trial's status, or ``empty`` or ``unreadable``, its samples, and a note."""

    trial: int
    status: str
    samples: int
    note: str


def recover(path: str | Path) -> list[Recovered]:
    """Recover every trial of a session that was not sealed.

    Parameters
    ----------
    path : path
        Session folder.

    Returns
    -------
    list of Recovered
        One entry per journal found; empty when there was nothing to do.

    Raises
    ------
    RigInputError
        When the folder is no session, is still being recorded, or cannot be written, or a journal does not belong
        there; the other trials are recovered first.

    Examples
    --------
    >>> import rig
    >>> rig.recover("sessions/example_forte")  # every trial is sealed
    []
    """
    session = Session.open(path, require_trials=False)
    journals = session.journals
    for file in journals.values():
        _refuse_if_in_use(file)
    for part in session.path.glob(".trial_*.h5.*.part"):
        part.unlink(missing_ok=True)  # part of a trial whose journal is still there
    found, complaints = [], []
    for number, file in journals.items():
        try:
            found.append(_recover_trial(session, number, file))
        except RigInputError as error:
            complaints.append(str(error))
    if complaints:
        raise RigInputError("; ".join(complaints))
    return found


recover_session = recover


def _refuse_if_in_use(file: Path) -> None:
    with refused(file, "opened"):
        descriptor = platform_calls.open_raw(file, os.O_RDWR)
    try:
        if not platform_calls.lock(descriptor):
            raise RigInputError(f"{file}: another program is recording this session; wait until it has ended")
    finally:
        os.close(descriptor)


def _recover_trial(session: Session, number: int, file: Path) -> Recovered:
    journal = read_journal(file)
    if (sealed := _sealed(session, number)) is not None:
        return _already_sealed(session, sealed, file, journal)
    if journal.head is None or not journal.blocks:
        if journal.left_over:
            return Recovered(number, "unreadable", 0, f"{file.name} begins with damage and was left as it is")
        file.unlink()
        return Recovered(number, "empty", 0, "no sample had been acquired; the journal was removed")
    if journal.head.number != number:
        raise RigInputError(f"{file}: holds trial {journal.head.number}, not {number}; give it its own name again")
    damaged = journal.records_behind or (journal.ending is not None and journal.left_over > 0)
    if journal.ending is not None and not damaged:
        status, reason = journal.ending
        note = "closed by the recorder, sealed now"
    else:
        status = "incomplete"
        note = f"recovered from the journal up to sample {journal.n_samples}"
        note += "; damage behind it" if damaged else "; the recording was cut off"
        reason = note
    if session.trial_path(number).exists():
        note += f"; the sealed file was damaged and is kept as {_put_aside(session.trial_path(number)).name}"
    data = journal.head.assemble(journal.blocks, status, reason)
    reject_warm_up(session, data)
    sealed = session.add_trial(data).read()
    if sealed.n_valid != journal.n_samples:
        raise RigInputError(
            f"{file}: {journal.n_samples} samples, but {sealed.n_valid} were sealed; the journal is kept"
        )
    if damaged:
        _put_aside(file)
    else:
        file.unlink()
    return Recovered(number, status, journal.n_samples, note)


def _sealed(session: Session, number: int) -> TrialData | None:
    """Return the sealed trial; None when there is none, or it cannot be read."""
    try:
        return session.trial(number).read()
    except RigInputError:
        return None


def _already_sealed(session: Session, sealed: TrialData, file: Path, journal: Journal) -> Recovered:
    """Remove the journal of a trial that was sealed just before the program ended, unless the two differ."""
    force_n = np.concatenate([np.empty(0), *(block.force_n for block in journal.blocks)])
    if not np.array_equal(sealed.force_n[: force_n.size], force_n):
        raise RigInputError(
            f"{file}: is not the journal of {session.trial_path(sealed.number).name}; move it elsewhere"
        )
    file.unlink()
    return Recovered(sealed.number, sealed.status, sealed.n_valid, "was sealed already; the journal was removed")


def _put_aside(file: Path) -> Path:
    """Rename a damaged file."""
    return file.replace(file.with_name(file.name + ".damaged"))
