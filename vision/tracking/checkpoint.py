"""What is kept of a tracking that is interrupted, so that the same command goes on where it stopped.

Place in the data flow: `following` saves the rows done and the followers' state every `EVERY_ROWS` rows under
the name the caller gives, and starts from them when they belong to the same job; the file is removed when the
film is done. A resumed run gives the numbers of one that was never interrupted, up to
the rounding of 32-bit sums.

Format: NumPy ``.npz`` without pickled objects, under a temporary name until it is whole. ``job`` is a SHA-256
of everything that decides the result. Failure: a file of another job, or a damaged one, is not used; one that
cannot be written raises `InputError`.
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

from vision.atomic_write import remove, whole_file
from vision.bodies.outlines import Body
from vision.errors import InputError
from vision.film.source import FrameSource
from vision.tracking.body_tracker import Follower
from vision.tracking.frame_step import Run
from vision.tracking.pose_table import PoseTable

EVERY_ROWS = 500


def job_of(film: FrameSource, bodies: Sequence[Body], settings: Sequence[object], templates: Sequence[Any]) -> str:
    """SHA-256 of what decides the result: the film's size and time of writing, outlines, templates, settings."""
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
    """The file of one job.

    Parameters
    ----------
    path : path
    job : str
        `job_of`.
    """

    def __init__(self, path: str | os.PathLike[str], job: str) -> None:
        self.path = Path(path)
        self.job = job

    def save(self, rows: int, table: PoseTable, run: Run) -> None:
        """Keep the first ``rows`` rows and where the bodies are."""
        arrays: dict[str, NDArray[Any]] = {"job": np.array(self.job), "rows": np.array(rows)}
        arrays |= {f"table_{field.name}": getattr(table, field.name)[:rows] for field in fields(table)[1:]}
        for i, follower in enumerate(run.followers):
            arrays |= {f"body{i}_{name}": value for name, value in _state(follower).items()}
        with whole_file(self.path, InputError, "check the disk") as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

    def load(self, table: PoseTable, run: Run) -> int:
        """Fill in what was done of this job; returns the number of rows, 0 when there is nothing to go on from."""
        try:
            # opened here: NumPy leaves a damaged archive's file open
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            if str(arrays["job"]) != self.job:
                return 0
            rows = int(arrays["rows"])
            for field in fields(table)[1:]:
                getattr(table, field.name)[:rows] = arrays[f"table_{field.name}"]
            for i, follower in enumerate(run.followers):
                start = f"body{i}_"
                _restore(follower, {n[len(start) :]: v for n, v in arrays.items() if n.startswith(start)})
        except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            run.restart()
            return 0
        return rows

    def clear(self) -> None:
        """Remove the file."""
        remove(self.path)


def _state(follower: Follower) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        "figures": np.array([follower.usual_zncc, follower.usual_gain]),
        "counts": np.array([follower.lost_in_a_row, follower.searches]),
    }
    for name, trace in (("absolute", follower.absolute), ("relative", follower.relative)):
        items = trace.items()
        arrays[f"{name}_step"] = np.array([step for step, _ in items], dtype=np.int64)
        arrays[f"{name}_place"] = np.array([place for _, place in items], dtype=float).reshape(-1, 3)
    return arrays | {f"fitter_{name}": value for name, value in follower.fitter.carried().items()}


def _restore(follower: Follower, arrays: dict[str, NDArray[Any]]) -> None:
    follower.usual_zncc, follower.usual_gain = (float(v) for v in arrays["figures"])
    follower.lost_in_a_row, follower.searches = (int(v) for v in arrays["counts"])
    for name, trace in (("absolute", follower.absolute), ("relative", follower.relative)):
        trace.clear()
        for step, place in zip(arrays[f"{name}_step"], arrays[f"{name}_place"], strict=True):
            trace.add(int(step), np.array(place))
    follower.fitter.carry({n.removeprefix("fitter_"): v for n, v in arrays.items() if n.startswith("fitter_")})
