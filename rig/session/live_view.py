"""The live view of a session that another process records: the journal of the current trial, then the sealed trial.

The journal is opened for reading, read from where the last read ended, and closed at once: no lock is taken and nothing
is written, so the recording cannot be disturbed. Only complete records in sequence are taken.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.arrays import ArrayRecord
from rig.backend import Block
from rig.session.folder import Session
from rig.session.info import PASSIVE
from rig.session.journal_records import BLOCK, OVERHEAD, decode_block, decode_blocks, read_records, scan
from rig.session.trial_data import TrialData
from rig.session.trial_head import TrialHead

KEEP_S = 30.0  # of a trial in progress, kept and shown: a long one must not fill the memory
LOOKS = 3  # without a journal, one after the other, that show the end of what somebody plays
READ_BYTES = 2_000_000  # of a journal, that one look reads at most: some seconds of a dozen channels


class JournalFollower:
    """Reads a growing journal incrementally; ``head`` is None until it is complete.

    ``blocks`` are the last 30 s, ``first_count`` the encoders' counts at the trial's first sample.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head: TrialHead | None = None
        self.blocks: list[Block] = []
        self.first_count: NDArray[np.int64] | None = None
        self._n_bytes = self._n_records = 0

    def poll(self) -> bool:
        """Read what was written since the last poll into ``head`` (None until it is complete) and ``blocks`` (the last
        30 s); return False when the journal cannot be opened, True also where nothing is new."""
        try:
            with self.path.open("rb") as stream:
                stream.seek(self._n_bytes)
                # beyond the last record lie the zeros set aside for the whole trial, which are not read again and again
                data = stream.read() if self.head is None else stream.read(READ_BYTES)
        except OSError:
            return False
        if self.head is None:
            journal = scan(io.BytesIO(data))
            if journal.head is not None:
                self.head, self.blocks = journal.head, list(decode_blocks(io.BytesIO(data), journal))
                self._n_bytes, self._n_records = journal.n_bytes, journal.n_records
                self._drop_old(self.head)
            return True
        for record in read_records(io.BytesIO(data), self._n_records):
            self._n_bytes += OVERHEAD + len(record.payload)
            self._n_records += 1
            if record.kind == BLOCK:
                self.blocks.append(decode_block(record, self.head))
        self._drop_old(self.head)
        return True

    def _drop_old(self, head: TrialHead) -> None:
        """Drop blocks older than the last `KEEP_S` (30 s), but keep the encoders' first counts (1, 3) in
        ``first_count``: turns are counted from them."""
        if not self.blocks:
            return
        if self.first_count is None:
            self.first_count = self.blocks[0].encoder_count[:1]
        last = self.blocks[-1]
        oldest = last.first_sample + last.force_n.size - KEEP_S * head.sample_rate_hz
        kept = next(k for k, block in enumerate(self.blocks) if block.first_sample + block.force_n.size > oldest)
        del self.blocks[:kept]


@dataclass(frozen=True, eq=False)
class LiveView(ArrayRecord):
    """A session at one moment."""

    # trial, trials: number of the trial, and how many the plan has
    trial: int
    trials: int
    state: str  # ``recording``, or the status of a sealed trial
    condition: str
    # time_s, raw_force_n: (n,), of a trial in progress the last 30 s
    time_s: NDArray[np.float64]
    raw_force_n: NDArray[np.float64]
    angle_rad: NDArray[np.float64]  # (n, len(names)), of the bodies ``names`` from the first sample on
    names: tuple[str, ...]
    sealed: int  # trials sealed so far

    @property
    def is_finished(self) -> bool:
        """Whether nothing is being recorded and the plan's trials are there."""
        return self.state != "recording" and self.sealed >= self.trials


class SessionFollower:
    """Reads a session repeatedly; one journal is read on from where the last poll ended."""

    def __init__(self, session: str | Path) -> None:
        self.session = Session.open(session, require_trials=False)
        self._journal: JournalFollower | None = None
        self._idle = 0

    @property
    def has_ended(self) -> bool:
        """Whether nobody plays any more: as long as somebody may, a journal lies there, but for an instant."""
        return self.session.info.profile.name == PASSIVE and self._idle >= LOOKS

    def poll(self) -> LiveView | None:
        """What the session shows now: the trial being recorded (its last 30 s), else the last sealed one; None before
        the first sample."""
        journals = self.session.journals
        if journals:
            path = list(journals.values())[-1]
            if self._journal is None or self._journal.path != path:
                self._journal = JournalFollower(path)
            if self._journal.poll() and self._journal.head is not None and self._journal.blocks:
                blocks, zero = self._journal.blocks, self._journal.first_count
                part = self._journal.head.part(blocks, blocks[0].first_sample)
                return self._view(replace(part, status="recording"), len(self.session.trials), zero)
        trials = self.session.trials
        self._idle = 0 if journals or not (trials or self._journal) else self._idle + 1
        return self._view(trials[-1].read(), len(trials)) if trials else None

    def _view(self, data: TrialData, sealed: int, zero: NDArray[np.int64] | None = None) -> LiveView:
        return LiveView(
            data.number, self.session.info.plan.trials, data.status, data.condition, data.time_s, data.raw_force_n,
            data.convert_counts(zero), tuple(encoder.name for encoder in data.encoders), sealed,
        )  # fmt: skip
