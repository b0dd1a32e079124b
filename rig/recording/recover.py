"""Recovery of trials from the journals that a killed program, a crash or a full disk left behind.

They are marked ``incomplete`` unless the journal has its closing record. A journal is deleted only after its contents
are sealed and read back; one that is damaged in its middle is renamed ``.journal.damaged``, a sealed file that was
damaged while its journal was still there ``.h5.damaged``. A second run changes nothing more. A trial that another
program opened for writing and closed unchanged is sealed again; one that cannot be read is named.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig import platform_calls
from rig.atomic_write import replace_when_complete, translate_os_error
from rig.configuration import toml_file
from rig.errors import RigInputError
from rig.recording.passive import StrokeDetector, StrokeSettings
from rig.recording.seal_trials import Stroke, seal_cut, seal_journal
from rig.session import annotation_file
from rig.session.folder import INFO_NAME, UNREADABLE, Session
from rig.session.info import PASSIVE
from rig.session.journal_records import Journal, scan_journal, stored_blocks
from rig.session.seal import has_seal, seal_again
from rig.session.sealed_trial import trial_problem
from rig.session.trial_data import TrialData


@dataclass(frozen=True)
class Recovered:
    """Outcome of one journal or trial: its status, or ``empty`` or ``unreadable``, its samples, and a note."""

    trial: int
    status: str
    samples: int
    note: str


def recover(path: str | Path, out: str | Path | None = None) -> list[Recovered]:
    """Seal every trial that a session has only in a journal, which is then removed, and seal again what lost its seal;
    with ``out`` do so in a copy there and change nothing here. Return what became of each, and what is unreadable.

    Parameters
    ----------
    path : path
        Session folder.
    out : path, optional
        Session folder to create for the result, e.g. where the first is full or cannot be written: sealed trials,
        annotations and the files beside them are copied, films and derived results are not. Nothing of the first
        is changed.

    Returns
    -------
    list of Recovered
        One entry per journal found, per trial that was sealed again and per trial that cannot be read; empty when every
        trial is sealed and can be read.

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
        _refuse_if_in_use(file, os.O_RDWR if out is None else os.O_RDONLY)
    if out is not None:
        copy, damaged = _copy_session(session, Path(out))
        kept = [one for one in damaged if one.trial not in journals]  # the others are in their journals
        return kept + _recover_all(copy, journals, keep=True)
    for part in session.path.glob(".trial_*.h5.*.part"):
        part.unlink(missing_ok=True)  # part of a trial whose journal is still there
    return _recover_all(session, journals, keep=False)


def _recover_all(session: Session, journals: Mapping[int, Path], *, keep: bool) -> list[Recovered]:
    """Seal the trials of ``journals`` (file by trial number) in a session and seal again those that lost their seal;
    ``keep``: no journal is removed. Return what became of each, by number, with the unreadable; refusals come at the
    end."""
    sealed_again = {one.trial: one for one in _reseal_trials(session)}
    found, complaints = [], []
    for number, file in journals.items():
        try:
            one = _recover_trial(session, number, file, keep=keep)
            if number in sealed_again:
                one = replace(one, note=f"{sealed_again.pop(number).note}; {one.note}")
            found.append(one)
        except RigInputError as error:
            complaints.append(str(error))
    if complaints:
        raise RigInputError("; ".join(complaints))
    found += sealed_again.values()
    named = {one.trial for one in found}
    unreadable = {trial.number: trial.problem for trial in session.trials if trial.number not in named}
    found += [Recovered(number, UNREADABLE, 0, problem) for number, problem in unreadable.items() if problem]
    return sorted(found, key=lambda one: one.trial)


def _reseal_trials(session: Session) -> list[Recovered]:
    """Seal again each trial that another program opened for writing and closed unchanged; return what was found."""
    found = []
    for trial in session.trials:
        note = "another program had opened it for writing; its content is as it was sealed"
        try:
            if has_seal(trial.path):
                continue
            seal_again(trial.path)
            note += ", and it was sealed again"
        except RigInputError as error:
            if trial.problem:
                continue
            note += f", but it was not sealed again: {error}"
        data = trial.read()
        found.append(Recovered(trial.number, data.status, data.n_valid, note))
    return found


def _copy_session(session: Session, out: Path) -> tuple[Session, list[Recovered]]:
    """Copy a session's trials and texts to a new one; return it, and the unreadable trials, which are renamed."""
    texts = {INFO_NAME: "", annotation_file.FILE_NAME: ""}
    for file in session.path.iterdir():
        if file.suffix in (".toml", ".jsonl") and file.is_file():
            texts[file.name] = toml_file.read_text(file)
    del texts[INFO_NAME]  # written by the session itself
    copy = Session.create(out, session.info, {name: text for name, text in texts.items() if text})
    damaged = []
    for trial in session.trials:
        target = copy.trial_path(trial.number)
        with translate_os_error(target, "written"), replace_when_complete(target) as part:
            shutil.copyfile(trial.path, part)
        with contextlib.suppress(RigInputError):
            if not has_seal(target):
                seal_again(target)
        platform_calls.make_read_only(target)
        if problem := trial_problem(target):
            aside = _rename_damaged(target)
            damaged.append(Recovered(trial.number, UNREADABLE, 0, f"{problem}; copied as {aside.name}"))
    return copy, damaged


def _refuse_if_in_use(file: Path, flags: int) -> None:
    """Refuse a file that another program holds locked, by locking it for a moment; ``flags``: those of `os.open`, with
    which it is opened for that."""
    with translate_os_error(file, "opened"):
        descriptor = platform_calls.open_raw(file, flags)
    try:
        if not platform_calls.lock(descriptor):
            raise RigInputError(f"{file}: another program is recording this session; wait until it has ended")
    finally:
        os.close(descriptor)


def _recover_trial(session: Session, number: int, file: Path, *, keep: bool) -> Recovered:
    """Seal what a trial's journal ``file`` holds and return what became of it; remove the journal, unless ``keep``."""
    journal, fate = scan_journal(file), "stays" if keep else "was removed"
    if (sealed := _read_sealed_trial(session, number)) is not None:
        # sealed just before the program ended, unless the two differ
        kept, at = stored_blocks(file, journal) if journal.head is not None else (), sealed.raw_force_n
        force_n = np.concatenate([np.empty(0), *(block.force_n for block in kept)])
        same = np.array_equal(at[: force_n.size], force_n)
        if journal.head is not None and PASSIVE in journal.head.provenance:  # a stroke is cut out of its journal
            same = any(np.array_equal(force_n[k:][: at.size], at) for k in np.flatnonzero(force_n == at[0]))
        if not same:
            raise RigInputError(f"{file}: is not the journal of {session.trial_path(number).name}; move it elsewhere")
        if not keep:
            file.unlink()
        return Recovered(number, sealed.status, sealed.n_valid, f"was sealed already; the journal {fate}")
    if journal.head is None or not journal.n_samples:
        if journal.left_over and not journal.only_begun:
            return Recovered(number, UNREADABLE, 0, f"{file.name} begins with damage and was left as it is")
        if not keep:
            file.unlink()
        return Recovered(number, "empty", 0, f"no sample had been acquired; the journal {fate}")
    settings = journal.head.provenance.get(PASSIVE)
    stroke, settled = (None, False) if settings is None else _find_stroke(file, journal, settings)
    if settled and stroke is None:
        if not keep:
            file.unlink()
        return Recovered(number, "empty", 0, f"nobody was playing; the journal {fate}")
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
        note += f"; the sealed file was damaged and is kept as {_rename_damaged(session.trial_path(number)).name}"
    if stroke is None:
        wanted = journal.n_samples
        made = seal_journal(session, file, journal, status, reason).read()
    else:
        wanted = stroke.end - stroke.first
        made = seal_cut(session, file, stroke, status, reason).read()
    if made.n_valid != wanted:
        raise RigInputError(f"{file}: {wanted} samples, but {made.n_valid} were sealed; the journal is kept")
    if keep:
        note += "; the journal stays"
    elif damaged:
        _rename_damaged(file)
    else:
        file.unlink()
    return Recovered(number, status, wanted, note)


def _find_stroke(file: Path, journal: Journal, settings: str) -> tuple[Stroke | None, bool]:
    """Return the stroke in the journal of a passive recording (None: nobody played) and whether the bench was ever at
    rest before it; ``settings``: text of the stroke's limits in the journal's head."""
    try:
        detector = StrokeDetector(StrokeSettings.from_text(settings))
    except (TypeError, ValueError, KeyError) as error:
        raise RigInputError(f"{file}: its settings of strokes cannot be read ({error})") from None
    for block in stored_blocks(file, journal):
        if (stroke := detector.add(block)) is not None:
            return stroke, True
    return detector.finish(), detector.is_settled


def _read_sealed_trial(session: Session, number: int) -> TrialData | None:
    try:
        return session.trial(number).read()
    except RigInputError:
        return None


def _rename_damaged(file: Path) -> Path:
    aside = file.with_name(file.name + ".damaged")
    platform_calls.replace(file, aside)
    return aside
