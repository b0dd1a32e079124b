"""Seal trials from their journals; recorder and recovery both do it here, so that a recovered trial is the same file.

A journal becomes a sealed file part by part: a long trial never is in memory as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

from rig.backend import Block
from rig.errors import RigInputError
from rig.recording.trial_plan import reject_warm_up
from rig.session.folder import Session, Trial
from rig.session.journal_records import Journal, scan_journal, stored_blocks
from rig.session.trial_data import TrialData
from rig.session.trial_head import TrialHead

PART_SAMPLES = 5_000  # of a trial that are sealed at once: one second, so that memory does not grow


@dataclass(frozen=True)
class Stroke:
    """A stroke: samples from ``first`` up to ``end``, noticed at ``trigger``, and why it ended.

    ``status`` is ``complete``, ``not at rest`` (longer than ``longest_s``) or ``interrupted``.
    """

    first: int
    trigger: int
    end: int
    status: str


def seal_journal(session: Session, file: Path, scanned: Journal, status: str, reason: str) -> Trial:
    """Seal the trial whose journal ``file`` was ``scanned``, with this status and reason, as the number in its head;
    the journal stays. Refuse one without samples.

    A warm-up blow is rejected first: it never counts, whenever the program ends.
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
    return session.add_trial_parts(about, scanned.n_samples, _assemble_parts(head, stored_blocks(file, scanned)))


NOTICED_LATE_S = 0.05  # at most, by far, after a stroke begins: the force has to reach the trigger


def seal_cut(session: Session, file: Path, cut: Stroke, status: str, reason: str) -> Trial:
    """Seal the stroke ``cut``, samples numbered in the journal ``file``, as the journal's trial with this status and
    reason: its first sample is time zero, the start time is shifted along; the journal stays."""
    scanned = scan_journal(file)
    head = scanned.head
    end = min(cut.end, scanned.n_samples)
    if head is None or end <= cut.first:
        raise RigInputError(f"{file}: has no samples")
    rate = head.sample_rate_hz
    started = datetime.fromisoformat(head.started_utc) + timedelta(seconds=cut.first / rate)
    head = replace(
        head,
        started_utc=started.isoformat(timespec="milliseconds"),
        blow_start_s=max((cut.trigger - cut.first) / rate - NOTICED_LATE_S, 0.0),
    )
    about = replace(head.part((), 0), status=status, reason=reason)
    blocks = _cut_blocks(stored_blocks(file, scanned), cut.first, end)
    return session.add_trial_parts(about, end - cut.first, _assemble_parts(head, blocks))


def _cut_blocks(blocks: Iterator[Block], first: int, end: int) -> Iterator[Block]:
    """Yield the samples from number ``first`` to just before ``end``, numbered anew from 0, in blocks without the
    camera's exposures."""
    for block in blocks:
        low, high = max(first - block.first_sample, 0), min(end - block.first_sample, block.force_n.size)
        if low >= high:
            continue
        values = block.channel_values
        yield Block(
            block.first_sample + low - first,
            block.force_n[low:high],
            block.force_raw[low:high],
            block.encoder_count[low:high],
            None,
            None if values is None else values[low:high],
        )


def _assemble_parts(head: TrialHead, blocks: Iterator[Block]) -> Iterator[TrialData]:
    """Yield the parts of a trial, at least 5000 samples each but the last, from its blocks in order; ``head``: what the
    trial states of itself."""
    waiting: list[Block] = []
    first = samples = 0
    for block in blocks:
        waiting.append(block)
        samples += block.force_n.size
        if samples - first >= PART_SAMPLES:
            yield head.part(waiting, first)
            waiting, first = [], samples
    if waiting:
        yield head.part(waiting, first)
