"""What a study will take, told before most of it is computed: time and disk, by its own first units."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from model.errors import InputError

MUCH_BYTES = 1_000_000


@dataclass(frozen=True)
class Estimate:
    """What is left of a study.

    Attributes
    ----------
    members : still to compute
    seconds : that they take on ``workers``
    workers : that compute at the same time
    size : bytes that their marks take on disk, 0 where none are kept
    """

    members: int
    seconds: float
    workers: int
    size: int

    def line(self) -> str:
        """One line for the terminal."""
        kept = f", {max(self.size / MUCH_BYTES, 0.1):.1f} MB on disk" if self.size else ""
        return f"{self.members} members: about {duration(self.seconds)} on {self.workers} workers{kept}"

    def check(self, store: Path | None) -> None:
        """Refuse a study that the disk cannot hold.

        Raises
        ------
        InputError : with what is needed and what is free
        """
        if store is None or not self.size:
            return
        free = shutil.disk_usage(store).free
        if self.size > free:
            raise InputError(
                f"{store}: the study needs {self.size / MUCH_BYTES:.0f} MB, {free / MUCH_BYTES:.0f} MB are free; "
                "free space and go on with the same command, or choose another folder"
            )


def duration(seconds: float) -> str:
    """Time in the unit that suits it."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"
