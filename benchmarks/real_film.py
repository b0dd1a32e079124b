"""A real film against another program: poses lost, difference from DICe's angles, stated uncertainty, flags.

    python -m benchmarks real_film [--folder FOLDER]        # default: ../shared/data/escapement beside the repository

FOLDER holds the pictures of an escapement (DICe's regression test), ``bodies.toml`` and DICe's results ``gold_K.csv``
of its K-th body. No true angle is known: both programs see the same pixels, so that what misleads both does not show.
DICe states a standard deviation of its shifts (``SIGMA``, px) and none of its angles. Without the folder nothing is
done.
"""

from __future__ import annotations

import csv
import warnings
from pathlib import Path

import numpy as np

import vision
from benchmarks.runner import ROOT, Run, Table

BESIDE = ROOT.parent / "shared" / "data" / "escapement"


def main(run: Run) -> bool:
    """Track and print one line per body; whether no pose is lost."""
    folder = Path(run.folder) if run.folder else BESIDE
    if not (folder / "bodies.toml").is_file():
        print(f"skipped: {folder} is not there (pictures, bodies.toml and gold_*.csv of DICe's escapement)")
        return True
    quiet = warnings.catch_warnings(action="ignore", category=vision.VisionWarning)  # no frame is still
    with quiet, vision.open_film(folder) as film:
        times = np.arange(film.n_frames) / 1000.0
        result = vision.track(film, vision.load_bodies(folder / "bodies.toml"), times)
    table = Table(
        "body:12s", "poses:d", "lost:d", "flagged:d", "RMS mrad:.2f", "u mrad:.2f", "covered:.2f", "DICe SIGMA px:.3f"
    )
    for i, body in enumerate(result.bodies):
        with (folder / f"gold_{i}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        n = min(len(rows), len(result.frame))
        # DICe's angles are in the picture's sense; the first frame is the reference of both
        theirs = -np.array([float(row["ROTATION_Z"]) for row in rows[:n]])
        off, u = (result.angle_rad[:n, i] - theirs)[1:], result.u_angle_rad[1:n, i]
        found = np.isfinite(off)
        rms, median = 1e3 * np.sqrt(np.mean(off[found] ** 2)), 1e3 * np.median(u[found])
        covered = np.mean(np.abs(off[found]) < 1.96 * u[found])
        sigma = np.median([float(row["SIGMA"]) for row in rows[:n]])
        flagged = np.count_nonzero(result.flag[:, i][~result.failed[:, i]])
        table.row(body, len(result.frame), result.failed[:, i].sum(), flagged, rms, median, covered, sigma)
    return not result.failed.any()
