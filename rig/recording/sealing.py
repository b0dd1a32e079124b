"""From the journal of a trial to its sealed file, part by part: a long trial never is in memory as a whole.

Recorder and recovery both seal trials here, so that a recovered trial is the one that would have been sealed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rig.backend import Block
from rig.errors import RigInputError
from rig.recording.trial_plan import reject_warm_up
from rig.session.folder import Session, Trial
from rig.session.journal.format import Journal, scan_journal, stored_blocks
from rig.session.trial_data import TrialData

PART_SAMPLES = 5_000


def seal_journal(session: Session, file: Path, scanned: Journal, status: str, reason: str) -> Trial:
    """Seal the trial whose journal was scanned; the journal stays.

    A warm-up blow is rejected first: it never counts, whenever the program ends.

    Raises
    ------
    RigInputError
        When the journal cannot be read or has no samples, or the trial cannot be written.
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
    return session.add_trial_parts(about, scanned.n_samples, _parts(file, scanned))


def seal_recorded(session: Session, file: Path, status: str, reason: str) -> Trial:
    """Seal the trial that was just recorded; raises as :func:`seal_journal`."""
    return seal_journal(session, file, scan_journal(file), status, reason)


def _parts(file: Path, scanned: Journal) -> Iterator[TrialData]:
    assert scanned.head is not None
    waiting: list[Block] = []
    first = samples = 0
    for block in stored_blocks(file, scanned):
        waiting.append(block)
        samples += block.force_n.size
        if samples - first >= PART_SAMPLES:
            yield scanned.head.part(waiting, first)
            waiting, first = [], samples
    if waiting:
        yield scanned.head.part(waiting, first)
