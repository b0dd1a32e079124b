"""A live view of a session while another process records it: the journal of the current trial, then the sealed trial.

The journal is opened for reading, read from where the last read ended, and closed at once: no lock is taken and nothing
is written, so the recording cannot be disturbed. Only complete records in sequence are taken; the rest is read next
time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block
from rig.session.folder import Session
from rig.session.journal.format import BLOCK, OVERHEAD, block_of, parse, records
from rig.session.journal.trial_head import TrialHead
from rig.session.trial_data import TrialData


class JournalFollower:
    """Reads a growing journal incrementally; ``head`` is None until it is complete."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head: TrialHead | None = None
        self.blocks: list[Block] = []
        self._n_bytes = self._n_records = 0

    def poll(self) -> bool:
        """Read what was written since the last poll; False when the journal is gone."""
        try:
            with self.path.open("rb") as stream:
                stream.seek(self._n_bytes)
                data = stream.read()
        except OSError:
            return False
        if self.head is None:
            journal = parse(data)
            if journal.head is not None:
                self.head, self.blocks = journal.head, list(journal.blocks)
                self._n_bytes, self._n_records = journal.n_bytes, journal.n_records
            return True
        for record in records(data, self._n_records):
            self._n_bytes += OVERHEAD + len(record.payload)
            self._n_records += 1
            if record.kind == BLOCK:
                self.blocks.append(block_of(record, self.head))
        return True


@dataclass(frozen=True, eq=False)
class LiveView:
    """A session at one moment.

    Attributes
    ----------
    trial, trials : int
        Number of the trial, and how many the plan has.
    state : str
        ``recording``, or the status of a sealed trial.
    condition : str
    time_s, force_n : ndarray, shape (n,)
    angle_rad : ndarray, shape (n, len(names))
        Of the bodies ``names`` from the first sample on.
    sealed : int
        Trials sealed so far.
    """

    trial: int
    trials: int
    state: str
    condition: str
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    names: tuple[str, ...]
    sealed: int

    @property
    def finished(self) -> bool:
        """Whether nothing is being recorded and the plan's trials are there."""
        return self.state != "recording" and self.sealed >= self.trials


class SessionFollower:
    """Reads a session repeatedly; one journal is read on from where the last poll ended."""

    def __init__(self, session: str | Path) -> None:
        self.session = Session.open(session, require_trials=False)
        self._journal: JournalFollower | None = None

    def poll(self) -> LiveView | None:
        """Return the present view; None before the first sample.

        Raises RigInputError when a sealed trial cannot be read.
        """
        journals = self.session.journals
        if journals:
            path = list(journals.values())[-1]
            if self._journal is None or self._journal.path != path:
                self._journal = JournalFollower(path)
            if self._journal.poll() and self._journal.head is not None and self._journal.blocks:
                head = replace(self._journal.head, frame_clock=None)  # frames are not shown
                return self._view(head.assemble(self._journal.blocks, "recording", ""), len(self.session.trials))
        trials = self.session.trials
        return self._view(trials[-1].read(), len(trials)) if trials else None

    def _view(self, data: TrialData, sealed: int) -> LiveView:
        return LiveView(
            data.number, self.session.info.plan.trials, data.status, data.condition, data.time_s, data.force_n,
            data.angle_rad(), tuple(encoder.name for encoder in data.encoders), sealed,
        )  # fmt: skip
