"""A recording in progress, a block at a time: a journal as the recorder writes it, filled from a sealed trial."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np

from rig import Block, Session, TrialData
from rig.session.journal_writer import JournalWriter
from rig.session.trial_head import TrialHead


class Recording:
    """Appends blocks of a sealed trial's samples to the journal of a new one."""

    def __init__(self, folder: Path, number: int, most_samples: int = 0) -> None:
        self.session = Session.open(folder)
        self.data: TrialData = self.session.trials[0].read()
        known = {one.name: getattr(self.data, one.name) for one in fields(TrialHead) if hasattr(self.data, one.name)}
        head = TrialHead(**{**known, "number": number, "command_v": self.data.motor_command_v})
        path = self.session.journal_path(number)
        self.writer = JournalWriter(path, head, most_samples or self.data.n_valid, 1000)
        self.done = 0

    def append(self, count: int) -> None:
        """The next samples, again from the first after the last."""
        rows = np.arange(self.done, self.done + count) % self.data.n_valid
        self.writer.append(
            Block(self.done, self.data.raw_force_n[rows], self.data.force_raw[rows], self.data.encoder_count[rows])
        )
        self.done += count

    def close(self) -> None:
        """End the journal."""
        self.writer.close("interrupted", "end of the test")


@contextmanager
def recording(folder: Path, number: int = 4, most_samples: int = 0) -> Iterator[Recording]:
    made = Recording(folder, number, most_samples)
    try:
        yield made
    finally:
        made.close()
