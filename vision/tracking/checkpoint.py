"""Checkpoint of a tracking run, from which the same command resumes after an interruption.

A resumed run gives the numbers of one that was never interrupted, to the bit. ``job`` is a SHA-256 of everything that
decides the result; a file of another job, or a damaged one, is ignored.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body
from vision.errors import VisionInputError
from vision.files import remove, whole_file
from vision.film.source import FrameSource
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker

EVERY_ROWS = 500  # rows between two checkpoints


def job_hash(film: FrameSource, bodies: Sequence[Body], settings: Sequence[object], templates: Sequence[Any]) -> str:
    """SHA-256, hexadecimal, of what decides the result: path, size and time of writing of the film, outlines,
    templates, settings."""
    digest = hashlib.sha256()
    if film.path.exists():
        status = film.path.stat()
        digest.update(repr((str(film.path.resolve()), status.st_size, status.st_mtime_ns)).encode())
    digest.update(repr((film.n_frames, film.height, film.width, film.bit_depth, tuple(settings))).encode())
    for body, template in zip(bodies, templates, strict=True):
        digest.update(repr((body.name, body.parent, body.layer)).encode() + body.polygon_px.tobytes())
        digest.update(template.offset_px.tobytes() + template.columns.tobytes())
    return digest.hexdigest()


class Checkpoint:
    """The file of one job, known by its `job_hash`."""

    def __init__(self, path: str | os.PathLike[str], job: str) -> None:
        self.path = Path(path)
        self.job = job

    def save(self, rows: int, table: PoseTable, tracker: FilmTracker) -> None:
        """Write the first ``rows`` rows of the table and the state of the trackers to the checkpoint's file, in place
        of what it held, whole or not at all; `VisionInputError` where it cannot."""
        arrays: dict[str, NDArray[Any]] = {"job": np.array(self.job), "rows": np.array(rows)}
        arrays["searches"] = np.array(tracker.searches())
        arrays |= {f"table_{field.name}": getattr(table, field.name)[:rows] for field in fields(table)[1:]}
        arrays |= {f"tracker_{name}": values for name, values in tracker.state().items()}
        with whole_file(self.path, VisionInputError, "check the disk") as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

    def load(self, table: PoseTable, tracker: FilmTracker) -> int:
        """Fill in the rows done of this job and the trackers' state; return the number of rows: 0 where the file is of
        another job, or missing or damaged, when the trackers start anew."""
        try:
            # opened here: NumPy leaves a damaged archive's file open
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            if str(arrays["job"]) != self.job:
                return 0
            rows, tracker.searches_before = int(arrays["rows"]), int(arrays["searches"])
            for field in fields(table)[1:]:
                getattr(table, field.name)[:rows] = arrays[f"table_{field.name}"]
            start = "tracker_"
            tracker.restore({n.removeprefix(start): v for n, v in arrays.items() if n.startswith(start)})
        except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            tracker.restart()
            return 0
        return rows

    def clear(self) -> None:
        remove(self.path)
